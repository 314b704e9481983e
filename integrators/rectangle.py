"""Rectangle lights: what of their light is known in closed form, and rays for the rest."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from . import cells
from .order import turn
from .points import net_2d, shuffle

FLOOR = 0.08  # sampling weight of a decided light cell, next to 1 for an undecided one


def uniform(emitter, parameters) -> bool:
    """Whether an area light has one radiance all over, the same in all directions; ``parameters`` are its shape's."""
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.DeltaDirection):
        return False
    return "emitter.radiance.value" in parameters and dr.width(parameters["emitter.radiance.value"]) == 1


def read_matrix(matrix) -> np.ndarray:
    """Return a transform's matrix (mi.Matrix4f) as (4, 4) float64: constants in it would each compile a kernel."""
    matrix = type(matrix)(matrix)
    dr.make_opaque(matrix)
    return np.array(matrix, dtype=np.float64).reshape(4, 4)


def _parallelogram(shape, parameters) -> np.ndarray | None:
    # Corners, in order, of a rectangle or of a mesh of two triangles with such an outline
    if "vertex_positions" not in parameters:
        if not str(shape).startswith("Rectangle"):
            return None
        m = read_matrix(parameters["to_world"].matrix)
        return np.array([(-1, -1, 0, 1), (1, -1, 0, 1), (1, 1, 0, 1), (-1, 1, 0, 1)]) @ m[:3].T
    if len(parameters["faces"]) != 6:
        return None
    vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    places, index = np.unique(vertices, axis=0, return_inverse=True)
    faces = index.ravel()[np.array(parameters["faces"], dtype=np.int64)].reshape(2, 3)
    shared = np.intersect1d(*faces)
    if len(places) != 4 or len(shared) != 2:
        return None
    a, c = places[shared]
    b, d = (places[np.setdiff1d(f, shared)[0]] for f in faces)
    extent = np.ptp(places, axis=0).max()
    # Its normal must be that of both triangles all over, whatever the vertices' normals
    normals = np.array(shape.sample_position(0.0, mi.Point2f([0.1, 0.9, 0.3, 0.7], [0.2, 0.3, 0.8, 0.9])).n)
    if np.abs(a + c - b - d).max() > 1e-6 * extent or np.ptp(normals, axis=1).max() > 1e-6:
        return None
    return np.array([a, b, c, d])


def rectangle_of(shape, emitter, parameters) -> tuple | None:
    """Corners, normal and emitter of a uniform light that is a parallelogram; None for others."""
    corners = _parallelogram(shape, parameters)
    if corners is None:
        return None
    normal = np.array(shape.sample_position(0.0, mi.Point2f(0.5)).n).ravel()[:3].astype(np.float64)
    if not np.isfinite(corners).all() or not np.isfinite(normal).all() or not np.linalg.norm(normal) > 0.5:
        return None
    winding = np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ normal
    # Seen from the emitting side, corners must run counter-clockwise for the irradiance to be positive
    if winding > 0:
        corners = corners[::-1]
    return list(corners), normal, emitter


def polygon_irradiance(p, n, corners):
    """Irradiance at points ``p`` from a planar polygon of unit radiance, clipped at the horizon (Lambert's formula).

    Parameters
    ----------
    p : mi.Point3f
        Receiving points.
    n : mi.Vector3f
        Unit normals there.
    corners : list of mi.Point3f
        Corners of a convex polygon, in order; clockwise seen from its emitting side.

    Returns
    -------
    mi.Float
        E/L in steradians times cosine, in [0, π]. The side of the polygon is not tested.
    """
    v = [dr.normalize(c - p) for c in corners]
    z = [dr.dot(a, n) for a in v]
    total, leave, enter = mi.Float(0), mi.Vector3f(0), mi.Vector3f(0)

    def edge(a, b):
        c = dr.cross(a, b)
        s = dr.norm(c)
        return dr.select(s > 0, dr.dot(c, n) * dr.atan2(s, dr.dot(a, b)) / dr.maximum(s, 1e-30), 0)

    for i in range(len(v)):
        a, b, za, zb = v[i], v[(i + 1) % len(v)], z[i], z[(i + 1) % len(v)]
        # An edge that crosses the horizon is cut there; the cuts are joined along the horizon below
        crossing = (za > 0) != (zb > 0)
        cut = dr.normalize(a * zb - b * za) * dr.select(zb > za, 1.0, -1.0)
        leave = dr.select(crossing & (za > 0), cut, leave)
        enter = dr.select(crossing & (zb > 0), cut, enter)
        a = dr.select(za > 0, a, cut)
        b = dr.select(zb > 0, b, cut)
        total += dr.select((za > 0) | (zb > 0), edge(a, b), 0)
    total += edge(leave, enter)
    return dr.maximum(0.5 * total, 0)


