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

NODES = 2048  # of the sky's table over elevation


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


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def _surface(heights, radiance, nz, a, offset, weight, distance, step, curve, horizon, out):
    """March all receivers along +x: add what the surface radiates to ``out``, leave tangents in ``horizon``."""
    rows, columns = heights.shape
    channels = len(radiance)
    top = heights.max()
    for i in nb.prange(rows):
        here = heights[i]
        rises = np.empty(BLOCK, np.float32)
        seen = np.empty(BLOCK, np.float32)
        for j0 in range(0, columns, BLOCK):
            best, mine = horizon[i, j0 : j0 + BLOCK], here[j0 : j0 + BLOCK]
            up, along = nz[i, j0 : j0 + BLOCK], a[i, j0 : j0 + BLOCK]
            for j in range(len(best)):
                seen[j] = _weight(best[j], up[j], along[j])
            for n in range(len(distance)):
                ra, ca, rb, cb = i + offset[n, 0], j0 + offset[n, 1], i + offset[n, 2], j0 + offset[n, 3]
                count = min(len(best), columns - max(ca, cb))
                if ra >= rows or rb >= rows or count <= 0:
                    break
                w = np.float32(weight[n])
                scale = np.float32(1.0 / (distance[n] * step))
                drop = np.float32(curve * distance[n] * step)
                if n % 16 == 15:
                    # Nothing beyond can rise above anybody's horizon
                    more = False
                    for j in range(count):
                        more |= (top - mine[j]) * scale - drop > best[j]
                    if not more:
                        break
                p, q = heights[ra, ca : ca + count], heights[rb, cb : cb + count]
                some = False
                for j in range(count):
                    rise = (p[j] + w * (q[j] - p[j]) - mine[j]) * scale - drop
                    rises[j] = rise
                    some |= rise > best[j]
                if not some:
                    continue
                for j in range(count):
                    rise = rises[j]
                    if rise <= best[j]:
                        continue
                    total = _weight(rise, up[j], along[j])
                    gain = np.float32(0.5) * (total - seen[j])
                    # The visible part of the piece that ends here starts where it comes up from behind the horizon
                    part = np.float32(1)
                    if n > 0:
                        va, vb = i + offset[n - 1, 0], i + offset[n - 1, 2]
                        ua, ub = j + j0 + offset[n - 1, 1], j + j0 + offset[n - 1, 3]
                        f = np.float32(weight[n - 1])
                        last = heights[va, ua] + f * (heights[vb, ub] - heights[va, ua]) - mine[j]
                        last = last / np.float32(distance[n - 1] * step) - np.float32(curve * distance[n - 1] * step)
                        part = min(max((best[j] - last) / (rise - last), np.float32(0)), np.float32(1))
                    for c in range(channels):
                        end = radiance[c, ra, ca + j] + w * (radiance[c, rb, cb + j] - radiance[c, ra, ca + j])
                        start = end
                        if n > 0:
                            before = radiance[c, va, ua] + f * (radiance[c, vb, ub] - radiance[c, va, ua])
                            start = before + part * (end - before)
                        out[c, i, j0 + j] += gain * (start + end)
                    best[j], seen[j] = rise, total


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


def surface(d, heights, radiance, n, azimuth, curve, reach, floor) -> np.ndarray:
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

    Returns
    -------
    (channels, rows, columns) float32 array
        Turned as ``d`` turns.
    """
    turned = [np.ascontiguousarray(d.turn(x), dtype=np.float32) for x in (heights, radiance, n[2], floor)]
    a = np.ascontiguousarray(d.turn(n[0] * np.sin(azimuth) + n[1] * np.cos(azimuth)), dtype=np.float32)
    h, light, nz, horizon = turned
    out = np.zeros_like(light)
    columns = h.shape[1] - 1 if reach is None else min(reach, h.shape[1] - 1)
    if columns > 0:
        _surface(h, light, nz, a, *crossings(d.slope, d.diagonal, columns), d.step, curve, horizon, out)
    return out
