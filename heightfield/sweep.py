"""Directions over the grid, turned so that every sweep looks along +x.

The surface is the triangulated grid: vertices at the samples, every cell cut by the diagonal from its north-west to its
south-east corner (`surface.py` builds the same mesh). Along any straight line it is piecewise linear with kinks only where
the line crosses an edge: a grid column, a grid row or a diagonal. So the highest elevation along the line is at one of
those crossings, and looking at them alone is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np

from ..errors import InputError
from .check import number, reals, shown

TILE = 8  # samples a side, copied together
MOST = 1_000_000  # azimuths


@dataclass(frozen=True)
class Direction:
    """An azimuth as seen on a grid turned to look along +x.

    Attributes
    ----------
    slope : float
        Rows crossed per column, in [-1, 1].
    step : float
        Horizontal distance per column, in metres.
    diagonal : bool
        True where diagonals of the turned grid run from (row, column) to (row + 1, column + 1).
    transpose, flip_rows, flip_columns : bool
        How the grid is turned: transposed first, then flipped.
    """

    slope: float
    step: float
    diagonal: bool
    transpose: bool
    flip_rows: bool
    flip_columns: bool

    def turn(self, grid: np.ndarray) -> np.ndarray:
        """Return a view of a north-up grid as this direction sees it (last axes rows, columns)."""
        if self.transpose:
            grid = np.swapaxes(grid, -1, -2)
        return grid[..., :: -1 if self.flip_rows else 1, :: -1 if self.flip_columns else 1]

    def back(self, grid: np.ndarray) -> np.ndarray:
        """Undo `turn`."""
        grid = grid[..., :: -1 if self.flip_rows else 1, :: -1 if self.flip_columns else 1]
        return np.swapaxes(grid, -1, -2) if self.transpose else grid

    def lay(self, grid: np.ndarray) -> np.ndarray:
        """Return a view as `turn` does with columns first: rays from neighbouring rows lie side by side."""
        return np.swapaxes(self.turn(grid), -1, -2)

    def lift(self, grid: np.ndarray) -> np.ndarray:
        """Undo `lay`."""
        return self.back(np.swapaxes(grid, -1, -2))


@nb.njit(cache=True)
def _tile_row(grid, t, out):
    # By tiles: a transposed row touches a cache line a sample
    rows, columns = grid.shape
    for c in range(0, columns, TILE):
        for i in range(t * TILE, min((t + 1) * TILE, rows)):
            for j in range(c, min(c + TILE, columns)):
                out[i, j] = grid[i, j]


@nb.njit(cache=True, parallel=True)
def _tiles(grid, out):
    for t in nb.prange((grid.shape[0] + TILE - 1) // TILE):
        _tile_row(grid, t, out)


@nb.njit(cache=True)
def _row(grid, i, out):
    for j in range(grid.shape[1]):
        out[i, j] = grid[i, j]


@nb.njit(cache=True, parallel=True)
def _rows(grid, out):
    for i in nb.prange(len(grid)):
        _row(grid, i, out)


def copy(grid, out):
    """Copy a two-dimensional view to another."""
    whole = all(abs(view.strides[1]) == view.itemsize for view in (grid, out))
    (_rows if whole else _tiles)(grid, out)


def packed(grid: np.ndarray) -> np.ndarray:
    """Return a contiguous copy of a two-dimensional view, or the view itself if it is contiguous."""
    if abs(grid.strides[1]) == grid.itemsize:
        return np.ascontiguousarray(grid)
    out = np.empty(grid.shape, grid.dtype)
    copy(grid, out)
    return out


@nb.njit(cache=True, error_model="numpy")
def arctan(tangent):
    """Return the angle of a float32 tangent, to 2e-7: the range in thirds, then Cephes' polynomial (atanf)."""
    one, t = np.float32(1), abs(tangent)
    steep, middle = t > np.float32(2.4142135), t > np.float32(0.41421356)
    above = -one if steep else (t - one if middle else t)
    below = t if steep else (t + one if middle else one)
    x = above / below
    z = x * x
    p = np.float32(8.05374449538e-2) * z - np.float32(1.38776856032e-1)
    p = (p * z + np.float32(1.99777106478e-1)) * z - np.float32(3.33329491539e-1)
    e = p * z * x + x + np.float32(np.pi / 2 if steep else (np.pi / 4 if middle else 0))
    return -e if tangent < 0 else e


@nb.njit(cache=True, parallel=True)
def angles(tangents, out):
    """Write the elevations of a two-dimensional view of float32 tangents to a contiguous array, in radians."""
    rows = len(out)
    for t in nb.prange((rows + TILE - 1) // TILE):
        _tile_row(tangents, t, out)
        for i in range(t * TILE, min((t + 1) * TILE, rows)):
            row = out[i]
            for j in range(len(row)):
                row[j] = arctan(row[j])


def direction(azimuth: float, spacing: tuple[float, float]) -> Direction:
    """Turn an azimuth into a direction over the grid.

    Parameters
    ----------
    azimuth : float
        Radians clockwise from north (row 0 is north).
    spacing : (float, float)
        Metres between rows and between columns.

    Returns
    -------
    Direction
    """
    dy, dx = spacing
    # Columns and rows per metre; exact zeros along the axes, where sines leave rounding
    east, north = (0.0 if abs(v) < 1e-15 else v for v in (np.sin(azimuth), np.cos(azimuth)))
    columns, rows = east / dx, -north / dy
    transpose = abs(rows) > abs(columns)
    if transpose:
        columns, rows = rows, columns
    flip = columns < 0
    slope, step = rows / abs(columns), 1.0 / abs(columns)
    if abs(abs(slope) - 1.0) < 1e-12:
        slope = float(np.sign(slope))
    # Looking along falling rows is looking along rising rows of the flipped grid
    flip_rows = slope < 0
    return Direction(abs(slope), step, not (flip != flip_rows), transpose, flip_rows, flip)


def azimuths_of(azimuths, minimum: int = 1) -> np.ndarray:
    """Return azimuths in radians from a count (equally spaced, north first) or an array of them."""
    if isinstance(azimuths, (bool, str)) or azimuths is None:
        raise InputError(f"'azimuths' must be a count or an array of radians (got {shown(azimuths)})")
    values = reals("azimuths", azimuths)
    if values.ndim == 0:
        count = int(number("azimuths", azimuths, minimum, MOST, whole=True))
        return np.arange(count) * (2 * np.pi / count)
    values = values.ravel()
    if not len(values) or not np.isfinite(values).all():
        raise InputError("'azimuths' must hold at least one azimuth, all finite, in radians clockwise from north")
    return values
