"""The surface's triangles as senders and receivers of light: how they lie on a grid that is turned to look along +x.

What a triangle sends is known at its three corners and straight between them. Corners of all triangles are grid points, from
which rays meet edges at the same offsets: a grid point's rays serve the six triangles that meet there, each with its own
normal. With supersampling each cell is cut into S × S cells of the same surface. A receiver stands on the triangles that meet
there: of those it sees the spot where it stands, and what they send from it may be known apart, sharp shadows and all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba as nb
import numpy as np

from . import march
from .surface import refine
from .sweep import Direction, packed

THIRD = 1 / 3
# Centroids (row, column) in the cell of the triangle south-west of the diagonal, and of the one north-east of it
CENTROIDS = ((2 * THIRD, THIRD), (THIRD, 2 * THIRD))
# Triangles that meet at a grid point: kind, and which row and column of the triangle's cell the point has
MEETING = ((0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 1, 0))
# Corners (row, column in the cell) between which a kind of triangle's edges run eastwards and southwards
EDGES = (((1, 0), (1, 1), (0, 0), (1, 0)), ((0, 0), (0, 1), (0, 1), (1, 1)))
ASIDE = 1e-6  # cells; of a ray along an edge, the side to look at


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


def triangle_normals(heights: np.ndarray, spacing: tuple[float, float], s: int) -> np.ndarray:
    """Return the unit normals of the triangles of (rows, columns) heights, in cells cut ``s`` times a side.

    Returns
    -------
    (3, 2, s · (rows − 1), s · (columns − 1)) float32 array
        Triangles south-west of their cells' diagonals, then north-east.
    """
    z, (dy, dx) = refine(heights, s), (v / s for v in spacing)
    east, south = np.diff(z, axis=1) / dx, np.diff(z, axis=0) / dy
    # South-west triangles have their cells' southern and western edges, the others the northern and eastern
    n = np.stack([np.stack([-east[1:], -east[:-1]]), np.stack([south[:, :-1], south[:, 1:]]), np.ones((2, *east[1:].shape))])
    return (n / np.linalg.norm(n, axis=0)).astype(np.float32)


def corners(values: np.ndarray) -> np.ndarray:
    """Return what triangles have at their corners, from what grid points have for each triangle that meets there.

    From (..., 6, n + 1, m + 1), in the order of `MEETING`, to (..., 2, 3, n, m): the corners are the north-western, the one
    that is this triangle's alone, and the south-eastern.
    """
    n, m = (size - 1 for size in values.shape[-2:])
    out = np.empty((*values.shape[:-3], 2, 3, n, m), values.dtype)
    for q, (kind, v, u) in enumerate(MEETING):
        out[..., kind, v + u, :, :] = values[..., q, v : v + n, u : u + m]
    return out


def meeting(values: np.ndarray) -> np.ndarray:
    """Return the values of the triangles that meet at grid points, 0 for none: (..., 2, n, m) to (..., 6, n + 1, m + 1)."""
    n, m = values.shape[-2:]
    out = np.zeros((*values.shape[:-3], len(MEETING), n + 1, m + 1), values.dtype)
    for q, (kind, v, u) in enumerate(MEETING):
        out[..., q, v : v + n, u : u + m] = values[..., kind, :, :]
    return out


def cornered(values: np.ndarray) -> np.ndarray:
    """Return grid points' values at triangles' corners: (..., n + 1, m + 1) to (..., 2, 3, n, m)."""
    n, m = (size - 1 for size in values.shape[-2:])
    out = np.empty((*values.shape[:-2], 2, 3, n, m), values.dtype)
    for kind, v, u in MEETING:
        out[..., kind, v + u, :, :] = values[..., v : v + n, u : u + m]
    return out


def cut(values: np.ndarray, s: int) -> np.ndarray:
    """Return triangles' values at the corners of the parts of cells cut ``s`` times a side: (..., 2, 3, s · n, s · m)."""
    if s == 1:
        return values
    *lead, n, m = values.shape
    out = np.empty((*lead, s * n, s * m), values.dtype)
    for i, j, kind in np.ndindex(s, s, 2):
        # Parts on the diagonal are cut by it as their cell is
        nw, own, se = np.moveaxis(values[..., kind if i == j else int(j > i), :, :, :], -3, 0)
        for corner, (v, u) in enumerate(((0, 0), (1 - kind, kind), (1, 1))):
            v, u = (i + v) / s, (j + u) / s
            part = np.float32(1 - max(v, u)) * nw + np.float32(abs(v - u)) * own + np.float32(min(v, u)) * se
            out[..., kind, corner, i::s, j::s] = part
    return out


