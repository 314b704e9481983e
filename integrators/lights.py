"""The lights of a scene as the sampler sees them: which emitters there are, how bright, where, and in closed form."""

from __future__ import annotations

import re
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

_REFERENCE_SAMPLES = 256
# Luminance of a spectrum of ones: the integral of the CIE's y over wavelengths in nm
_WHITE = 106.85689
# Share of the brightest light's power that a light gets, at least, whose surface is not equally bright all over
_DIMMEST = 1e-3
# Farther than any scene, with a square that float32 still holds
_BEYOND = 1e18


@dataclass
class Lights:
    """Emitters of a scene, in arrays that kernels gather from.

    Attributes
    ----------
    count : int
        Number of emitters.
    area : list of bool
        Which of them are area lights.
    emitters : list of mi.Emitter
        The emitters, in the scene's order.
    pointers : mi.EmitterPtr
        The same, for virtual calls by index.
    centre, normal : mi.Point3f, mi.Vector3f
        Bounding-sphere centre and, for planar one-sided lights, the emitting side's normal (else zero).
    radius, power : mi.Float
        Bounding-sphere radius (negative for lights at infinity) and a bound-like brightness
        (radiance times area for area lights, intensity for points, irradiance at infinity).
    rectangle : tuple or None
        Corners, normal and constant radiance spectrum source if the only light is a plain rectangle.
    """

    count: int
    area: list
    emitters: list
    pointers: object
    centre: object
    normal: object
    radius: object
    power: object
    rectangle: tuple | None
    numbers: object = None

    @property
    def infinite(self) -> bool:
        """Whether any light is at infinity: a sky, a sun."""
        return any(mi.has_flag(e.flags(), mi.EmitterFlags.Infinite) for e in self.emitters)

    def end(self, ds, emitter, p):
        """Where a shadow ray from ``p`` towards a light sample must end to have passed all that may block it.

        Mitsuba puts samples of skies and suns at twice the radius of the scene's bounding sphere. In 3.9.1 that sphere
        misses rectangles that were merged with meshes of the same material, and light leaks through them.
        """
        if not self.infinite:
            return ds.p
        return dr.select(mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite), p + ds.d * _BEYOND, ds.p)

    def index(self, emitter):
        """Position of an emitter (pointer) in the arrays."""
        identity = dr.reinterpret_array(mi.UInt32, emitter)
        return dr.gather(mi.UInt32, self.numbers, dr.minimum(identity, dr.width(self.numbers) - 1))


def _numbers(pointers):
    # Registry number of each emitter to its position
    identity = np.array(dr.reinterpret_array(mi.UInt32, pointers))
    table = np.zeros(int(identity.max()) + 1, dtype=np.uint32)
    table[identity] = np.arange(len(identity))
    return mi.UInt32(table)


