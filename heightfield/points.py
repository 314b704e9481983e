"""Single rays over the surface: horizons of chosen points, and what a lamp lights.

A few points, or a different direction for every point, leave nothing to share between rays: each walks over the triangles on
its own, from one crossing of a row, a column or a diagonal to the next, in float64.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ..errors import InputError
from .check import UNKNOWN, listed, number, reals, shown


@nb.njit(cache=True)
def height_at(heights, y, x):
    """Return the surface's height at a fractional row and column on the field (cells cut from north-west to south-east)."""
    rows, columns = heights.shape
    r, c = min(int(y), max(rows - 2, 0)), min(int(x), max(columns - 2, 0))
    f, g = y - r, x - c
    s, e = min(r + 1, rows - 1), min(c + 1, columns - 1)
    corner = heights[r, c]
    if g >= f:
        return corner + g * (heights[r, e] - corner) + f * (heights[s, e] - heights[r, e])
    return corner + f * (heights[s, c] - corner) + g * (heights[s, e] - heights[s, c])


@nb.njit(cache=True)
def next_crossing(position, speed):
    """Return the time until a coordinate that moves at a speed meets the next whole number."""
    if speed > 1e-12:
        return (np.floor(position + 1e-9) + 1 - position) / speed
    if speed < -1e-12:
        return (position - np.ceil(position - 1e-9) + 1) / -speed
    return np.inf


@nb.njit(cache=True)
def crossed(shape, y, x, south, east, limit):
    """Count the rows, columns and diagonals that a ray crosses before it leaves the field or reaches its limit."""
    end = limit
    for position, speed, last in ((y, south, shape[0] - 1), (x, east, shape[1] - 1)):
        if abs(speed) > 1e-12:
            end = min(end, ((last if speed > 0 else 0) - position) / speed)
    count = 0
    for position, speed in ((y, south), (x, east), (x - y, east - south)):
        first = next_crossing(position, speed)
        if first <= end:
            count += 1 + int((end - first) * abs(speed) + 1e-9)
    return count


@nb.njit(cache=True)
def hopeless(top, eye, t, best):
    """Whether no surface up to height ``top`` can rise above tangent ``best`` from distance ``t`` on."""
    return best >= max((top - eye) / t, 0.0)


@nb.njit(cache=True)
def steepest(heights, top, y, x, eye, south, east, limit, curve):
    """Return the steepest rise from a point to the surface along one ray, and how many crossings it took.

    Parameters
    ----------
    heights : (rows, columns) float64 array
    top : float
        The greatest of them: where no height can be seen any more, the walk ends.
    y, x : float
        Row and column of the point, fractional, on the field.
    eye : float
        Its height in metres.
    south, east : float
        Rows and columns per metre.
    limit : float
        Metres to look.
    curve : float
        A point at distance ``d`` metres lies ``curve · d²`` lower.

    Returns
    -------
    tangent : float
        −inf if nothing of the field lies ahead.
    looked : int
    """
    rows, columns = heights.shape
    # Times of the next crossings with rows, columns and diagonals, and the times between two of each
    across = east - south
    tr, tc, td = next_crossing(y, south), next_crossing(x, east), next_crossing(x - y, across)
    dr = 1 / abs(south) if abs(south) > 1e-12 else np.inf
    dc = 1 / abs(east) if abs(east) > 1e-12 else np.inf
    dd = 1 / abs(across) if abs(across) > 1e-12 else np.inf
    best, looked = -np.inf, 0
    while True:
        t = min(tr, tc, td)
        if not t <= limit * (1 + 1e-12) or hopeless(top, eye, t, best):
            return best, looked
        row, column = y + t * south, x + t * east
        if row < -1e-9 or column < -1e-9 or row > rows - 1 + 1e-9 or column > columns - 1 + 1e-9:
            return best, looked
        looked += 1
        h = height_at(heights, min(max(row, 0.0), rows - 1.0), min(max(column, 0.0), columns - 1.0))
        best = max(best, (h - eye) / t - curve * t)
        # Crossings at one place count once
        here = t * (1 + 1e-12)
        if tr <= here:
            tr += dr
        if tc <= here:
            tc += dc
        if td <= here:
            td += dd


@nb.njit(cache=True, parallel=True)
def _horizons(heights, points, south, east, limit, curve, out):
    top, looked, naive = heights.max(), 0, 0
    for p in nb.prange(len(points)):
        y, x = points[p]
        eye = height_at(heights, y, x)
        for k in range(len(south)):
            out[k, p], n = steepest(heights, top, y, x, eye, south[k], east[k], limit, curve)
            looked += n
            naive += crossed(heights.shape, y, x, south[k], east[k], limit)
    return looked, naive


@nb.njit(cache=True, parallel=True)
def _lit(heights, places, x0, y0, z0, dy, dx, curve, out):
    # Whether every receiver sees a lamp at x0 m east and y0 m south of the first sample, z0 m high
    top = heights.max()
    for p in nb.prange(len(places)):
        y, x, z = places[p]
        east, south, up = x0 - x * dx, y0 - y * dy, z0 - z
        d = np.hypot(east, south)
        if d < 1e-9 * min(dy, dx):
            out[p] = up > 0
            continue
        rise, _ = steepest(heights, top, y, x, z, south / d / dy, east / d / dx, d * (1 - 1e-9), curve)
        out[p] = rise < up / d - curve * d


