"""Skies sampled with regard for the surface that they light: few light samples go below its horizon.

An even sky is sampled in proportion to the cosine alone. Any other is sampled by Mitsuba, in proportion to radiance, from
random numbers that are warped first: a table, for normals all around, tells how much of the light that the numbers stand for
falls on the surface. Densities vary bilinearly over the unit square, so that what is integrated over it stays smooth.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from .brightness import luminance, onlookers

SIDE = 8  # cells along each side of the unit square
LOOKS = 8  # samples of the sky along each side of a cell: what a thousandth of its light comes from must not be missed
NORMALS = 8  # along each side of an octahedral map of normals
FLOOR = 0.2  # share of the mean density that is added everywhere
EVEN = 1.4  # second moment of samples by the cosine, over that by its product with radiance, up to which a sky counts as even
SLANT = 0.1  # added to the cosine where surfaces are not Lambertian: what they reflect may fall more slowly to the horizon
BEYOND = 1e18  # farther than any scene, with a square that float32 still holds


class Sky:
    """The environment emitter of a scene.

    Parameters
    ----------
    index : int
        Its number among the scene's lights.
    emitter : mi.Emitter
    """

    def __init__(self, index: int, emitter):
        self.index, self.emitter = index, emitter
        d, flux, radiance = _look(emitter, SIDE * LOOKS)
        cos = octahedron(NORMALS) @ d
        facing = np.maximum(cos, 0)
        mean = (facing * flux).mean(1)
        # Samples by the cosine come to radiance times pi
        square = np.pi * (facing * (flux * radiance)).mean(1)
        self.even = bool(square.mean() <= EVEN * (mean**2).mean())
        if not self.even:
            # One table for surfaces that light falls on from their own side, another for those that transmit
            light = np.concatenate([facing, abs(cos)]) * flux
            self.mean = mi.Float((light.mean(1) / max(flux.mean(), 1e-30)).astype(np.float32))
            light = light.reshape(-1, SIDE, LOOKS, SIDE, LOOKS)
            self._tabulate(np.sqrt((light**2).mean((2, 4))))

    def _tabulate(self, w):
        # Densities at the corners of cells, and how much lies below each row and left of each column
        w = w + FLOOR * w.mean((1, 2), keepdims=True)
        w[w.sum((1, 2)) <= 0] = 1
        p = np.pad(w, ((0, 0), (1, 1), (1, 1)), mode="edge")
        p = 0.25 * (p[:, :-1, :-1] + p[:, 1:, :-1] + p[:, :-1, 1:] + p[:, 1:, 1:])
        columns = np.cumsum(0.5 * (p[:, :, :-1] + p[:, :, 1:]), 2)
        across = columns[:, :, -1]
        rows = np.cumsum(0.5 * (across[:, :-1] + across[:, 1:]), 1)
        self.corners, self.columns, self.across, self.rows = (
            mi.Float(x.ravel().astype(np.float32)) for x in (p, columns, across, rows)
        )

    def table(self, n, transmits):
        """Return which table is for a normal."""
        n = n * dr.rcp(dr.maximum(dr.abs(n.x) + dr.abs(n.y) + dr.abs(n.z), 1e-20))
        x = dr.select(n.z < 0, dr.mulsign(1 - dr.abs(n.y), n.x), n.x)
        y = dr.select(n.z < 0, dr.mulsign(1 - dr.abs(n.x), n.y), n.y)
        i, j = (mi.UInt32(dr.clip((0.5 * c + 0.5) * NORMALS, 0, NORMALS - 1)) for c in (x, y))
        return j * NORMALS + i + dr.select(transmits, mi.UInt32(NORMALS**2), mi.UInt32(0))

    def warp(self, n, transmits, u, active):
        """Warp points of the unit square for a normal; return them, and their density."""
        table = self.table(n, transmits)

        def row(values, k, side):
            return dr.gather(mi.Float, values, table * side + k, active)

        # A row of cells by what lies below its upper edge, and a place in it
        k, low, high = _search(lambda k: row(self.rows, k, SIDE), u.y)
        whole = row(self.rows, SIDE - 1, SIDE)
        y, across = _linear(row(self.across, k, SIDE + 1), high - low, u.y * whole - low)

        # The same along the row, between the densities of its two edges
        def between(values, j, side):
            above, below = (row(values, (k + i) * side + j, (SIDE + 1) * side) for i in (0, 1))
            return dr.lerp(above, below, y)

        j, low, high = _search(lambda j: between(self.columns, j, SIDE), u.x)
        x, density = _linear(between(self.corners, j, SIDE + 1), high - low, u.x * across - low)
        v = mi.Point2f(x + mi.Float(j), y + mi.Float(k)) * (1 / SIDE)
        return dr.minimum(v, 1 - 2**-24), density * SIDE**2 / whole

    def around(self, si, n, transmits, slant, u, active):
        """Sample an even sky about a normal: a direction sample, and radiance over density."""
        back = transmits & (u.y >= 0.5)
        y = dr.select(transmits, 2 * u.y - dr.select(back, 1, 0), u.y)
        # Density in proportion to cosine plus slant
        z = dr.sqrt(dr.square(slant) + y * (1 + 2 * slant)) - slant
        r, (sine, cosine) = dr.safe_sqrt(1 - z * z), dr.sincos(u.x * dr.two_pi)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d = mi.Frame3f(n).to_world(mi.Vector3f(r * cosine, r * sine, dr.select(back, -z, z)))
        ds.p, ds.n, ds.dist, ds.time = si.p + ds.d * BEYOND, -ds.d, BEYOND, si.time
        ds.pdf = self.density(n, transmits, slant, ds.d, 0)
        far = dr.zeros(mi.SurfaceInteraction3f)
        far.wi, far.wavelengths, far.time = -ds.d, si.wavelengths, si.time
        return ds, dr.select(ds.pdf > 0, self.emitter.eval(far, active) / ds.pdf, 0)

    def density(self, n, transmits, slant, d, pdf):
        """Density of light samples towards a direction, which Mitsuba samples with density ``pdf``.

        Of an even sky. Of others what tables come to but for their cells: good enough for weights that add up to one.
        """
        cosine = dr.dot(n, d)
        cosine = dr.select(transmits, dr.abs(cosine), cosine)
        if self.even:
            p = (cosine + slant) * dr.rcp(dr.pi * (1 + 2 * slant)) * dr.select(transmits, 0.5, 1)
            return dr.select(cosine > 0, p, 0)
        warped = dr.maximum(cosine, 0) / dr.maximum(dr.gather(mi.Float, self.mean, self.table(n, transmits)), 1e-6)
        return pdf * (warped + FLOOR) * (1 / (1 + FLOOR))


def _search(upto, u):
    # Which of the cells a share of them all lies in, and what all up to it, and with it, come to
    whole = upto(mi.UInt32(SIDE - 1))
    k, low, high, target = mi.UInt32(0), mi.Float(0), whole, u * whole
    step = SIDE // 2
    while step:
        middle = upto(k + (step - 1))
        above = target >= middle
        low, high, k = dr.select(above, middle, low), dr.select(above, high, middle), dr.select(above, k + step, k)
        step //= 2
    return k, low, high


def _linear(a, mass, part):
    # Where, along a unit of density that grows evenly from ``a`` to ``mass``, ``part`` of that lies; and the density there
    density = dr.safe_sqrt(a * a + 4 * (mass - a) * part)
    return dr.clip(2 * part / dr.maximum(a + density, 1e-30), 0, 1), density


def octahedron(side: int) -> np.ndarray:
    """Normals at the middles of an octahedral map, float32 of shape (side * side, 3)."""
    c = (np.arange(side) + 0.5) / side * 2 - 1
    y, x = np.meshgrid(c, c, indexing="ij")
    z = 1 - abs(x) - abs(y)
    x, y = np.where(z < 0, np.copysign(1 - abs(y), x), x), np.where(z < 0, np.copysign(1 - abs(x), y), y)
    n = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)


def _look(emitter, side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # Directions (3, side²) that a sky is sampled at on a grid of the unit square, radiance over density, and radiance
    count = side * side
    i = dr.arange(mi.UInt32, count)
    it, share = onlookers(count)
    u = (mi.Point2f(mi.Float(i % side), mi.Float(i // side)) + 0.5) / side
    ds, weight = emitter.sample_direction(it, u, True)
    flux = np.broadcast_to(luminance(weight * share, it.wavelengths), count).astype(np.float32)
    # Densities of what does not shine are no numbers
    density = np.nan_to_num(np.array(ds.pdf, dtype=np.float32), posinf=0)
    return np.nan_to_num(np.array(ds.d, dtype=np.float32)), flux, flux * density
