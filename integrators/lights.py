"""The lights of a scene as the sampler sees them: which emitters there are, how bright, where, and in closed form."""

from __future__ import annotations

import re
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from .brightness import bounds, brightness_elsewhere, radiance_times_area
from .clusters import Clusters, build
from .meshlight import LEVELS, PARTS, Parts, groups, triangles
from .rectangle import rectangle_of, uniform

CLOSE = 0.35  # distance to a light, over its radius, below which light samples alone may be too bright: they go as 1/d²
# Share of the brightest light's power that a light gets, at least, whose surface is not equally bright all over
_DIMMEST = 1e-3
_PAIRS = 1 << 15  # lights by shapes that are held against each other at a time
# Farther than any scene, with a square that float32 still holds
_BEYOND = 1e18


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
        around that normal in which all normals lie (cosine 1 for planar lights and spheres; -1 if it is too wide); one.
    clusters : Clusters or None
        Trees over the lights if they are many.
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
    """

    count: int
    emitters: list
    pointers: object = None
    table: object = None
    clusters: Clusters | None = None
    touched: bool = False
    rectangle: tuple | None = None
    parts: object = None
    numbers: object = None
    start: object = None
    faces_at: object = None
    faces: object = None
    groups: object = None

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

    def end(self, ds, emitter, p):
        """Where a shadow ray from ``p`` towards a light sample must end to have passed all that may block it.

        Mitsuba puts samples of skies and suns at twice the radius of the scene's bounding sphere. In 3.9.1 that sphere
        misses rectangles that were merged with meshes of the same material, and light leaks through them.
        """
        if not self.infinite:
            return ds.p
        return dr.select(mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite), p + ds.d * _BEYOND, ds.p)

    def index(self, emitter, triangle):
        """Position in the arrays of the light that a ray has hit, from its emitter (pointer) and its triangle's number."""
        identity = dr.reinterpret_array(mi.UInt32, emitter)
        k = dr.gather(mi.UInt32, self.numbers, dr.minimum(identity, dr.width(self.numbers) - 1))
        light = dr.gather(mi.UInt32, self.start, k)
        if self.parts is not None:
            mesh = triangle < dr.gather(mi.UInt32, self.faces, k)
            light += dr.gather(mi.UInt32, self.groups, dr.gather(mi.UInt32, self.faces_at, k) + triangle, mesh)
        return light


def _numbers(pointers):
    # Registry number of each emitter to its position
    identity = np.array(dr.reinterpret_array(mi.UInt32, pointers))
    table = np.zeros(int(identity.max()) + 1, dtype=np.uint32)
    table[identity] = np.arange(len(identity))
    return mi.UInt32(table)


def _bounds_of(shape, emitter, radiance) -> tuple[np.ndarray, float, float]:
    # Bounding sphere of an area light, and its radiance times area
    box = shape.bbox()
    surface = shape.surface_area()
    surface = float(surface[0] if dr.width(surface) else 0.0) if not np.isscalar(surface) else float(surface)
    radius = 0.5 * float(np.linalg.norm(np.array(box.extents())))
    return np.array(box.center(), dtype=np.float64), radius, radiance_times_area(emitter, surface, radiance)


def _parts_of(shape, most: int) -> tuple[list, np.ndarray]:
    """Groups of a mesh light's triangles and each triangle's group; none where it is to be sampled as a whole."""
    found = triangles(shape) if shape.is_mesh() and most > 1 else None
    if found is None:
        return [], np.zeros(0, dtype=np.int64)
    mesh, kept = found
    group = groups(mesh, min(LEVELS, most.bit_length() - 1))
    number = np.zeros(shape.face_count(), dtype=np.int64)
    number[kept] = group
    return [mesh.part(group == g) for g in range(group.max() + 1)], number


