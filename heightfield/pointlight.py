"""Light that arrives at chosen points: single rays over the triangles, whose radiance is known.

A ray runs over one triangle between two of its crossings with edges; what of it rises above all that came before adds its
radiance times a difference of W, as in `gather`.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .lanes_light import SHORT
from .points import crossed, height_at, hopeless, next_crossing
from .skylight import add_sky
from .surface import refine

AROUND = 8  # triangles of the four cells of which a place may be a corner
ASIDE = 1e-6  # cells; a ray along an edge sees half of the triangles on either side


@nb.njit(cache=True)
def _moments(t):
    # `lanes_moments.moments_of`
    c = 1 / (1 + t * t)
    return 0.5 * t * t * c, 0.5 * (np.arctan(t) + t * c), 0.5 * (np.arctan(t) - t * c)


@nb.njit(cache=True)
def _weight(t, nz, a):
    # W at the elevation whose tangent is t
    s, b, _ = _moments(t)
    return nz * s + a * b


@nb.njit(cache=True)
def _bend(before, t):
    # `gather.bends` of one stretch
    if t - before < 1e-3 * before:
        return 0.5
    if before < 1e-9 * t:
        return 0.0
    r = t / before
    return 1 - r * (1 - np.log(r) / (r - 1)) / (r - 1)


@nb.njit(cache=True)
def _leant(middle, old, new, ratio, nz, a):
    # Where the middle lies if tangents count by what they add (see `lanes_light.measure`)
    if new - old <= SHORT or old <= -1 / SHORT:
        return middle
    s, b, d = _moments(new)
    s_old, b_old, d_old = _moments(old)
    s, b, d = s - s_old, b - b_old, d - d_old
    second = nz * s + a * b
    first = nz * d + a * s - old * second
    whole = (new - old) * second - first * (1 - ratio)
    return min(max(middle * first * (1 + ratio) / whole, 0.0), 1.0) if whole > 0 else 0.0


def around(places: np.ndarray, cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return kind, row and column of the triangles around (3, n) places of a field of so many cells: (8, n) ints each."""
    kind, i, j = np.indices((2, 2, 2)).reshape(3, AROUND, 1)
    row, column = (np.ceil(v).astype(int) - 1 for v in places[:2])
    return kind + 0 * row, np.clip(row + i, 0, cells[0] - 1), np.clip(column + j, 0, cells[1] - 1)


def within(values: np.ndarray, triangles, places: np.ndarray) -> np.ndarray:
    """Return what triangles have at places in them: (channels, 8, n) of (channels, 2, 3, rows, columns), see `around`."""
    kind, row, column = triangles
    v, u = np.clip(places[0] - row, 0, 1), np.clip(places[1] - column, 0, 1)
    weights = 1 - np.maximum(v, u), np.abs(v - u), np.minimum(v, u)
    return sum(w.astype(np.float32) * values[:, kind, corner, row, column] for corner, w in enumerate(weights))


@nb.njit(cache=True)
def _which(y, x, v, u, rows, columns):
    # Which of the triangles around row y and column x has the spot at row v and column u in it
    r, c = min(max(int(v), 0), rows - 1), min(max(int(u), 0), columns - 1)
    i, j = min(max(r - int(np.ceil(y)) + 1, 0), 1), min(max(c - int(np.ceil(x)) + 1, 0), 1)
    return 4 * (v - r <= u - c) + 2 * i + j


