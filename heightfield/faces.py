"""The surface's triangles as senders and receivers of light: how they lie on a grid that is turned to look along +x.

Between two neighbouring crossings a ray runs over one triangle, so light known for each triangle needs no interpolation along
the ray. All triangles of one kind lie alike in their cells: rays from their centroids meet edges at the same offsets, and are
marched together, as those from grid points are. With supersampling each cell is cut into S × S cells of the same surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np

from . import march
from .surface import refine
from .sweep import Direction, packed

THIRD = 1 / 3
# Centroids (row, column) in the cell of the triangle south-west of the diagonal, and of the one north-east of it
CENTROIDS = ((2 * THIRD, THIRD), (THIRD, 2 * THIRD))
ASIDE = 1e-6  # cells; of a ray along an edge, the side to look at


@dataclass(frozen=True)
class Faces:
    """Values of every triangle of a field.

    Attributes
    ----------
    heights : (2, S · (rows − 1), S · (columns − 1)) float32 array
        Of the centroids: triangles south-west of their cells' diagonals, then north-east.
    normals : (3, 2, ...) float32 array
        Unit normals.
    supersampling : int
        Cells into which a cell is cut, a side.
    """

    heights: np.ndarray
    normals: np.ndarray
    supersampling: int


def mean(values: np.ndarray, s: int) -> np.ndarray:
    """Return the means over the triangles of values that are straight between grid points.

    Parameters
    ----------
    values : (rows, columns) array
    s : int
        Cells into which a cell is cut, a side.

    Returns
    -------
    (2, s · (rows − 1), s · (columns − 1)) float64 array
    """
    fine = refine(values, s)
    both = fine[:-1, :-1] + fine[1:, 1:]
    return np.stack([both + fine[1:, :-1], both + fine[:-1, 1:]]) / 3


def faces_of(heights: np.ndarray, spacing: tuple[float, float], s: int) -> Faces:
    """Return the triangles of (rows, columns) heights, metres ``spacing`` apart, in cells cut ``s`` times a side."""
    z, (dy, dx) = refine(heights, s), (v / s for v in spacing)
    east, south = np.diff(z, axis=1) / dx, np.diff(z, axis=0) / dy
    # South-west triangles have their cells' southern and western edges, the others the northern and eastern
    n = np.stack([np.stack([-east[1:], -east[:-1]]), np.stack([south[:, :-1], south[:, 1:]]), np.ones((2, *east[1:].shape))])
    n /= np.linalg.norm(n, axis=0)
    return Faces(mean(heights, s).astype(np.float32), n.astype(np.float32), s)


def places(heights: np.ndarray, s: int) -> np.ndarray:
    """Return rows, columns and heights of the triangles' centroids, (3, 2, ...) float64, for (rows, columns) heights."""
    z = mean(heights, s)
    y, x = np.indices(z.shape[1:])
    return np.stack([np.stack([(y + v) / s, (x + u) / s, z[k]]) for k, (v, u) in enumerate(CENTROIDS)], axis=1)


# --- On a grid turned to look along +x --------------------------------------------------------------------------------