def collect(scene) -> Lights:
    """Gather what sampling needs to know about every light of a scene; a mesh light counts as several.

    Parameters
    ----------
    scene : mi.Scene

    Returns
    -------
    Lights
    """
    emitters = list(scene.emitters())
    shapes = {s.emitter().id() + str(s.emitter().ptr): s for s in scene.shapes() if s.is_emitter()}
    owner, rows, pieces, faces, start, uneven = [], [], [], [], [], []
    rectangle, extent = None, None
    for k, emitter in enumerate(emitters):
        start.append(len(owner))
        faces.append(np.zeros(0, dtype=np.int64))
        shape = shapes.get(emitter.id() + str(emitter.ptr))
        n, cone, rectangle = np.zeros(3), 1.0, None
        if shape is None:
            extent = extent or bounds(scene)
            c, r, phi = brightness_elsewhere(emitter, extent)
        else:
            parameters = mi.traverse(shape)
            same = uniform(emitter, parameters)
            c, r, phi = _bounds_of(shape, emitter, parameters["emitter.radiance.value"] if same else None)
            if same and ("vertex_positions" in parameters or len(emitters) == 1):
                rectangle = rectangle_of(shape, emitter, parameters)
            if rectangle is not None or re.match("Rectangle|Disk", str(shape)):
                n = np.array(shape.sample_position(0.0, mi.Point2f(0.5)).n).ravel()[:3]
            else:
                parts, faces[-1] = _parts_of(shape, PARTS // len(emitters)) if same else ([], faces[-1])
                whole = sum(p.area.sum() for p in parts)
                for part in parts:
                    middle, radius, mean, cone = part.bounds()
                    pieces.append((len(owner), part, whole))
                    owner.append(k)
                    rows.append((*middle, *mean, cone, radius, phi * part.area.sum() / whole))
                if parts:
                    continue
                # Only spheres of one radiance are sampled by solid angle
                cone = 1.0 if same and re.match("Sphere", str(shape)) else -1.0
        owner.append(k)
        rows.append((*c, *n, cone, r, phi))
        if shape is not None and not same:
            uneven.append(len(owner) - 1)
    # What was bright may have been missed where a light differs from place to place
    brightest = max((row[-1] for row in rows), default=0.0)
    for l in uneven:
        rows[l] = (*rows[l][:-1], max(rows[l][-1], _DIMMEST * brightest))
    return _arrays(scene, emitters, rectangle, owner, rows, pieces, faces, start)


def _pack(rows: np.ndarray, count):
    # Twelve numbers a light, as in `Lights.table`, or a cluster of so many lights
    centre, normal, cone, radius, power = np.split(rows, [3, 6, 7, 8], axis=1)
    size, flare = np.linalg.norm(normal, axis=1, keepdims=True), np.sqrt(np.clip(1 - cone**2, 0, 1))
    count = np.broadcast_to(count, len(rows))[:, None]
    packed = np.concatenate([centre, radius, normal, size, power, cone, flare, count], axis=1).astype(np.float32)
    # Dr.Jit borrows NumPy's memory. Only where that happens to be aligned for it are four numbers gathered at once, by other
    # kernels, which take seconds to compile: its own is always aligned
    table = dr.empty(mi.Float, packed.size)
    dr.scatter(table, mi.Float(packed.ravel()), dr.arange(mi.UInt32, packed.size))
    dr.eval(table)
    return table


def _arrays(scene, emitters, rectangle, owner, rows, pieces, faces, start) -> Lights:
    # What was found, where kernels can read it
    if not emitters:
        return Lights(0, [])
    table = np.array(rows, dtype=np.float64)
    table[~np.isfinite(table).all(axis=1)] = 0
    parts = None
    if pieces:
        parts = Parts(len(owner))
        for piece in pieces:
            parts.add(*piece)
        parts.freeze()
    pointers = scene.emitters_dr()
    groups_at = np.cumsum([0, *(len(f) for f in faces)])[:-1]
    return Lights(
        count=len(owner),
        emitters=[emitters[k] for k in owner],
        pointers=dr.gather(mi.EmitterPtr, pointers, mi.UInt32(owner)),
        table=_pack(table, 1),
        clusters=build(table, _pack),
        touched=_touched(scene, table),
        rectangle=rectangle if len(owner) == 1 else None,
        parts=parts,
        numbers=_numbers(pointers),
        start=mi.UInt32(start),
        faces_at=mi.UInt32(groups_at),
        faces=mi.UInt32([len(f) for f in faces]),
        groups=mi.UInt32(np.concatenate([*faces, [0]])),
    )


def _touched(scene, table: np.ndarray) -> bool:
    """Whether the box of any shape comes close to an area light, and is not wholly behind it if that is planar.

    Parameters
    ----------
    table : ndarray, shape (lights, 9)
        Centre, normal, cosine of the normals' cone, radius and brightness.
    """
    boxes = [b for b in (s.bbox() for s in scene.shapes()) if b.valid()]
    low, high = (np.array([np.array(x).ravel() for x in side]) for side in ([b.min for b in boxes], [b.max for b in boxes]))
    lights = table[table[:, 7] > 0]
    step = max(_PAIRS // max(len(boxes), 1), 1)
    for some in (lights[k : k + step] for k in range(0, len(lights), step) if boxes):
        centre, normal, cone, r = some[:, None, :3], some[:, None, 3:6], some[:, 6:7], some[:, 7:8]
        # Distances of all boxes from these lights; the farthest that a box reaches to the emitting side
        from_low, from_high = low - centre, high - centre
        away = np.maximum(np.maximum(from_low, -from_high), 0)
        near = (away**2).sum(-1) < ((1 + CLOSE) * r) ** 2
        ahead = np.maximum(from_low * normal, from_high * normal).sum(-1)
        if (near & ((cone < 1) | (ahead > 1e-3 * r))).any():
            return True
    return False


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
        best = dr.select((cone < 0) | (wide_cos < 0) | (off >= wide_cos), 1, best)
        front = dr.select(cone < 1, dr.maximum(front, dr.select(best > -1e-3, 0.3 * dr.maximum(best, 0.03), 0)), front)
    near = phi * top * front / (d2 + 0.5 * r * r)
    w = dr.select(r < 0, phi, near)
    return dr.select(specular, dr.sqrt(w * count), w)
