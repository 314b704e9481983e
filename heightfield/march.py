"""The naive method (§1): march outwards from every point, one column at a time; baseline and oracle.

All receivers of a direction see the crossings at the same offsets with the same weights, so a step is one vector operation
over a row of receivers, which compilers turn into SIMD. Every crossing of the ray with an edge of the triangulation is
visited: the result is exact on the stated surface.
"""

from __future__ import annotations

import numba as nb
import numpy as np

BLOCK = 64  # receivers marched together
ABYSS = -1e30  # m; seen from nowhere
NEARBY = 1e-9  # columns; nearer to a sample, a ray runs through it


@nb.njit(cache=True)
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
    most = int(4 * columns) + 8
    offset, weight, distance = np.empty((most, 4), np.int32), np.empty(most), np.empty(most)
    # Diagonals: y − x, or y + x, is a whole number on them
    speed, start = (slope - 1, y - x) if diagonal else (slope + 1, y + x)
    column, row = np.floor(x + NEARBY) + 1, np.floor(y + NEARBY) + 1
    cut = np.ceil(start - NEARBY) - 1 if diagonal else np.floor(start + NEARBY) + 1
    n = 0
    while True:
        t = column - x
        t_row = (row - y) / slope if slope > 0 else np.inf
        t_cut = (cut - start) / speed if speed != 0 else np.inf
        if min(t, t_row, t_cut) > columns + NEARBY:
            return offset[:n], weight[:n], distance[:n]
        if t <= t_row and t <= t_cut:
            # Columns are always listed, and stand for all others where the ray meets a sample
            r = np.floor(y + slope * t + NEARBY)
            w = y + slope * t - r
            w = 0.0 if w < NEARBY else w
            offset[n, 0], offset[n, 1], offset[n, 2], offset[n, 3] = r, column, r + (w > 0), column
            column += 1
        else:
            t = min(t_row, t_cut)
            c = np.floor(x + t)
            w = x + t - c
            if t_row <= t_cut:
                offset[n, 0], offset[n, 1], offset[n, 2], offset[n, 3] = row, c, row, c + 1
                row += 1
            else:
                r = np.floor(y + slope * t)
                offset[n, 0], offset[n, 1], offset[n, 2], offset[n, 3] = r + (not diagonal), c, r + diagonal, c + 1
                cut += -1 if diagonal else 1
            if not NEARBY < w < 1 - NEARBY or t <= NEARBY:
                continue
        weight[n], distance[n] = w, t
        n += 1


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def steepest(heights, own, edges, weight, distance, step, curve, out):
    """Raise ``out`` to the steepest rise towards any of the listed crossings that lies on the field.

    Parameters
    ----------
    heights : (planes, rows, columns + BLOCK) float32 array
        Turned heights, centred, with `ABYSS` beyond the border.
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

    Returns
    -------
    int
        Crossings looked at, over all receivers.
    """
    rows, columns = heights.shape[1], heights.shape[2] - BLOCK
    top, looked = heights[0].max(), 0
    for i in nb.prange(own.shape[0]):
        # Blocks of receivers: their horizons stay in the cache, and each stops as soon as it can
        for j0 in range(0, own.shape[1], BLOCK):
            size = min(BLOCK, own.shape[1] - j0)
            # Beyond the row's end nobody sees anything
            best = np.full(BLOCK, np.inf, np.float32)
            mine = np.zeros(BLOCK, np.float32)
            best[:size], mine[:size] = out[i, j0 : j0 + size], own[i, j0 : j0 + size]
            for n in range(len(distance)):
                ra, ca, rb, cb = i + edges[n, 1], j0 + edges[n, 2], i + edges[n, 4], j0 + edges[n, 5]
                if ra >= rows or rb >= rows or ca >= columns or cb >= columns:
                    break
                w = np.float32(weight[n])
                scale = np.float32(1.0 / (distance[n] * step))
                drop = np.float32(curve * distance[n] * step)
                if n % 16 == 15:
                    # Nothing beyond can rise above anybody's horizon
                    more = False
                    for j in range(BLOCK):
                        more |= (top - mine[j]) * scale - drop > best[j]
                    if not more:
                        break
                looked += min(size, columns - max(ca, cb))
                a, b = heights[edges[n, 0], ra, ca : ca + BLOCK], heights[edges[n, 3], rb, cb : cb + BLOCK]
                for j in range(BLOCK):
                    rise = (a[j] + w * (b[j] - a[j]) - mine[j]) * scale - drop
                    best[j] = max(best[j], rise)
            out[i, j0 : j0 + size] = best[:size]
    return looked


def crossed(edges, receivers: tuple[int, int], rows: int, columns: int) -> int:
    """Count the crossings that lie on the field: what the naive method looks at, from receivers at every row and column."""
    below = np.minimum(receivers[0], rows - np.maximum(edges[:, 1], edges[:, 4]))
    right = np.minimum(receivers[1], columns - np.maximum(edges[:, 2], edges[:, 5]))
    return int((np.maximum(below, 0).astype(np.int64) * np.maximum(right, 0)).sum())


def naive(d, shape: tuple[int, int], reach: float | None = None) -> int:
    """Count what the naive method looks at in one direction, from every point of a turned grid."""
    return crossed(edges(d, shape[1] - 1, reach)[0], shape, *shape)


def edges(d, columns: int, reach: float | None = None):
    """Return the crossings of the rays from grid points, as `faces.Ray` has them: edges, weight, distance.

    They go on for ``columns`` columns, or to ``reach`` columns if that is nearer.
    """
    offset, weight, distance = crossings(d.slope, d.diagonal, float(columns if reach is None else min(reach, columns)))
    edges = np.zeros((len(offset), 6), dtype=np.int32)
    edges[:, [1, 2, 4, 5]] = offset
    return edges, weight, distance


def padded(heights: np.ndarray) -> np.ndarray:
    """Return (rows, columns) heights with `BLOCK` columns beyond the border that are seen from nowhere."""
    rows, columns = heights.shape
    out = np.full((rows, columns + BLOCK), ABYSS, dtype=np.float32)
    out[:, :columns] = heights
    return out


def horizons(heights, d, curve: float = 0.0, reach: float | None = None, tally=None) -> np.ndarray:
    """Tangent of the horizon of every grid point along +x, by marching.

    Parameters
    ----------
    heights : (rows, columns) float32 array
        Turned heights, centred.
    d : sweep.Direction
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    reach : float, optional
        Columns to look; to the border by default.
    tally : list of int, optional
        What was looked at is appended.

    Returns
    -------
    (rows, columns) float32 array
        −inf where nothing of the field lies in the direction.
    """
    heights = np.ascontiguousarray(heights, dtype=np.float32)
    ahead = edges(d, heights.shape[1] - 1, reach)
    out = np.full(heights.shape, -np.inf, dtype=np.float32)
    if len(ahead[0]):
        looked = steepest(padded(heights)[None], heights, *ahead, d.step, curve, out)
        if tally is not None:
            tally.append(looked)
    return out