def planes(grid: np.ndarray, s: int, fill: float | None = None) -> np.ndarray:
    """Deal a fine grid out to ``s`` × ``s`` coarse ones, so that what all receivers look at lies side by side.

    Parameters
    ----------
    grid : (s · n, s · m) or (s · n + 1, s · m + 1) array
        Cells, or samples, as `Direction.lay` lays them: columns first.
    fill : float, optional
        Put `march.BLOCK` rows of this number beyond the border.

    Returns
    -------
    (s², n, m) or (s², n + 1, m + 1) array
        With ``fill`` where a sample between two grid points has none beyond the border, and m by `march.BLOCK` greater.
    """
    if fill is None and s == 1:
        return packed(grid)[None]
    columns, rows = -(-grid.shape[0] // s), -(-grid.shape[1] // s)
    out = np.full((s * s, columns, rows + (0 if fill is None else march.BLOCK)), 0 if fill is None else fill, grid.dtype)
    for a in range(s):
        for b in range(s):
            part = packed(grid[a::s, b::s])
            out[a * s + b, : part.shape[0], : part.shape[1]] = part
    return out


def undeal(parts: np.ndarray, s: int) -> np.ndarray:
    """Undo `planes` for cells: (s², n, m) to (s · n, s · m)."""
    _, columns, rows = parts.shape
    return parts.reshape(s, s, columns, rows).transpose(2, 0, 3, 1).reshape(s * columns, s * rows)


def bordered(parts: np.ndarray, s: int) -> np.ndarray:
    """Give triangles a row before the first and one behind the last: rays along the border see the one triangle there.

    Parameters
    ----------
    parts : (2 · s², n, m) array
        Planes of the triangles south-west of the diagonals, then of the others.

    Returns
    -------
    (2 · s², n, m + 1 + `march.BLOCK`) array
        0 behind; as wide as `planes` makes the samples, so that one place means the same cell in both.
    """
    _, columns, rows = parts.shape
    out = np.zeros((2, s, s, columns, rows + 1 + march.BLOCK), parts.dtype)
    out[..., 1 : rows + 1] = parts.reshape(2, s, s, columns, rows)
    out[:, :, s - 1, :, 0] = out[::-1, :, 0, :, 1]
    out[:, :, 0, :, rows + 1] = out[::-1, :, s - 1, :, rows]
    return out.reshape(2 * s * s, columns, -1)


def centroid(d: Direction, kind: int) -> tuple[float, float]:
    """Row and column, in its turned cell, of a kind of triangle's centroid."""
    v, u = CENTROIDS[kind]
    if d.transpose:
        v, u = u, v
    return (1 - v if d.flip_rows else v), (1 - u if d.flip_columns else u)


@dataclass(frozen=True)
class Ray:
    """What rays of one direction meet, from all receivers that lie alike in their cells.

    Attributes
    ----------
    edges : (n, 6) int32 array
        Crossings: plane, row and column (from the receiver's cell) of the edge's two ends.
    weight : (n,) float64 array
        Of the second end.
    distance : (n,) float64 array
        In columns of the grid, from the receiver.
    triangles : (n, 3) int32 array
        The triangle before each crossing: kind · S² + plane, row and column from the receiver's cell.
    """

    edges: np.ndarray
    weight: np.ndarray
    distance: np.ndarray
    triangles: np.ndarray


def along_edge(d: Direction, y: float, x: float) -> bool:
    """Whether a ray runs along edges of the grid, with one triangle to its left and another to its right."""
    whole = y if d.slope == 0 else y - x
    return (d.slope == 0 or (d.slope == 1 and d.diagonal)) and abs(whole - round(whole)) < march.NEARBY


def ray(d: Direction, columns: int, s: int, y: float = 0.0, x: float = 0.0, side: float = 1.0) -> Ray:
    """Follow a ray from row ``y`` and column ``x`` of a cell, for ``columns`` columns of a grid cut ``s`` times.

    ``side`` says on which side to look where the ray runs along an edge.
    """
    offset, weight, distance = march.crossings(d.slope, d.diagonal, s * columns, s * y, s * x)
    aside = side * ASIDE * along_edge(d, s * y, s * x)
    edges, triangles = _followed(offset, distance, d.slope, s, s * y + aside, s * x, d.flip_rows, d.flip_columns, d.transpose)
    return Ray(edges, weight, distance / s, triangles)


@nb.njit(cache=True)
def _followed(offset, distance, slope, s, y, x, flip_rows, flip_columns, transpose):
    # Edges dealt out to planes, and the triangle before each
    edges, triangles = np.empty((len(offset), 6), np.int32), np.empty((len(offset), 3), np.int32)
    before = 0.0
    for n in range(len(offset)):
        for end in range(2):
            r, c = offset[n, 2 * end], offset[n, 2 * end + 1]
            edges[n, 3 * end], edges[n, 3 * end + 1], edges[n, 3 * end + 2] = (c % s) * s + r % s, r // s, c // s
        middle = (before + distance[n]) / 2
        before = distance[n]
        v, u = y + slope * middle, x + middle
        r, c = int(np.floor(v)), int(np.floor(u))
        v, u = v - r, u - c
        # Back in the cell as it lies north up
        v, u = (1 - v if flip_rows else v), (1 - u if flip_columns else u)
        v, u = (u, v) if transpose else (v, u)
        kind = 0 if v > u else 1
        triangles[n, 0], triangles[n, 1], triangles[n, 2] = (kind * s + c % s) * s + r % s, r // s, c // s
    return edges, triangles
