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
from .lanes_light import ALONG, BEST, MINE, SEEN, UP, cross, shine, start
from .march import BLOCK

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


@nb.njit(cache=True, inline="always")
def _weight(t, nz, a):
    # W at the elevation whose tangent is t
    c = np.float32(1) / (np.float32(1) + t * t)
    return np.float32(0.5) * (nz * t * t * c + a * (_elevation(t) + t * c))


@nb.njit(cache=True, parallel=True, fastmath={"nsz", "contract", "reassoc"})
def surface(
    heights, radiance, own, nz, a, edges, weight, distance, triangles, others, feet, step, curve, slack, share, horizon, out
):
    """Add to ``out`` the irradiance per radian of azimuth that the surface sends along one direction's rays.

    Parameters
    ----------
    heights : (S², rows, columns + BLOCK) float32 array
        Turned heights, centred, as `faces.planes` deals them, with `march.ABYSS` beyond the border.
    radiance : (channels, 2 · S², rows − 1, columns − 1 + BLOCK) float32 array
        Of the triangles, 0 beyond the border.
    own, nz, a : (m, n) float32 arrays
        The receivers' heights, and their normals' components upwards and along the direction.
    edges, weight, distance, triangles
        As `faces.Ray` has them.
    others : (n, 3) int32 array
        For rays along edges the triangles on the other side; the same ones elsewhere.
    feet : bool
        Whether receivers lie within triangles, which send them nothing.
    step : float
        Metres per column.
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    slack : float
        Stop where all that may still appear weighs less than this, over all receivers side by side.
    share : float
        Factor of what is added.
    horizon : (m, n) float32 array
        Tangents below which the receiver's own plane hides everything; of its horizon afterwards.
    out : (channels, m, n) float32 array

    Returns
    -------
    int
        Crossings looked at, over all receivers.
    """
    rows, columns = heights.shape[1], heights.shape[2] - BLOCK
    channels, last = len(radiance), radiance.shape[2] - 1
    top, looked = heights[0].max(), 0
    for i in nb.prange(own.shape[0]):
        work = np.zeros((6, BLOCK), np.float32)
        gather = np.empty((channels, BLOCK), np.float32)
        for j0 in range(0, own.shape[1], BLOCK):
            size = min(BLOCK, own.shape[1] - j0)
            # Beyond the row's end nobody sees anything
            work[BEST] = np.inf
            for j in range(size):
                work[BEST, j], work[MINE, j] = horizon[i, j0 + j], own[i, j0 + j]
                work[UP, j], work[ALONG, j] = nz[i, j0 + j], a[i, j0 + j]
            groups = (size + LANES - 1) // LANES
            for g in range(groups):
                start(work, g)
            gather[:] = 0
            for n in range(len(distance)):
                ra, ca, rb, cb = i + edges[n, 1], j0 + edges[n, 2], i + edges[n, 4], j0 + edges[n, 5]
                if ra >= rows or rb >= rows or ca >= columns or cb >= columns:
                    break
                w = np.float32(weight[n])
                scale = np.float32(1.0 / (distance[n] * step))
                drop = np.float32(curve * distance[n] * step)
                if n % 16 == 15:
                    # Nothing beyond can rise above anybody's horizon
                    more = False
                    for j in range(size):
                        more |= (top - work[MINE, j]) * scale - drop > work[BEST, j]
                    if more and slack > 0:
                        # Nor add more than is worth it
                        more = False
                        for j in range(size):
                            highest = max((top - work[MINE, j]) * scale - drop, work[BEST, j])
                            more |= _weight(highest, work[UP, j], work[ALONG, j]) - work[SEEN, j] > slack
                    if not more:
                        break
                looked += min(size, columns - max(ca, cb))
                p, q = heights[edges[n, 0], ra, ca : ca + BLOCK], heights[edges[n, 3], rb, cb : cb + BLOCK]
                kind, r, c = triangles[n, 0], i + triangles[n, 1], j0 + triangles[n, 2]
                if r < 0 or r > last:
                    # Along the border there is a triangle on one side only
                    kind, r, c = others[n, 0], i + others[n, 1], j0 + others[n, 2]
                # The triangle on which the receiver itself lies sends it nothing
                shines = n > 0 or not feet
                for g in range(groups):
                    if cross(work, g, p, q, w, scale, drop) and shines:
                        for m in range(channels):
                            shine(work, g, radiance[m, kind, r, c : c + BLOCK], gather[m])
            for j in range(size):
                horizon[i, j0 + j] = work[BEST, j]
            for m in range(channels):
                for j in range(size):
                    out[m, i, j0 + j] += share * gather[m, j]
    return looked


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
            at = (_elevation(horizon[i, j]) / np.pi + 0.5) * (nodes - 1)
            k = min(max(int(at), 0), nodes - 2)
            f = at - k
            for c in range(channels):
                s = table[0, k, c] + f * (table[0, k + 1, c] - table[0, k, c])
                t = table[1, k, c] + f * (table[1, k + 1, c] - table[1, k, c])
                out[c, i, j] += np.float32(width * max(nz[i, j] * s + a[i, j] * t, 0.0))
