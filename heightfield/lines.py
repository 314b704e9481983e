"""Parallel lines across the grid in one direction, one sample a column, and the grid points they stand for (§3).

Line ``m`` runs along ``y = m + slope · x`` over the turned grid (see `sweep`). Its sample in column ``x`` lies on the edge
between two rows and takes the surface's height there. Every grid point belongs to exactly one line: the one that passes
within half a row of it, whose sample stands in for the point. That is exact where slope is 0 or 1, and elsewhere moves
the point by at most half a row along its column.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .lanes import LANES

NOWHERE = np.float32(-np.inf)  # height of a sample beyond the border


def first_line(slope: float, columns: int) -> int:
    """Return the number of the first line that has a grid point; the last one is ``rows - 1``."""
    return -int(np.floor(slope * (columns - 1) + 0.5))


@nb.njit(cache=True, inline="always")
def row_of(line, slope, column):
    """Return the row of the grid point that a line stands for in a column; it may lie beyond the border."""
    return int(np.floor(line + slope * column + 0.5))


@nb.njit(cache=True, inline="always")
def sample(heights, line, slope, column):
    """Return the surface's height on a line in a column, `NOWHERE` beyond the border."""
    rows = heights.shape[0]
    i = row_of(line, slope, column)
    if i < 0 or i >= rows:
        return NOWHERE
    # Lines of border points may run half a row outside
    y = min(max(line + slope * column, 0.0), rows - 1.0)
    r = int(y)
    f = y - r
    if f < 1e-9 or r + 1 >= rows:
        return heights[r, column]
    if f > 1 - 1e-9:
        return heights[r + 1, column]
    return np.float32(heights[r, column] + f * (np.float64(heights[r + 1, column]) - heights[r, column]))


@nb.njit(cache=True)
def span(first, lines, slope, rows, columns):
    """Return the first and the last column (excluded) where any of ``lines`` lines from ``first`` has a grid point."""
    a, b = 0, columns
    while a < b and row_of(first + lines - 1, slope, a) < 0:
        a += 1
    while b > a and row_of(first, slope, b - 1) >= rows:
        b -= 1
    return a, b


@nb.njit(cache=True)
def panel(heights, first, slope, start, end, bend, out):
    """Lay sixteen lines side by side: ``out[k, lane]`` is line ``first + lane`` in column ``start + k``.

    ``bend`` is how far the surface falls away over one column, for the Earth's curvature: ``bend · k²`` is subtracted. With
    one datum a line, that turns every sight line of a receiver by the same slope and changes no order.
    """
    for x in range(start, end):
        k = x - start
        fall = bend * k * k
        for lane in range(LANES):
            out[k, lane] = np.float32(sample(heights, first + lane, slope, x) - fall)
