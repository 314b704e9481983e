"""The naive method (§1): march outwards from every point, one column at a time; baseline and oracle.

All receivers of a direction see the crossings at the same offsets with the same weights, so a step is one vector operation
over a row of receivers, which compilers turn into SIMD. Every crossing of the ray with an edge of the triangulation is
visited: the result is exact on the stated surface.
"""

from __future__ import annotations

import numba as nb
import numpy as np

BLOCK = 64  # receivers marched together


@nb.njit(cache=True)
def crossings(slope, diagonal, columns):
    """List the edge crossings of a ray that leaves a grid point, as far as ``columns`` columns.

    Returns
    -------
    offset : (n, 4) int32 array
        Row and column offsets of the edge's two ends.
    weight : (n,) float64 array
        Weight of the second end.
    distance : (n,) float64 array
        Distance in columns, rising.
    """
    most = 4 * columns + 4
    offset, weight, distance = np.empty((most, 4), np.int32), np.empty(most), np.empty(most)
    n = 0
    for k in range(columns):
        # Within columns k to k + 1 the ray climbs from y0 to y1
        y0, y1 = slope * k, slope * (k + 1)
        row = int(np.floor(y0 + 1e-12))
        last = int(np.ceil(y1 - 1e-12)) - 1
        here = n
        for r in range(row, max(last, row) + 1):
            # Cell (r, k): its diagonal, either y − r = x − k or y − r = 1 − (x − k)
            if diagonal:
                if slope < 1.0:
                    x = (slope * k - r) / (1.0 - slope)
                else:
                    x = -1.0
            else:
                x = (r + 1 - slope * k) / (1.0 + slope)
            if 1e-12 < x < 1.0 - 1e-12:
                y = slope * (k + x) - r
                if 1e-12 < y < 1.0 - 1e-12:
                    offset[n, 0], offset[n, 1] = (r, k) if diagonal else (r + 1, k)
                    offset[n, 2], offset[n, 3] = (r + 1, k + 1) if diagonal else (r, k + 1)
                    weight[n], distance[n] = x, k + x
                    n += 1
            # The row edge between cells r and r + 1
            if r < last:
                x = (r + 1) / slope - k
                if 1e-12 < x < 1.0 - 1e-12:
                    offset[n, 0], offset[n, 1], offset[n, 2], offset[n, 3] = r + 1, k, r + 1, k + 1
                    weight[n], distance[n] = x, k + x
                    n += 1
        # In the order of distance: at most three
        for a in range(here + 1, n):
            b = a
            while b > here and distance[b - 1] > distance[b]:
                for c in range(4):
                    offset[b, c], offset[b - 1, c] = offset[b - 1, c], offset[b, c]
                weight[b], weight[b - 1] = weight[b - 1], weight[b]
                distance[b], distance[b - 1] = distance[b - 1], distance[b]
                b -= 1
        # The column edge at k + 1
        row = int(np.floor(y1 + 1e-12))
        f = y1 - row
        if f < 1e-12:
            f = 0.0
        offset[n, 0], offset[n, 1], offset[n, 2], offset[n, 3] = row, k + 1, row + (1 if f > 0 else 0), k + 1
        weight[n], distance[n] = f, k + 1
        n += 1
    return offset[:n], weight[:n], distance[:n]


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def steepest(heights, offset, weight, distance, step, curve, out):
    """Raise ``out`` to the steepest rise towards any of the listed crossings that lies on the field.

    Parameters
    ----------
    heights : (rows, columns) float32 array
        Turned heights, centred.
    offset, weight, distance
        As `crossings` returns them.
    step : float
        Metres per column.
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    out : (rows, columns) float32 array
        Tangents of the horizons so far, changed in place.
    """
    rows, columns = heights.shape
    top = heights.max()
    for i in nb.prange(rows):
        here = heights[i]
        # Blocks of receivers: their horizons stay in the cache, and each stops as soon as it can
        for j0 in range(0, columns, BLOCK):
            best = out[i, j0 : j0 + BLOCK]
            mine = here[j0 : j0 + BLOCK]
            for n in range(len(distance)):
                ra, ca, rb, cb = i + offset[n, 0], j0 + offset[n, 1], i + offset[n, 2], j0 + offset[n, 3]
                count = min(len(best), columns - max(ca, cb))
                if ra >= rows or rb >= rows or count <= 0:
                    break
                w = np.float32(weight[n])
                scale = np.float32(1.0 / (distance[n] * step))
                drop = np.float32(curve * distance[n] * step)
                if n % 16 == 15:
                    # Nothing beyond can rise above anybody's horizon
                    more = False
                    for j in range(count):
                        more |= (top - mine[j]) * scale - drop > best[j]
                    if not more:
                        break
                a, b = heights[ra, ca : ca + count], heights[rb, cb : cb + count]
                for j in range(count):
                    rise = (a[j] + w * (b[j] - a[j]) - mine[j]) * scale - drop
                    best[j] = max(best[j], rise)


def horizons(heights, d, curve: float = 0.0, reach: int | None = None) -> np.ndarray:
    """Tangent of the horizon of every grid point along +x, by marching.

    Parameters
    ----------
    heights : (rows, columns) float32 array
        Turned heights, centred.
    d : sweep.Direction
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    reach : int, optional
        Columns to look at; all of them by default.

    Returns
    -------
    (rows, columns) float32 array
        −inf where nothing of the field lies in the direction.
    """
    heights = np.ascontiguousarray(heights, dtype=np.float32)
    columns = heights.shape[1] - 1 if reach is None else min(reach, heights.shape[1] - 1)
    out = np.full(heights.shape, -np.inf, dtype=np.float32)
    if columns > 0:
        steepest(heights, *crossings(d.slope, d.diagonal, columns), d.step, curve, out)
    return out
