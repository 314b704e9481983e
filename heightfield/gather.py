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

from .march import BLOCK, crossings
from .sweep import packed

NODES = 2048  # of the sky's table over elevation
BEST, MINE, UP, ALONG, SEEN, GAIN, PART, RISES = range(8)  # rows of a block's working memory; the last is two


@nb.njit(cache=True, inline="always")
def _weight(t, nz, a):
    # W at the elevation whose tangent is t; atan by a minimax polynomial (absolute error 2e-6)
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
    e = -e if t < 0 else e
    c = np.float32(1) / (np.float32(1) + t * t)
    return np.float32(0.5) * (nz * t * t * c + a * (e + t * c))


@nb.njit(cache=True, inline="always")
def _gain(work, count, rises, lasts, first):
    # What each receiver gains at a crossing: half a difference of W, and the visible part of the piece that ends here
    for j in range(count):
        rise, old, before = work[rises, j], work[BEST, j], work[lasts, j]
        new = rise > old
        now = rise if new else old
        total = _weight(now, work[UP, j], work[ALONG, j])
        work[GAIN, j] = np.float32(0.5) * (total - work[SEEN, j])
        # It starts where it comes up from behind the horizon
        hidden = (old - before) / (rise - before if new else np.float32(1))
        hidden = hidden if hidden > np.float32(0) else np.float32(0)
        hidden = hidden if hidden < np.float32(1) else np.float32(1)
        work[PART, j] = np.float32(1) if first else hidden
        work[BEST, j], work[SEEN, j] = now, total


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def _surface(heights, radiance, nz, a, offset, weight, distance, step, curve, slack, horizon, out):
    """March all receivers along +x: add what the surface radiates to ``out``, leave tangents in ``horizon``."""
    rows, columns = heights.shape
    channels = len(radiance)
    top = heights.max()
    for i in nb.prange(rows):
        here = heights[i]
        # One array, so that the compiler need not ask which of them overlap
        work = np.empty((10, BLOCK), np.float32)
        gather = np.empty((channels, BLOCK), np.float32)
        for j0 in range(0, columns, BLOCK):
            size = min(BLOCK, columns - j0)
            for j in range(size):
                work[BEST, j], work[MINE, j] = horizon[i, j0 + j], here[j0 + j]
                work[UP, j], work[ALONG, j] = nz[i, j0 + j], a[i, j0 + j]
            for j in range(size):
                work[SEEN, j] = _weight(work[BEST, j], work[UP, j], work[ALONG, j])
            gather[:] = 0
            for n in range(len(distance)):
                ra, ca, rb, cb = i + offset[n, 0], j0 + offset[n, 1], i + offset[n, 2], j0 + offset[n, 3]
                count = min(size, columns - max(ca, cb))
                if ra >= rows or rb >= rows or count <= 0:
                    break
                w = np.float32(weight[n])
                scale = np.float32(1.0 / (distance[n] * step))
                drop = np.float32(curve * distance[n] * step)
                if n % 16 == 15:
                    # Nothing beyond can rise above anybody's horizon
                    more = False
                    for j in range(count):
                        more |= (top - work[MINE, j]) * scale - drop > work[BEST, j]
                    if more and slack > 0:
                        # Nor add more than is worth it
                        more = False
                        for j in range(count):
                            highest = max((top - work[MINE, j]) * scale - drop, work[BEST, j])
                            more |= _weight(highest, work[UP, j], work[ALONG, j]) - work[SEEN, j] > slack
                    if not more:
                        break
                p, q = heights[ra, ca : ca + count], heights[rb, cb : cb + count]
                rises = RISES + (n & 1)
                some = False
                for j in range(count):
                    rise = (p[j] + w * (q[j] - p[j]) - work[MINE, j]) * scale - drop
                    work[rises, j] = rise
                    some |= rise > work[BEST, j]
                if not some:
                    continue
                # All receivers together, those that see nothing new with a gain of nought: no branch, so vectors
                if n & 1:
                    _gain(work, count, RISES + 1, RISES, False)
                else:
                    _gain(work, count, RISES, RISES + 1, n == 0)
                m = max(n - 1, 0)
                va, ua, vb, ub = i + offset[m, 0], j0 + offset[m, 1], i + offset[m, 2], j0 + offset[m, 3]
                f = np.float32(weight[m])
                for c in range(channels):
                    ea, eb = radiance[c, ra, ca : ca + count], radiance[c, rb, cb : cb + count]
                    sa, sb = radiance[c, va, ua : ua + count], radiance[c, vb, ub : ub + count]
                    for j in range(count):
                        end = ea[j] + w * (eb[j] - ea[j])
                        before = sa[j] + f * (sb[j] - sa[j])
                        gather[c, j] += work[GAIN, j] * (before + work[PART, j] * (end - before) + end)
            for j in range(size):
                horizon[i, j0 + j] = work[BEST, j]
            for c in range(channels):
                for j in range(size):
                    out[c, i, j0 + j] += gather[c, j]


def sky_table(radiance) -> np.ndarray:
    """Tabulate what a sky column adds above an elevation.

    Parameters
    ----------
    radiance : (n, channels) array
        Radiance at ``n`` elevations, equally spaced from −π/2 to π/2.

    Returns
    -------
    (2, NODES, channels) float64 array
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
    return out


@nb.njit(cache=True, parallel=True)
def add_sky(horizon, nz, a, table, width, out):
    """Add the sky above tangents ``horizon`` to ``out`` (channels, rows, columns); ``width`` is the sector's in radians."""
    rows, columns = horizon.shape
    nodes, channels = table.shape[1], table.shape[2]
    for i in nb.prange(rows):
        for j in range(columns):
            e = np.arctan(horizon[i, j])
            at = (e / np.pi + 0.5) * (nodes - 1)
            k = min(max(int(at), 0), nodes - 2)
            f = at - k
            for c in range(channels):
                s = table[0, k, c] + f * (table[0, k + 1, c] - table[0, k, c])
                t = table[1, k, c] + f * (table[1, k + 1, c] - table[1, k, c])
                out[c, i, j] += np.float32(width * max(nz[i, j] * s + a[i, j] * t, 0.0))


def surface(d, heights, radiance, n, azimuth, curve, reach, floor, tolerance=0.0) -> np.ndarray:
    """Irradiance per radian of azimuth that the surface sends to every point from one direction.

    Parameters
    ----------
    d : sweep.Direction
    heights : (rows, columns) float32 array
        North up, centred.
    radiance : (channels, rows, columns) float32 array
    n : (3, rows, columns) array
        Unit normals.
    azimuth, curve : float
    reach : int or None
        Columns to look at.
    floor : (rows, columns) array
        Tangents below which the receiver's own plane hides everything.
    tolerance : float
        Stop where all that may still appear adds less than this share of π times the greatest radiance, over all azimuths.

    Returns
    -------
    (channels, rows, columns) float32 array
        Turned as ``d`` turns.
    """
    a = n[0] * np.sin(azimuth) + n[1] * np.cos(azimuth)
    h, nz, a, horizon = (packed(d.turn(np.asarray(x, dtype=np.float32))) for x in (heights, n[2], a, floor))
    light = np.stack([packed(d.turn(channel)) for channel in radiance])
    out = np.zeros_like(light)
    columns = h.shape[1] - 1 if reach is None else min(reach, h.shape[1] - 1)
    if columns > 0:
        _surface(
            h, light, nz, a, *crossings(d.slope, d.diagonal, columns), d.step, curve, np.float32(tolerance / 2), horizon, out
        )
    return out