def _leaving(emitter, count: int) -> tuple | None:
    # Rays that a light sends out and their weights, drawn where it is bright: a few texels, a spectral line, a narrow beam.
    # None for plugins that cannot send any
    i = dr.arange(mi.UInt32, count)
    u = [mi.Float(i) * (1 / count) + 0.5 / count]
    for base in (2, 3, 5, 7):
        # Halton's points
        x, rest = mi.Float(0), mi.UInt32(i)
        for k in range(1, 11):
            x, rest = x + mi.Float(rest % base) / base**k, rest // base
        u.append(dr.minimum(x, 1 - 2**-20))
    try:
        return emitter.sample_ray(0.0, u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
    except Exception:
        return None


def _luminance(value, wavelengths) -> np.ndarray:
    # Of light whose weight counts the density of its wavelengths; 0 where it is no number
    scale = 1 / _WHITE if mi.is_spectral else 1.0
    y = np.array(mi.luminance(value, wavelengths), dtype=np.float64) * scale
    return np.where(np.isfinite(y), np.maximum(y, 0), 0)


def _radiance_times_area(emitter, area: float) -> float:
    # Over the light's surface: textures, spectra and meshes alike are simply looked at
    leaving = _leaving(emitter, _REFERENCE_SAMPLES)
    return area if leaving is None else float(np.mean(_luminance(leaving[1], leaving[0].wavelengths))) / np.pi


def bounds(scene) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner of all that a scene's rays can hit, each float64 of shape (3,); zeros if that is nothing.

    Meshes are measured by their vertices: Mitsuba 3.9.1 forgets rectangles that it merged into one.
    """
    boxes = []
    for shape in scene.shapes():
        parameters = mi.traverse(shape)
        if "vertex_positions" in parameters:
            v = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
            v = v[np.isfinite(v).all(1)]
            boxes += [v.min(0), v.max(0)] if len(v) else []
        elif shape.bbox().valid():
            boxes += [np.array(shape.bbox().min).ravel(), np.array(shape.bbox().max).ravel()]
    boxes = [b for b in boxes if np.isfinite(b).all()]
    return (np.min(boxes, axis=0), np.max(boxes, axis=0)) if boxes else (np.zeros(3), np.zeros(3))


def _brightness_elsewhere(emitter, scene) -> tuple[np.ndarray, float, float]:
    # Lights without a surface are probed: from the scene's middle, then, if they have a place, from all around it
    lower, upper = bounds(scene)
    centre, size = 0.5 * (lower + upper), max(float(np.linalg.norm(upper - lower)), 1e-6)
    position, value, distance = _probe(emitter, np.repeat(centre[:, None], 64, axis=1))
    # A sun has no place: seen from a wrong one it would be below horizons above which it stands
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite) or not np.all(np.isfinite(distance)):
        return centre, -1.0, max(float(np.mean(value)), 1e-6)
    # A spot may miss the scene's middle: its intensity is looked at along rays that it sends, and counts as its root mean
    # square over all directions, so that a narrow beam does not draw the rays of all that it misses
    place = position[:, 0]
    leaving = _leaving(emitter, 1024)
    if leaving is None:
        return place, 0.0, max(float(np.max(value * distance**2)), 1e-6)
    ray, flux = leaving
    _, value, distance = _probe(emitter, place[:, None] + size * np.array(ray.d, dtype=np.float64))
    square = np.mean(value * distance**2 * _luminance(flux, ray.wavelengths)) / (4 * np.pi)
    return place, 0.0, max(float(np.sqrt(square)), 1e-6)


def _probe(emitter, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # Sample a light from some points: where it is seen, how bright, and how far
    it = dr.zeros(mi.Interaction3f, points.shape[1])
    it.p = mi.Point3f(points.astype(np.float32))
    i = dr.arange(mi.UInt32, points.shape[1])
    share = mi.Spectrum(1)
    if mi.is_spectral:
        it.wavelengths, share = mi.sample_rgb_spectrum(mi.sample_shifted((mi.Float(i) + 0.5) / points.shape[1]))
    u = mi.Point2f((mi.Float(i % 8) + 0.5) / 8, (mi.Float((i // 8) % 8) + 0.5) / 8)
    ds, weight = emitter.sample_direction(it, u, True)
    value = np.broadcast_to(_luminance(weight * share, it.wavelengths), points.shape[1])
    distance = np.broadcast_to(np.array(ds.dist, dtype=np.float64), points.shape[1])
    place = np.broadcast_to(np.array(ds.p, dtype=np.float64), points.shape)
    return place, value, distance


def _parallelogram(shape) -> np.ndarray | None:
    # Corners, in order, of a rectangle or of a mesh of two triangles with such an outline
    parameters = mi.traverse(shape)
    if str(shape).startswith("Rectangle"):
        m = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)
        return np.array([(m @ [x, y, 0, 1])[:3] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    if "vertex_positions" not in parameters or len(parameters["faces"]) != 6:
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


def _even(emitter) -> bool:
    # Whether an area light is known to be equally bright all over
    parameters = mi.traverse(emitter)
    return "radiance.value" in parameters and np.size(parameters["radiance.value"]) <= 3


def _rectangle(shape, emitter) -> tuple | None:
    # A parallelogram with one radiance all over: the case that has a closed form
    if not _even(emitter):
        return None
    corners = _parallelogram(shape)
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


def collect(scene) -> Lights:
    """Gather what sampling needs to know about every emitter of a scene.

    Parameters
    ----------
    scene : mi.Scene

    Returns
    -------
    Lights
    """
    emitters = list(scene.emitters())
    shapes = {s.emitter().id() + str(s.emitter().ptr): s for s in scene.shapes() if s.is_emitter()}
    area, centre, normal, radius, power, uneven = [], [], [], [], [], []
    rectangle = None
    for emitter in emitters:
        shape = shapes.get(emitter.id() + str(emitter.ptr))
        area.append(shape is not None)
        n = np.zeros(3)
        if shape is None:
            c, r, phi = _brightness_elsewhere(emitter, scene)
        else:
            box = shape.bbox()
            c = np.array(box.center(), dtype=np.float64)
            r = 0.5 * float(np.linalg.norm(np.array(box.extents())))
            surface = shape.surface_area()
            surface = float(surface[0] if dr.width(surface) else 0.0) if not np.isscalar(surface) else float(surface)
            phi = _radiance_times_area(emitter, surface)
            rectangle = _rectangle(shape, emitter)
            if rectangle is not None or re.match("Rectangle|Disk", str(shape)):
                n = np.array(shape.sample_position(0.0, mi.Point2f(0.5)).n).ravel()[:3]
        ok = np.isfinite(c).all() and np.isfinite(r) and np.isfinite(phi) and np.isfinite(n).all()
        centre.append(c if ok else np.zeros(3))
        normal.append(n if ok else np.zeros(3))
        radius.append(r if ok else 0.0)
        power.append(phi if ok else 0.0)
        uneven.append(shape is not None and not _even(emitter))
    # What was bright may have been missed where a light differs from place to place
    power = np.maximum(power, np.where(uneven, _DIMMEST * max(power, default=0.0), 0.0))
    columns = lambda rows: np.array(rows, dtype=np.float32).reshape(len(emitters), 3).T  # noqa: E731
    return Lights(
        count=len(emitters),
        area=area,
        emitters=emitters,
        pointers=scene.emitters_dr() if emitters else None,
        centre=mi.Point3f(columns(centre)) if emitters else None,
        normal=mi.Vector3f(columns(normal)) if emitters else None,
        radius=mi.Float(np.array(radius, dtype=np.float32)) if emitters else None,
        power=mi.Float(np.array(power, dtype=np.float32)) if emitters else None,
        rectangle=rectangle if len(emitters) == 1 else None,
        numbers=_numbers(scene.emitters_dr()) if emitters else None,
    )


def importance(lights: Lights, index, p, n, transmits):
    """Estimate what light ``index`` would add at a point if nothing stood between, for choosing among lights.

    Zero only where the light provably adds nothing: wholly below the surface's horizon (when the surface does not
    transmit), or a planar light seen from behind.
    """
    c = dr.gather(mi.Point3f, lights.centre, index)
    axis = dr.gather(mi.Vector3f, lights.normal, index)
    r = dr.gather(mi.Float, lights.radius, index)
    phi = dr.gather(mi.Float, lights.power, index)
    d = c - p
    d2 = dr.squared_norm(d)
    # Highest sine above the horizon that any point of the bounding sphere reaches
    height = dr.dot(d, n)
    reach = (height + r) * dr.rsqrt(dr.maximum(d2, 1e-30))
    top = dr.select(transmits, 1.0, dr.clip(reach, 0.0, 1.0))
    front = dr.select(dr.squared_norm(axis) > 0, dr.maximum(-dr.dot(d, axis), 0) * dr.rsqrt(dr.maximum(d2, 1e-30)), 1.0)
    near = phi * dr.maximum(top, 0) * front / dr.maximum(d2 + 0.5 * r * r, 1e-30)
    return dr.select(r < 0, phi, near)


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
