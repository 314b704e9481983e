"""The naive method (§1): march outwards from every point, one column at a time; baseline and oracle.

All receivers of a direction see the crossings at the same offsets with the same weights, so a step is one vector operation
over a row of receivers, which compilers turn into SIMD. Every crossing of the ray with an edge of the triangulation is
visited: the result is exact on the stated surface.
"""

from __future__ import annotations

import numba as nb
import numpy as np

BLOCK = 64  # receivers marched together
NEARBY = 1e-9  # columns; nearer to a sample, a ray runs through it


def crossings(slope, diagonal, columns, y=0.0, x=0.0):
    """List the edge crossings of a ray over the grid, as far as ``columns`` columns.

    Parameters
    ----------
    slope : float
        Rows per column, in [0, 1].
    diagonal : bool
        Whether cells are cut from (row, column) to (row + 1, column + 1).
    columns : float
        How far to look.
    y, x : float
        Row and column where the ray begins, >= 0.

    Returns
    -------
    offset : (n, 4) int32 array
        Row and column of the edge's two ends.
    weight : (n,) float64 array
        Weight of the second end.
    distance : (n,) float64 array
        Distance in columns from the beginning, rising.
    """
    # Columns: always counted, and alone where the ray meets a sample
    at_x = np.arange(np.floor(x + NEARBY) + 1, np.floor(x + columns + NEARBY) + 1)
    t = at_x - x
    at_y = y + slope * t
    row = np.floor(at_y + NEARBY)
    weight = np.where(at_y - row < NEARBY, 0.0, at_y - row)
    found = [(t, row, at_x, row + (weight > 0), at_x, weight)]
    # Rows
    if slope > 0:
        row = np.arange(np.floor(y + NEARBY) + 1, np.floor(y + slope * columns + NEARBY) + 1)
        t = (row - y) / slope
        column, weight = _between(x + t)
        found.append((t, row, column, row, column + 1, weight))
    # Diagonals: y − x, or y + x, is a whole number on them
    speed, start = (slope - 1, y - x) if diagonal else (slope + 1, y + x)
    if speed > 0:
        t = (np.arange(np.floor(start + NEARBY) + 1, np.floor(start + speed * columns + NEARBY) + 1) - start) / speed
    elif speed < 0:
        t = (np.arange(np.ceil(start - NEARBY) - 1, np.ceil(start + speed * columns - NEARBY) - 1, -1) - start) / speed
    else:
        t = np.zeros(0)
    column, weight = _between(x + t)
    row = np.floor(y + slope * t)
    found.append((t, row + (not diagonal), column, row + diagonal, column + 1, weight))
    t, r0, c0, r1, c1, weight = np.concatenate(found, axis=1)
    keep = np.flatnonzero((t > NEARBY) & (t <= columns + NEARBY) & ~np.isnan(weight))
    keep = keep[np.argsort(t[keep], kind="stable")]
    return np.stack([r0, c0, r1, c1], -1)[keep].astype(np.int32), weight[keep], t[keep]


def _between(x):
    # Column to the left and share of the way to the next; not a number on a column, which is listed as such
    column = np.floor(x)
    part = x - column
    return column, np.where((part > NEARBY) & (part < 1 - NEARBY), part, np.nan)


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def steepest(heights, own, edges, weight, distance, step, curve, out):
    """Raise ``out`` to the steepest rise towards any of the listed crossings that lies on the field.

    Parameters
    ----------
    heights : (planes, rows, columns) float32 array
        Turned heights, centred.
    own : (m, n) float32 array
        Heights of the receivers.
    edges, weight, distance
        As `faces.Ray` has them.
    step : float
        Metres per column.
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    out : (m, n) float32 array
        Tangents of the horizons so far, changed in place.
    """
    rows, columns = heights.shape[1:]
    top = heights[0].max()
    for i in nb.prange(own.shape[0]):
        # Blocks of receivers: their horizons stay in the cache, and each stops as soon as it can
        for j0 in range(0, own.shape[1], BLOCK):
            best = out[i, j0 : j0 + BLOCK]
            mine = own[i, j0 : j0 + BLOCK]
            for n in range(len(distance)):
                ra, ca, rb, cb = i + edges[n, 1], j0 + edges[n, 2], i + edges[n, 4], j0 + edges[n, 5]
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
                a, b = heights[edges[n, 0], ra, ca : ca + count], heights[edges[n, 3], rb, cb : cb + count]
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
        offset, weight, distance = crossings(d.slope, d.diagonal, columns)
        edges = np.zeros((len(offset), 6), dtype=np.int32)
        edges[:, [1, 2, 4, 5]] = offset
        steepest(heights[None], heights, edges, weight, distance, d.step, curve, out)
    return out