class Rectangle:
    """A constant rectangle light over a Lambertian point: every integrand is ``radiance × scalar``."""

    def __init__(self, surface):
        corners, normal, emitter = surface.shading.lights.rectangle
        opaque = lambda v: [dr.opaque(mi.Float, float(x)) for x in v]  # noqa: E731
        self.corners = [mi.Point3f(opaque(c)) for c in corners]
        self.first, self.second = mi.Vector3f(opaque(corners[1] - corners[0])), mi.Vector3f(opaque(corners[3] - corners[0]))
        self.normal, self.area = mi.Vector3f(opaque(normal)), dr.norm(dr.cross(self.first, self.second))
        self.p, self.n = surface.si.p, surface.si.sh_frame.n * surface.side
        self.active = surface.active & surface.plain & (dr.dot(self.p - self.corners[0], self.normal) > 0)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(0, 0, 1)
        self.radiance = surface.albedo * emitter.eval(si)

    def point(self, u):
        """Point of the light at unit-square coordinates."""
        return self.corners[0] + self.first * u.x + self.second * u.y

    def geometry(self, y):
        """Cosines over squared distance, times area: the integrand over the unit square."""
        d = y - self.p
        d2 = dr.squared_norm(d)
        g = dr.maximum(dr.dot(d, self.n), 0) * dr.maximum(-dr.dot(d, self.normal), 0) * self.area
        return dr.select(self.active & (d2 > 0), g / dr.square(d2), 0)

    def reached(self, u):
        """Where a direction chosen in proportion to its cosine meets the light, and whether it does."""
        d = mi.Frame3f(self.n).to_world(mi.warp.square_to_cosine_hemisphere(u))
        along = dr.dot(d, self.normal)
        y = self.p + d * (dr.dot(self.corners[0] - self.p, self.normal) / along)
        # Coordinates along both sides, which need not be at right angles
        q, a, b = y - self.corners[0], self.first, self.second
        ab, scale = dr.dot(a, b), dr.rcp(dr.squared_norm(dr.cross(a, b)))
        v = (dr.squared_norm(b) * dr.dot(q, a) - ab * dr.dot(q, b)) * scale
        w = (dr.squared_norm(a) * dr.dot(q, b) - ab * dr.dot(q, a)) * scale
        return y, self.active & (along < 0) & (v >= 0) & (v <= 1) & (w >= 0) & (w <= 1)

    def unshadowed(self):
        """Integral of the geometry term over the light, in closed form."""
        return dr.select(self.active, polygon_irradiance(self.p, self.n, self.corners), 0)


@dr.syntax
def rectangle_light(surface, guess, mask, mean, rays, s, keys, refine, proven):
    """Estimate a rectangle light at a Lambertian hit, around its closed form; arguments as in `estimate.single_light`.

    ``mean`` is the mean guess over the light. The control is ``g_c ρ``: its mean part is known exactly from the closed
    form, the rest is summed over the cells. Where visibility is ``proven`` the closed form is all; the rays that were
    not traced are returned too.
    """
    s0, s1 = keys[8], keys[9]
    light = surface.rectangle()
    full, traced, spared = light.unshadowed(), mi.UInt32(0), mi.UInt32(0)
    if dr.hint(not refine, mode="scalar"):
        spared = dr.select(proven, rays, 0)
        mean, rays = dr.select(proven, 1, mean), dr.select(proven, 0, rays)
    value = full * mean
    if dr.hint(refine, mode="scalar"):
        jitter = net_2d(s, s1, s0)
        c, rest = mi.UInt32(0), mi.Float(0)
        while c < 16:
            v = mi.Point2f((mi.Float(c & 3) + jitter.x) * 0.25, (mi.Float(c >> 2) + jitter.y) * 0.25)
            rest += light.geometry(light.point(v)) * (cells.fraction(guess, c) - mean)
            c += 1
        value += rest * mi.Float(1 / 16)
    r, acc, odd = mi.UInt32(0), mi.Float(0), turn(s, rays)
    while r < rays:
        u = net_2d(s * rays + (r ^ odd), s0, s1)
        density, g = mi.Float(1), mi.Float(mean)
        if dr.hint(refine, mode="scalar"):
            cell, u, density = cells.sample(mask, u, mi.Float(FLOOR))
            g = cells.fraction(guess, cell)
        y = light.point(u)
        rho = light.geometry(y)
        useful = rho > 0
        lit = surface.visible(y, useful)
        term = rho * (dr.select(lit, mi.Float(1), mi.Float(0)) - g) / density
        if dr.hint(surface.shading.follows and not refine, mode="scalar"):
            # Close to the light: balance heuristic against one direction chosen by its cosine
            term *= dr.select(surface.follow, mi.Float(rays) / (mi.Float(rays) + rho * dr.inv_pi / density), 1)
        acc += term
        traced += dr.select(useful, mi.UInt32(1), mi.UInt32(0))
        r += 1
    if dr.hint(surface.shading.follows and not refine, mode="scalar"):
        y, meets = light.reached(net_2d(shuffle(s, keys[11]), keys[10], keys[6]))
        meets &= surface.follow & (rays > 0)
        lit = surface.visible(y, meets)
        chance = light.geometry(y) * dr.inv_pi
        term = (dr.select(lit, mi.Float(1), mi.Float(0)) - mean) * dr.pi * chance / (chance + mi.Float(rays))
        acc += dr.select(meets, term, 0) * mi.Float(rays)
        traced += dr.select(meets, mi.UInt32(1), mi.UInt32(0))
    return light.radiance * (value + acc / mi.Float(dr.maximum(rays, 1))), light.radiance * full, traced, spared
