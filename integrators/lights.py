"""The lights of a scene as kernels see them: where they are, how much each might add at a point, and light samples."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .clusters import Clusters
from .skylight import BEYOND, Sky

CLOSE = 0.35  # distance to a light, over its radius, below which light samples alone may be too bright: they go as 1/d²
FULL = 0.44  # how far inside its cut-off a spot shines in full, as a share of 1 - cosine: three quarters of the angle


@dataclass
class Lights:
    """Lights of a scene, in arrays that kernels gather from: its emitters, mesh lights in parts.

    Attributes
    ----------
    count : int
        Number of lights.
    emitters : list of mi.Emitter
        Each light's emitter, in the scene's order.
    pointers : mi.EmitterPtr
        The same, for virtual calls by index.
    table : mi.Float
        Twelve numbers a light: centre and radius of a bounding sphere (negative for lights at infinity); the emitting
        side's normal of planar lights, the mean normal of parts of a mesh, or zero, and its length; a bound-like brightness
        (radiance times area for area lights, intensity for points, irradiance at infinity); cosine and sine of the angle
        around that normal in which all normals lie (cosine 1 for planar lights and spheres; -1 if it is too wide), which for
        spots are their axis and cut-off; one, in clusters the number of lights, negative if all are spots.
    clusters : Clusters or None
        Trees over the lights if they are many.
    beams : bool
        Some are spots.
    touched : bool
        Some surface may be close to an area light.
    rectangle : tuple or None
        Corners, normal and constant radiance spectrum source if the only light is a plain rectangle.
    parts : Parts or None
        Triangles of mesh lights.
    numbers : mi.UInt32
        Place among the scene's emitters, by what Mitsuba's registry numbers them.
    start, faces_at, faces : mi.UInt32
        Of each emitter: its first light; where its triangles' groups begin in ``groups``, and how many there are.
    groups : mi.UInt32
        Which of its emitter's lights a triangle belongs to.
    sky : Sky or None
        The light that is all around, if any is.
    """

    count: int
    emitters: list
    pointers: object = None
    table: object = None
    clusters: Clusters | None = None
    beams: bool = False
    touched: bool = False
    rectangle: tuple | None = None
    parts: object = None
    numbers: object = None
    start: object = None
    faces_at: object = None
    faces: object = None
    groups: object = None
    sky: Sky | None = None

    @property
    def tops(self) -> int:
        """Number of lights, or of clusters of them, that are compared jointly."""
        return self.count if self.clusters is None else self.clusters.tops

    @property
    def nodes(self):
        """Like ``table``, of the clusters if there are any; `importance` and `close` are of these."""
        return self.table if self.clusters is None else self.clusters.table

    @property
    def alone(self) -> bool:
        """Whether all lights are of one emitter."""
        return all(e is self.emitters[0] for e in self.emitters)

    @property
    def infinite(self) -> bool:
        """Whether any light is at infinity: a sky, a sun."""
        return any(mi.has_flag(e.flags(), mi.EmitterFlags.Infinite) for e in self.emitters)

    def counter(self, top):
        """Which counter of visibility a top has."""
        return top if self.clusters is None else dr.gather(mi.UInt32, self.clusters.counter, top)

    def sample(self, si, l, u, active):
        """Sample a direction from ``si`` towards light number ``l``: a direction sample, and radiance over density."""
        # The object itself where there is only one emitter, which spares virtual calls
        emitter = self.emitters[0] if self.alone else dr.gather(mi.EmitterPtr, self.pointers, l, active)
        if self.parts is None:
            ds, weight = emitter.sample_direction(si, u, active)
        elif self.alone:
            ds, weight = self.parts.sample(si, emitter, l, u, active)
        else:
            part = dr.gather(mi.UInt32, self.parts.count, l, active) > 0
            ds, weight = emitter.sample_direction(si, u, active & ~part)
            other, brightness = self.parts.sample(si, emitter, l, u, active & part)
            ds, weight = dr.select(part, other, ds), dr.select(part, brightness, weight)
        ds.p = self.end(ds, emitter, si.p)
        return ds, weight

    def end(self, ds, emitter, p):
        """Where a shadow ray from ``p`` towards a light sample must end to have passed all that may block it.

        Mitsuba puts samples of skies and suns at twice the radius of the scene's bounding sphere. In 3.9.1 that sphere
        misses rectangles that were merged with meshes of the same material, and light leaks through them.
        """
        if not self.infinite:
            return ds.p
        return dr.select(mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite), p + ds.d * BEYOND, ds.p)

    def index(self, emitter, triangle):
        """Position in the arrays of the light that a ray has hit, from its emitter (pointer) and its triangle's number."""
        identity = dr.reinterpret_array(mi.UInt32, emitter)
        k = dr.gather(mi.UInt32, self.numbers, dr.minimum(identity, dr.width(self.numbers) - 1))
        light = dr.gather(mi.UInt32, self.start, k)
        if self.parts is not None:
            mesh = triangle < dr.gather(mi.UInt32, self.faces, k)
            light += dr.gather(mi.UInt32, self.groups, dr.gather(mi.UInt32, self.faces_at, k) + triangle, mesh)
        return light


