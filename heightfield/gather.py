"""Light gathered over one direction: what the surface shows below the horizon, and the sky above it.

A receiver of unit normal ``n`` sees, in a sector of azimuth around the horizontal direction ``d``, radiance ``L(e)`` at
elevation ``e``. With ``a = n·d`` its irradiance from the sector is, per radian of azimuth,

    ∫ L(e) (n_z sin e + a cos e) cos e de  =  Σ L_i [W(e_i) − W(e_{i−1})],    W(e) = n_z sin²e / 2 + a (e + sin e cos e) / 2 ,

so every newly visible piece of surface adds its radiance times a difference of W (§10.1, third way: exact over the visible
points). Elevations below the receiver's own tangent plane count nothing.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .lanes import LANES
from .lanes_light import BEST, MINE, climb, gains, pour, shine, start, worth
from .lanes_skip import soon
from .skip import AHEAD, SIZES, leaves, seek

NODES = 2048  # of the sky's table over elevation


@nb.njit(cache=True, inline="always")
def _elevation(t):
    # Angle of tangent t, by a minimax polynomial (absolute error 2e-6)
    u = abs(t)
    inverse = u > np.float32(1)
    z = np.float32(1) / u if inverse else u
    q = z * z
    p = np.float32(-0.01172120)
    p = p * q + np.float32(0.05265332)
    p = p * q + np.float32(-0.11643287)
    p = p * q + np.float32(0.19354346)
    p = p * q + np.float32(-0.33262347)
    p = p * q + np.float32(0.99997726)
    e = p * z
    e = np.float32(1.5707963) - e if inverse else e
    return -e if t < 0 else e


@nb.njit(cache=True)
def _strip(
    heights, stride, edge, top, light, image, triangles, feet, slack, share, own, nz, a, horizon, out, pitch, channels, i,
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins,
):  # fmt: skip
    # `surface` for receivers in rows ``i`` to ``i + 15``
    leave, mine, best = leaves(down, stride, i), MINE * LANES, BEST * LANES
    work, sums = np.zeros(5 * LANES, np.float32), np.zeros(channels * LANES, np.float32)
    # As many as a ray crosses in one stretch, and one to overwrite
    most = 1 + max([upto[min(k + SIZES[0], len(upto) - 1)] - upto[k] for k in range(len(upto))])
    rises, which = np.empty(most * LANES, np.float32), np.empty(most, np.int64)
    looked = 0
    for x in range(len(own) // pitch):
        place, at, last = x * stride + i, x * pitch + i, min(edge - x, leave)
        for values in (horizon, own, nz, a, out):
            soon(values, at + AHEAD * pitch)
        start(work, horizon, own, nz, a, at)
        # To the first whole stretch all is looked at
        begin, k = 0, min(SIZES[0] - (x & (SIZES[0] - 1)), last)
        while True:
            end = upto[k]
            seen = climb(work, heights, place, first, second, weight, scale, drop, begin, end, rises, which)
            gains(work, rises, seen)
            # The triangle on which the receiver itself lies sends it nothing
            own_triangle = int(seen > 0 and which[0] < feet)
            for m in range(channels):
                shine(rises, which, own_triangle, seen, triangles, light, m * image + place, sums, m * LANES)
            looked += end - begin
            k, tests = seek(down, inverse, fall, tops, begins, stride, x, i, k, last, work, mine, work, best)
            looked += tests
            if k == last or (slack > 0 and not worth(work, top, inverse[k], fall[k], slack)):
                break
            begin, k = upto[k], min(k + SIZES[0], last)
        for lane in range(LANES):
            horizon[at + lane] = work[best + lane]
        for m in range(channels):
            pour(sums, m * LANES, share, out, m * len(own) + at)
    return looked


@nb.njit(cache=True, parallel=True)
def surface(laid, radiance, own, nz, a, way, triangles, feet, slack, share, horizon, out, receivers):
    """Add to ``out`` the irradiance per radian of azimuth that the surface sends along one direction's rays.

    Parameters
    ----------
    laid : (S², columns, rows + margin) float32 array
        Turned heights, centred, as `faces.planes` deals them.
    radiance : (channels, 2 · S², columns − 1, rows + margin) float32 array
        Of the triangles, a row before the first and one behind the last, as `faces.bordered` has them.
    own, nz, a : (m, n) float32 arrays
        The receivers' heights, and their normals' components upwards and along the direction; columns lie first, n is a
        multiple of 16.
    way : skip.Way
    triangles : (l,) int64 array
        Place in ``radiance`` of the triangle before each crossing, from the receiver's cell.
    feet : int
        1 if receivers lie within triangles, which send them nothing; else 0.
    slack : float
        Stop where all that may still appear weighs less than this, over all receivers side by side.
    share : float
        Factor of what is added.
    horizon : (m, n) float32 array
        Tangents below which the receiver's own plane hides everything, infinite for what is no receiver; of its horizon
        afterwards.
    out : (channels, m, n) float32 array
    receivers : int
        Rows of receivers.

    Returns
    -------
    int
        Crossings looked at and tests of stretches, over all receivers.
    """
    heights, light, image, strips = laid.ravel(), radiance.ravel(), radiance[0].size, own.shape[1] // LANES
    top, half, looked = heights.max(), (strips + 1) // 2, 0
    mine, up, along, found, sums = own.ravel(), nz.ravel(), a.ravel(), horizon.ravel(), out.ravel()
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins = way
    for t in nb.prange(strips):
        i = LANES * (2 * t if t < half else 2 * (t - half) + 1)
        looked += min(LANES, receivers - i) * _strip(
            *(heights, laid.shape[2], laid.shape[1] - 1, top, light, image, triangles, feet, slack, share),
            *(mine, up, along, found, sums, own.shape[1], len(out), i),
            *(first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins),
        )
    return looked


def sky_table(radiance) -> np.ndarray:
    """Tabulate what a sky column adds above an elevation.

    Parameters
    ----------
    radiance : (n, channels) array
        Radiance at ``n`` elevations, equally spaced from −π/2 to π/2.

    Returns
    -------
    (2, NODES, channels) float32 array
        Integrals of ``L sin e cos e`` and ``L cos² e`` from each node's elevation to the zenith.
    """
    radiance = np.atleast_2d(np.asarray(radiance, dtype=np.float64))
    e = np.linspace(-np.pi / 2, np.pi / 2, NODES)
    given = np.linspace(-np.pi / 2, np.pi / 2, len(radiance)) if len(radiance) > 1 else np.zeros(1)
    values = np.stack([np.interp(e, given, radiance[:, c]) for c in range(radiance.shape[1])], -1)
    # Each interval's weight in closed form, its radiance the mean of the ends
    mean = 0.5 * (values[1:] + values[:-1])
    primitive = np.stack([np.sin(e) ** 2 / 2, (e + np.sin(e) * np.cos(e)) / 2])
    pieces = np.diff(primitive, axis=1)[..., None] * mean
    out = np.zeros((2, NODES, radiance.shape[1]))
    out[:, :-1] = np.cumsum(pieces[:, ::-1], axis=1)[:, ::-1]
    return out.astype(np.float32)


@nb.njit(cache=True, parallel=True)
def add_sky(horizon, nz, a, table, width, out):
    """Add the sky above tangents ``horizon`` to ``out`` (channels, rows, columns); ``width`` is the sector's in radians."""
    rows, columns = horizon.shape
    nodes, channels = table.shape[1], table.shape[2]
    scale, middle, width = np.float32((nodes - 1) / np.pi), np.float32((nodes - 1) / 2), np.float32(width)
    for i in nb.prange(rows):
        for j in range(columns):
            at = _elevation(horizon[i, j]) * scale + middle
            k = np.uint32(min(max(at, np.float32(0)), np.float32(nodes - 2)))
            f, up, along = at - np.float32(k), nz[i, j], a[i, j]
            for c in range(channels):
                s = table[0, k, c] + f * (table[0, k + 1, c] - table[0, k, c])
                t = table[1, k, c] + f * (table[1, k + 1, c] - table[1, k, c])
                out[c, i, j] += width * max(up * s + along * t, np.float32(0))