def joined(values: np.ndarray, s: int) -> np.ndarray:
    """Undo `cut`: return what triangles have at their corners by the straight fit to the means over their parts."""
    if s == 1:
        return values
    means = values.mean(axis=-3)
    out = np.zeros((*values.shape[:-2], *(size // s for size in values.shape[-2:])), values.dtype)
    for kind in (0, 1):
        for (v, u), weights in zip(spots(kind, s), fit(kind, s).T, strict=True):
            i, j = int(s * v), int(s * u)
            part = means[..., int(s * v - i < s * u - j), i::s, j::s]
            for corner, weight in enumerate(weights):
                out[..., kind, corner, :, :] += np.float32(weight) * part
    return out


def outer(values: np.ndarray, s: int) -> np.ndarray:
    """Return a copy of what parts of cells cut ``s`` times a side have at whole triangles' corners: (..., 2, 3, n, m)."""
    out = np.empty((*values.shape[:-2], *(size // s for size in values.shape[-2:])), values.dtype)
    for kind in (0, 1):
        for corner, (i, j) in enumerate(((0, 0), (1 - kind, kind), (1, 1))):
            out[..., kind, corner, :, :] = values[..., kind, corner, i * (s - 1) :: s, j * (s - 1) :: s]
    return out


def spots(kind: int, n: int) -> list[tuple[float, float]]:
    """Return rows and columns, in the cell, of the centroids of the n² like parts of a triangle of a kind."""
    parts = ((a, b, c) for a in range(n) for b in range(n) for c in CENTROIDS)
    found = (((a + v) / n, (b + u) / n) for a, b, (v, u) in parts)
    return [(v, u) for v, u in found if (v < u) == kind]


def inside(values: np.ndarray, kind: int, v: float, u: float) -> np.ndarray:
    """Return values, straight between (rows, columns) samples, at a spot in every triangle of a kind."""
    nw, se = values[:-1, :-1], values[1:, 1:]
    return (1 - max(v, u)) * nw + abs(v - u) * (values[:-1, 1:] if kind else values[1:, :-1]) + min(v, u) * se


def fit(kind: int, n: int) -> np.ndarray:
    """Return the weights (3, n²) with which values at the `spots` of a kind give the corners of the straight fit to them."""
    return np.linalg.pinv(np.array([[1 - max(v, u), abs(v - u), min(v, u)] for v, u in spots(kind, n)]))


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


def bordered(parts: np.ndarray, s: int, flipped: bool, out: np.ndarray) -> None:
    """Give triangles a row before the first and one behind the last: rays along the border see the one triangle there.

    Parameters
    ----------
    parts : (channels · 6 · s², n, m) array
        Planes of the three corners of the triangles south-west of the diagonals, then of the others.
    s : int
        Cells into which a cell is cut, a side.
    flipped : bool
        Whether the first row was the last one.
    out : (channels, 6 · s², n, m + 1 + `march.BLOCK`) array
        Zeros, to be filled in but for those behind; as wide as `planes` makes the samples, so that one place means the same
        cell in both.
    """
    _, columns, rows = parts.shape
    out = out.reshape(len(out), 2, 3, s, s, columns, -1)
    out[..., 1 : rows + 1] = parts.reshape(-1, 2, 3, s, s, columns, rows)
    # Across an edge lies a triangle of the other kind, whose last two corners are the first two of this one, or vice versa
    here, there = (slice(0, 2), slice(1, 3)) if flipped else (slice(1, 3), slice(0, 2))
    out[:, :, here, :, s - 1, :, 0] = out[:, ::-1, there, :, 0, :, 1]
    out[:, :, there, :, 0, :, rows + 1] = out[:, ::-1, here, :, s - 1, :, rows]


def placed(d: Direction, s: int, plane: int, v: float, u: float) -> tuple[float, float]:
    """Row and column, in its turned cell, of what lies at row ``v`` and column ``u`` of a fine cell dealt to a plane."""
    if d.transpose:
        v, u = u, v
    v, u = (1 - v if d.flip_rows else v), (1 - u if d.flip_columns else u)
    return (plane % s + v) / s, (plane // s + u) / s


class Facets(NamedTuple):
    """Triangles that meet receivers which lie alike in their cells.

    Attributes
    ----------
    edges : (f, 4, 3) int64 array
        Plane, row and column, from the receiver's cell, of the ends of each one's edge eastwards and of that southwards.
    per_east, per_south : float32
        Inverse lengths of the edges, 1/m.
    """

    edges: np.ndarray
    per_east: np.float32
    per_south: np.float32


def facets(d: Direction, s: int, plane: int, spacing: tuple[float, float]) -> Facets:
    """Return the triangles that meet at the grid points dealt to a plane, in the order of `MEETING`."""
    edges = np.empty((len(MEETING), 4, 3), np.int64)
    for q, (kind, v, u) in enumerate(MEETING):
        for k, (r, c) in enumerate(EDGES[kind]):
            r, c = (c - u, r - v) if d.transpose else (r - v, c - u)
            r, c = plane % s + (-r if d.flip_rows else r), plane // s + (-c if d.flip_columns else c)
            edges[q, k] = (c % s) * s + r % s, r // s, c // s
    dy, dx = spacing
    return Facets(edges, np.float32(s / dx), np.float32(s / dy))


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
    corners : (n, 4, 3) int32 array
        Of the triangle before each crossing, at the ends of the edge over which the ray enters it and of the one over which
        it leaves: (3 · kind + corner) · S² + plane, row and column from the receiver's cell. That from which the first one
        leaves, the receiver's place, may be 6 · S² + 3 · kind + corner instead.
    """

    edges: np.ndarray
    weight: np.ndarray
    distance: np.ndarray
    corners: np.ndarray


def along_edge(d: Direction, y: float, x: float) -> bool:
    """Whether a ray runs along edges of the grid, with one triangle to its left and another to its right."""
    whole = y if d.slope == 0 else y - x
    return (d.slope == 0 or (d.slope == 1 and d.diagonal)) and abs(whole - round(whole)) < march.NEARBY


def ray(d: Direction, columns: float, s: int, y: float = 0.0, x: float = 0.0, side: float = 1.0, apart=False) -> Ray:
    """Follow a ray from row ``y`` and column ``x`` of a cell, for ``columns`` columns of a grid cut ``s`` times.

    ``side`` says on which side to look where the ray runs along an edge, ``apart`` whether what triangles send from where
    receivers stand is known apart (of receivers on grid points).
    """
    offset, weight, distance = march.crossings(d.slope, d.diagonal, s * columns, s * y, s * x)
    aside = side * ASIDE * along_edge(d, s * y, s * x)
    how = d.flip_rows, d.flip_columns, d.transpose, apart
    edges, corners = _followed(offset, distance, d.slope, s, s * y + aside, s * x, *how)
    return Ray(edges, weight, distance / s, corners)


@nb.njit(cache=True)
def _followed(offset, distance, slope, s, y, x, flip_rows, flip_columns, transpose, apart):
    # Edges dealt out to planes, and corners of the triangle before each
    edges, corners = np.empty((len(offset), 6), np.int32), np.empty((len(offset), 4, 3), np.int32)
    before = 0.0
    for n in range(len(offset)):
        for end in range(2):
            r, c = offset[n, 2 * end], offset[n, 2 * end + 1]
            edges[n, 3 * end], edges[n, 3 * end + 1], edges[n, 3 * end + 2] = (c % s) * s + r % s, r // s, c // s
        middle = (before + distance[n]) / 2
        before = distance[n]
        v, u = y + slope * middle, x + middle
        row, column = int(np.floor(v)), int(np.floor(u))
        v, u = v - row, u - column
        # Back in the cell as it lies north up
        v, u = (1 - v if flip_rows else v), (1 - u if flip_columns else u)
        v, u = (u, v) if transpose else (v, u)
        kind = 0 if v > u else 1
        plane = (column % s) * s + row % s
        for k in range(4):
            # The ray enters its first triangle at the receiver
            m = n - 1 + k // 2
            r, c = (offset[m, 2 * (k % 2)], offset[m, 2 * (k % 2) + 1]) if m >= 0 else (round(y), round(x))
            # An end that is no corner has no weight: the ray passes through the other
            r, c = min(max(r - row, 0), 1), min(max(c - column, 0), 1)
            corner = (1 - r if flip_rows else r) + (1 - c if flip_columns else c)
            corners[n, k, 0], corners[n, k, 1], corners[n, k, 2] = (3 * kind + corner) * s * s + plane, row // s, column // s
            if apart and m < 0:
                corners[n, k, 0] = 6 * s * s + 3 * kind + corner
    return edges, corners