@dr.syntax
def any_close(lights: Lights, p):
    """Where some light is so close to a point, for its size, that light samples alone are too noisy."""
    k, found, count = mi.UInt32(0), mi.Bool(False), dr.opaque(mi.UInt32, dr.width(lights.nodes) // 12)
    while (k < count) & ~found:
        near, after = _close(lights, k, p), k + 1
        if dr.hint(lights.clusters is not None, mode="scalar"):
            # Down where a cluster's sphere comes close enough for its widest light, else on past all below it
            child = dr.gather(mi.UInt32, lights.clusters.child, k)
            ball = dr.gather(mi.Vector4f, lights.nodes, 3 * k)
            reach = ball.w + CLOSE * dr.gather(mi.Float, lights.clusters.widest, k)
            inner = (child > 0) & (ball.w >= 0)
            into = inner & (dr.squared_norm(mi.Vector3f(ball.x, ball.y, ball.z) - p) < dr.square(reach))
            near &= child == 0
            after = dr.select(into, child, dr.gather(mi.UInt32, lights.clusters.after, k))
        found |= near
        k = after
    return found


def _close(lights: Lights, index, p):
    # Whether one light is
    a, b = (dr.gather(mi.Vector4f, lights.nodes, 3 * index + k) for k in range(2))
    cone = dr.gather(mi.Vector4f, lights.nodes, 3 * index + 2).y
    r, d = a.w, mi.Vector3f(a.x, a.y, a.z) - p
    # Distance to the disk around a planar light, to the sphere around others
    above = dr.dot(d, mi.Vector3f(b.x, b.y, b.z))
    beside = dr.sqrt(dr.maximum(dr.squared_norm(d) - above * above, 0))
    disk = dr.square(above) + dr.square(dr.maximum(beside - r, 0))
    ball = dr.square(dr.maximum(dr.norm(d) - r, 0))
    return (r > 0) & (dr.select((b.w > 0) & (cone >= 1), disk, ball) < dr.square(CLOSE * r))


def importance(lights: Lights, index, p, n, transmits, specular=False):
    """Estimate what light (or cluster) ``index`` would add at a point if nothing stood between, for choosing among lights.

    Zero only where the light provably adds nothing: wholly below the surface's horizon (when the surface does not
    transmit), or wholly turned away. Flatter where the surface is ``specular``, as highlights defy the estimate.
    """
    a, b = (dr.gather(mi.Vector4f, lights.nodes, 3 * index + k) for k in range(2))
    phi, cone, flare, count = dr.gather(mi.Vector4f, lights.nodes, 3 * index + 2)
    c, r, axis = mi.Point3f(a.x, a.y, a.z), a.w, mi.Vector3f(b.x, b.y, b.z)
    d = c - p
    d2 = dr.maximum(dr.squared_norm(d), 1e-30)
    inverse = dr.rsqrt(d2)
    # Highest sine above the horizon that any point of the bounding sphere reaches
    top = dr.select(transmits, 1.0, dr.clip((dr.dot(d, n) + r) * inverse, 0.0, 1.0))
    # Share of its brightness that the light's slant leaves
    slant = -dr.dot(d, axis) * inverse
    front = dr.select(b.w > 0, dr.maximum(slant, 0), 1.0)
    if lights.parts is not None or lights.clusters is not None:
        # A part's normals lie in a cone, which its extent widens; the best of them is what some of it may have
        off = dr.clip(slant / dr.maximum(b.w, 1e-30), -1, 1)
        sine = dr.minimum(r * inverse, 1)
        cosine = dr.sqrt(1 - sine * sine)
        wide_cos, wide_sin = cone * cosine - flare * sine, flare * cosine + cone * sine
        best = off * wide_cos + dr.sqrt(1 - off * off) * wide_sin
        # Within the sphere, or among normals that look everywhere, some of it always faces the point
        within = (cone < 0) | (wide_cos < 0) | (off >= wide_cos)
        best = dr.select(within, 1, best)
        front = dr.select(cone < 1, dr.maximum(front, dr.select(best > -1e-3, 0.3 * dr.maximum(best, 0.03), 0)), front)
    if lights.beams:
        # A spot fades from three quarters of its cut-off on, by default; only beyond that there is surely nothing
        inside = (slant / dr.maximum(b.w, 1e-30) - cone) / dr.maximum(1 - cone, 1e-6)
        beam = dr.select(inside > -1e-4, dr.clip(inside * (1 / FULL), 0.1, 1), 0)
        front = dr.select((r == 0) & (b.w > 0), beam, front)
        if lights.clusters is not None:
            # Spots alone: nothing outside the cone that holds all of theirs
            front = dr.select((count < 0) & (r > 0) & ~within & (off < wide_cos - 1e-4), 0, front)
            count = dr.abs(count)
    near = phi * top * front / (d2 + 0.5 * r * r)
    w = dr.select(r < 0, phi, near)
    return dr.select(specular, dr.sqrt(w * count), w)
