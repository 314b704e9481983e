"""Parallel lines across the grid in one direction, one sample a column, and the grid points they stand for (§3).

Line ``m`` runs along ``y = m + slope · x`` over the turned grid (see `sweep`). Its sample in column ``x`` lies on the edge
between two rows and takes the surface's height there. Every grid point belongs to exactly one line: the one that passes
within half a row of it, whose sample stands in for the point. That is exact where slope is 0 or 1, and elsewhere moves
the point by at most half a row along its column.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .lanes import LANES, between
from .sweep import copy

NOWHERE = np.float32(-np.inf)  # height of a sample beyond the border


def first_line(slope: float, columns: int) -> int:
    """Return the number of the first line that has a grid point; the last one is ``rows - 1``."""
    return -int(np.floor(slope * (columns - 1) + 0.5))


@nb.njit(cache=True, inline="always")
def row_of(line, slope, column):
    """Return the row of the grid point that a line stands for in a column; it may lie beyond the border."""
    return line + int(np.floor(slope * column + 0.5))


@nb.njit(cache=True)
def span(first, lines, slope, rows, columns):
    """Return the first and the last column (excluded) where any of ``lines`` lines from ``first`` has a grid point."""
    a, b = 0, columns
    while a < b and row_of(first + lines - 1, slope, a) < 0:
        a += 1
    while b > a and row_of(first, slope, b - 1) >= rows:
        b -= 1
    return a, b


@nb.njit(cache=True, inline="always")
def points(first, slope, column, rows):
    """Return the row of the first of sixteen lines' grid points in a column, and which lanes (from, to) lie on the field."""
    i = row_of(first, slope, column)
    return i, min(max(-i, 0), LANES), max(min(rows - i, LANES), 0)


def lay(heights, d) -> np.ndarray:
    """Lay (rows, columns) heights, north up, for `panel`: columns first, the rows at the border once more beyond it."""
    grid = d.lay(heights)
    out = np.empty((grid.shape[0], grid.shape[1] + 2), np.float32)
    copy(grid, out[:, 1:-1])
    out[:, 0], out[:, -1] = out[:, 1], out[:, -2]
    return out


@nb.njit(cache=True)
def panel(laid, first, slope, start, end, bend, out):
    """Lay sixteen lines side by side: ``out[k, lane]`` is line ``first + lane`` in column ``start + k``.

    Parameters
    ----------
    laid : (columns, rows + 2) float32 array
        As `lay` returns it.
    bend : float
        How far the surface falls away over one column, for the Earth's curvature: ``bend · k²`` is subtracted. With one datum
        a line, that turns every sight line of a receiver by the same slope and changes no order.
    """
    rows, flat = laid.shape[1] - 2, laid.reshape(-1)
    for x in range(start, end):
        k = x - start
        fall = bend * k * k
        # All lanes lie alike between their rows; whole rows are told apart from what rounding makes of them
        shift = slope * x
        r = np.floor(shift + 1e-9)
        f = max(shift - r, 0.0)
        f = 0.0 if f < 1e-9 else f
        begin = first + int(r) + 1
        _, a, b = points(first, slope, x, rows)
        if b - a == LANES:
            # On the field in all lanes
            between(flat, x * (rows + 2) + begin, f, fall, out, k)
            continue
        line = out[k]
        line[:] = NOWHERE
        near, far = laid[x, max(begin, 0) :], laid[x, max(begin + 1, 0) :]
        skip, ahead = min(begin, 0), min(begin + 1, 0)
        for lane in range(a, b):
            h = np.float64(near[lane + skip])
            line[lane] = np.float32(h + f * (np.float64(far[lane + ahead]) - h) - fall)