def positions(points, shape: tuple[int, int]) -> np.ndarray:
    """Return receivers as an (n, 2) float64 array of fractional rows and columns, from that or from a mask of the grid."""
    found = reals("points", points)
    if np.asarray(points).dtype.kind == "b":
        if np.shape(points) != shape:
            raise InputError(f"'points' as a mask must be {shape[0]} × {shape[1]} (got shape {np.shape(points)})")
        return np.argwhere(points).astype(np.float64)
    if found.ndim != 2 or found.shape[1] != 2:
        raise InputError(f"'points' must be a mask, or rows and columns of shape (n, 2) (got shape {found.shape})")
    if not ((found >= 0) & (found <= np.array(shape) - 1.0)).all():
        raise InputError(
            f"'points' must lie on the field: rows 0 to {shape[0] - 1}, columns 0 to {shape[1] - 1} "
            f"(got {found.min(axis=0).tolist()} to {found.max(axis=0).tolist()})"
        )
    return np.ascontiguousarray(found)


def tangents(heights, points, azimuths, spacing, radius, curve, tally) -> np.ndarray:
    """Tangents of the horizons of chosen points.

    Parameters
    ----------
    heights : (rows, columns) float64 array
    points : (n, 2) float64 array
        Fractional rows and columns.
    azimuths : (K,) array
        Radians clockwise from north.
    spacing : (float, float)
        Metres between rows and between columns.
    radius : float or None
        Metres to look.
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    tally : Tally
        What was looked at is added.

    Returns
    -------
    (K, n) float64 array
    """
    out = np.empty((len(azimuths), len(points)))
    south, east = -np.cos(azimuths) / spacing[0], np.sin(azimuths) / spacing[1]
    tally.add(*_horizons(heights, points, south, east, np.inf if radius is None else radius, curve, out), out.size)
    return out


def standing(heights, points) -> np.ndarray:
    """Return rows, columns and heights of points on the surface, (3, n), for (n, 2) fractional rows and columns."""
    return np.stack([*points.T, np.array([height_at(heights, y, x) for y, x in points])])


def interpolated(points, valid: np.ndarray, n: np.ndarray | None):
    """Say which points lie between known samples only, and interpolate unit normals to them.

    Parameters
    ----------
    points : (n, 2) float64 array
        Fractional rows and columns.
    valid : (rows, columns) bool array
    n : (3, rows, columns) array or None

    Returns
    -------
    known : (n,) bool array
    normals : (3, n) array or None
    """
    low = np.floor(points).astype(int)
    high = np.minimum(low + (points > low), np.array(valid.shape) - 1)
    known = np.logical_and.reduce([valid[i, j] for i in (low[:, 0], high[:, 0]) for j in (low[:, 1], high[:, 1])])
    if n is None:
        return known, None
    f, g = (points - low).T
    rows = [(1 - g) * n[:, i, low[:, 1]] + g * n[:, i, high[:, 1]] for i in (low[:, 0], high[:, 0])]
    n = (1 - f) * rows[0] + f * rows[1]
    return known, n / np.linalg.norm(n, axis=0)


def lamplight(heights, spacing, lamps, places, n: np.ndarray, channels: int, curve: float) -> np.ndarray:
    """Return irradiance from point lights.

    Parameters
    ----------
    heights : (rows, columns) float64 array
    spacing : (float, float)
        Metres between rows and between columns.
    lamps : sequence of (x, y, z, intensity)
        Metres east and north of the north-west sample, height in metres, and W/sr (number or (channels,)).
    places : (3, ...) array
        Receivers on the surface: rows and columns, fractional, and heights in metres.
    n : (3, [k,] ...) array
        Their unit normals, of which each may have several.
    channels : int
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.

    Returns
    -------
    (channels, [k,] ...) float32 array
        W/m².
    """
    total = np.zeros((channels, *n.shape[1:]))
    rows = np.ascontiguousarray(np.reshape(places, (3, -1)).T, dtype=np.float64)
    for x, y, z, intensity in lamps:
        lit = np.empty(len(rows), dtype=bool)
        _lit(heights, rows, x, -y, z, *spacing, curve, lit)
        to = np.stack([x - places[1] * spacing[1], y + places[0] * spacing[0], z - places[2]])
        to[2] -= curve * (to[0] ** 2 + to[1] ** 2)
        squared = np.maximum((to**2).sum(0), 1e-30)
        cosine = np.maximum((to.reshape(3, *[1] * (n.ndim - to.ndim), *squared.shape) * n).sum(0), 0)
        share = np.where(lit.reshape(squared.shape), cosine, 0) / squared**1.5
        total += intensity.reshape(-1, *[1] * share.ndim) * share
    return total.astype(np.float32)


def lamps_of(lamps) -> list[tuple]:
    """Return point lights checked: a list of (x, y, z, (1,) or (channels,) intensity)."""
    out = []
    if not listed(lamps):
        raise InputError(f"'lamps' must be a list of (x, y, z, intensity) (got {shown(lamps)})")
    for lamp in lamps:
        if not listed(lamp) or len(lamp) != 4:
            raise InputError(f"'lamps' must be a list of (x, y, z, intensity) (got {shown(lamp)})")
        intensity = reals("lamps intensity", lamp[3]).ravel()
        if not len(intensity) or not ((intensity >= 0) & (intensity <= 1e30)).all():
            raise InputError(f"'lamps' intensity must be finite, >= 0 and <= 1e+30 (got {shown(lamp[3])})")
        place = (number(f"lamps {c}", v, -UNKNOWN, UNKNOWN) for c, v in zip("xyz", lamp, strict=False))
        out.append((*place, intensity))
    return out
