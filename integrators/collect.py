"""Reads a scene's lights once: which emitters there are, how bright, where, and in closed form."""

from __future__ import annotations

import re

import drjit as dr
import mitsuba as mi
import numpy as np

from .brightness import bounds, brightness_elsewhere, radiance_times_area
from .clusters import build
from .lights import CLOSE, Lights
from .meshlight import LEVELS, PARTS, Parts, groups, triangles
from .rectangle import rectangle_of, uniform
from .skylight import Sky

# Share of the brightest light's power that a light gets, at least, whose surface is not equally bright all over
_DIMMEST = 1e-3
_PAIRS = 1 << 15  # lights by shapes that are held against each other at a time


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
            c, n, cone, r, phi = brightness_elsewhere(emitter, extent)
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
        beams=bool(((table[:, 7] == 0) & table[:, 3:6].any(axis=1)).any()),
        touched=_touched(scene, table),
        rectangle=rectangle if len(owner) == 1 else None,
        parts=parts,
        numbers=_numbers(pointers),
        start=mi.UInt32(start),
        faces_at=mi.UInt32(groups_at),
        faces=mi.UInt32([len(f) for f in faces]),
        groups=mi.UInt32(np.concatenate([*faces, [0]])),
        sky=next((Sky(start[k], e) for k, e in enumerate(emitters) if e.is_environment()), None),
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