@nb.njit(cache=True, parallel=True)
def _gather(heights, places, nz, a, south, east, limit, curve, radiance, s, there, horizon, out):
    # Add what the surface sends along one direction, per radian of azimuth, and raise the horizons; count crossings
    top, looked, naive = heights.max(), 0, 0
    rows, columns = heights.shape
    channels = len(radiance)
    across = east - south
    length = np.hypot(south, east)
    dr = 1 / abs(south) if abs(south) > 1e-12 else np.inf
    dc = 1 / abs(east) if abs(east) > 1e-12 else np.inf
    dd = 1 / abs(across) if abs(across) > 1e-12 else np.inf
    for p in nb.prange(len(places)):
        y, x, eye = places[p]
        tr, tc, td = next_crossing(y, south), next_crossing(x, east), next_crossing(x - y, across)
        best, before, last = horizon[p], 0.0, np.inf
        seen = _weight(best, nz[p], a[p])
        while True:
            t = min(tr, tc, td)
            if not t <= limit * (1 + 1e-12) or hopeless(top, eye, t, best):
                break
            row, column = y + t * south, x + t * east
            if row < -1e-9 or column < -1e-9 or row > rows - 1 + 1e-9 or column > columns - 1 + 1e-9:
                break
            looked += 1
            h = height_at(heights, min(max(row, 0.0), rows - 1.0), min(max(column, 0.0), columns - 1.0))
            rise = (h - eye) / t - curve * t
            if rise > best:
                now = _weight(rise, nz[p], a[p])
                # Where what is newly seen begins, and its middle (see `lanes_light.measure`)
                under, over = max(best - last, 0.0) * before, (rise - best) * t
                from_ = under / (under + over) if under > 0 else 0.0
                near, ratio = _bend(before, t), before / t + from_ * (1 - before / t)
                share = _leant(near + from_ * (0.5 - near), best, rise, ratio, nz[p], a[p])
                spot = before + (from_ + (1 - from_) * share) * (t - before)
                middle = 0.5 * (before + t)
                for side in (-ASIDE, ASIDE):
                    v, u = y + middle * south + side * east / length, x + middle * east - side * south / length
                    if before == 0 and len(there):
                        q = _which(y / s, x / s, v / s, u / s, (rows - 1) // s, (columns - 1) // s)
                        for k in range(channels):
                            out[k, p] += 0.5 * (now - seen) * there[k, q, p]
                        continue
                    r, c = min(max(int(v), 0), rows - 2), min(max(int(u), 0), columns - 2)
                    kind = 0 if v - r > u - c else 1
                    v, u = min(max(y + spot * south - r, 0.0), 1.0), min(max(x + spot * east - c, 0.0), 1.0)
                    far, low, high = abs(v - u), min(v, u), max(v, u)
                    for k in range(channels):
                        f = radiance[k, kind, :, r, c]
                        out[k, p] += 0.5 * (now - seen) * ((1 - high) * f[0] + far * f[1] + low * f[2])
                best, seen = rise, now
            last = rise
            # Crossings at one place count once
            before, here = t, t * (1 + 1e-12)
            if tr <= here:
                tr += dr
            if tc <= here:
                tc += dc
            if td <= here:
                td += dd
        horizon[p] = best
        naive += crossed(heights.shape, y, x, south, east, limit)
    return looked, naive


def arriving(field, places, n, azimuths, tables, radiance=None, s: int = 1, there=None, step=None) -> np.ndarray:
    """Irradiance that points receive from the sky and, if its radiance is given, from the surface.

    Parameters
    ----------
    field : HeightField
    places : (3, n) float64 array
        Rows and columns, fractional, and heights in metres.
    n : (3, n) array
        Unit normals.
    azimuths : (K,) array
        Radians clockwise from north.
    tables : K arrays
        The sky's, as `skylight.sky_table` returns them.
    radiance : (channels, 2, 3, s · (rows − 1), s · (columns − 1)) array, optional
        Of the triangles at their corners (see `faces.corners`), those south-west of their cells' diagonals first.
    s : int
        Cells into which a cell is cut, a side.
    there : (channels, 8, n) array, optional
        Radiance of the triangles `around` the points at the points themselves; by default what ``radiance`` says.
    step : callable, optional
        Called after each direction.

    Returns
    -------
    (channels, n) float32 array
        W/m².
    """
    channels = tables[0].shape[-1]
    # On a strip one sample wide there are no triangles, but horizons
    s = s if radiance is not None else 1
    heights = np.ascontiguousarray(refine(field.heights, s))
    if radiance is None:
        radiance = np.zeros((0, 2, 3, 1, 1))
    if there is None:
        there = np.zeros((0, AROUND, len(n[0])), np.float32)
    dy, dx = field.spacing
    at = np.ascontiguousarray((places * np.array([[s], [s], [1]])).T, dtype=np.float64)
    width = 2 * np.pi / len(azimuths)
    limit = np.inf if field.radius is None else field.radius
    out, sky = np.zeros((channels, len(at))), np.zeros((channels, 1, len(at)), dtype=np.float32)
    for azimuth, table in zip(azimuths, tables, strict=True):
        a = n[0] * np.sin(azimuth) + n[1] * np.cos(azimuth)
        horizon = np.array(-a / n[2], dtype=np.float64)
        south, east = -np.cos(azimuth) / dy * s, np.sin(azimuth) / dx * s
        looked = _gather(heights, at, n[2], a, south, east, limit, field.curve, radiance, s, there, horizon, out)
        field.tally.add(*looked, len(at))
        toward = np.float32(np.sin(azimuth)), np.float32(np.cos(azimuth))
        add_sky(horizon[None], n[:, None], toward, table, width, sky)
        if step:
            step()
    return (out * width).astype(np.float32) + sky[:, 0]
