"""Procedural triangle meshes: numpy arrays of vertices and faces, joined, moved, and given to Mitsuba."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from .parts import require_variant


class Triangles(NamedTuple):
    """Triangles with shared vertices.

    Attributes
    ----------
    vertices : ndarray, (V, 3), float
    faces : ndarray, (F, 3), int
        Counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray


def join(parts: Sequence[Triangles]) -> Triangles:
    """Return the union of several sets of triangles."""
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    faces = [p.faces + o for p, o in zip(parts, offsets, strict=True)]
    return Triangles(np.concatenate([p.vertices for p in parts]), np.concatenate(faces))


def move(
    part: Triangles,
    offset: Sequence[float] = (0, 0, 0),
    scale: float | Sequence[float] = 1.0,
    turn: float = 0.0,
) -> Triangles:
    """Return the triangles scaled, then turned by `turn` radians about z, then moved by `offset`."""
    c, s = np.cos(turn), np.sin(turn)
    turned = (part.vertices * np.asarray(scale)) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return Triangles(turned + np.asarray(offset), part.faces)


def _grid_faces(rows: int, columns: int, wrap_rows: bool, wrap_columns: bool) -> np.ndarray:
    """List two triangles for each cell of a (rows, columns) lattice of vertices."""
    i, j = np.meshgrid(
        np.arange(rows - (not wrap_rows)), np.arange(columns - (not wrap_columns)), indexing="ij"
    )
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + (j + 1) % columns, (i + 1) % rows * columns + j
    return np.stack([a, b, c, a, c, d], -1).reshape(-1, 3)


def lathe(profile: Sequence[Sequence[float]], segments: int = 48) -> Triangles:
    """Turn a profile about the z axis.

    Parameters
    ----------
    profile : sequence of (radius, z)
        From bottom to top; end radii of zero close the surface.
    segments : int
        Vertices around the axis.
    """
    r, z = np.asarray(profile, float).T
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack(
        [np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi)), np.repeat(z[:, None], segments, 1)], -1
    )
    part = Triangles(ring.reshape(-1, 3), _grid_faces(len(r), segments, False, True))
    return _without_slivers(part)


def _without_slivers(part: Triangles) -> Triangles:
    """Weld vertices that coincide (the poles of a lathe) and drop the triangles this collapses."""
    vertices, index = np.unique(np.round(part.vertices, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[part.faces]
    a, b, c = faces.T
    return Triangles(vertices, faces[(a != b) & (b != c) & (c != a)])


def ellipsoid(center: Sequence[float], radii: Sequence[float], segments: int = 32) -> Triangles:
    """Return an axis-aligned ellipsoid."""
    theta = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = np.stack([np.cos(theta), np.sin(theta)], -1)
    profile[[0, -1], 0] = 0
    return move(lathe(profile, segments), center, radii)


def blob(radius: float, bumps: Callable[[np.ndarray], np.ndarray], segments: int = 96) -> Triangles:
    """Return a sphere whose radius is multiplied by ``1 + bumps(unit directions (V, 3))``."""
    ball = ellipsoid((0, 0, 0), (1, 1, 1), segments)
    return Triangles(ball.vertices * (radius * (1 + bumps(ball.vertices)))[:, None], ball.faces)


def limb(
    start: Sequence[float],
    end: Sequence[float],
    radii: tuple[float, float],
    bulge: float = 0.0,
    segments: int = 24,
) -> Triangles:
    """Return a rounded, tapering limb between two points, thicker by `bulge` in its middle."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = np.linalg.norm(end - start)
    t = np.linspace(0, 1, 13)
    side = radii[0] + (radii[1] - radii[0]) * t + bulge * np.sin(np.pi * t)
    cap = np.linspace(0, np.pi / 2, 7)[1:]
    low = [(radii[0] * np.sin(a), -radii[0] * np.cos(a)) for a in np.linspace(0, np.pi / 2, 7)[:-1]]
    high = [(radii[1] * np.cos(a), length + radii[1] * np.sin(a)) for a in cap]
    high[-1] = (0.0, length + radii[1])
    return _aim(lathe([*low, *zip(side, t * length, strict=True), *high], segments), start, end)


def _aim(part: Triangles, start: np.ndarray, end: np.ndarray) -> Triangles:
    """Turn the +z axis into the direction from `start` to `end`, and move the origin to `start`."""
    w = (end - start) / np.linalg.norm(end - start)
    u = np.cross([0, 1, 0] if abs(w[1]) < 0.9 else [1, 0, 0], w)
    u /= np.linalg.norm(u)
    return Triangles(part.vertices @ np.stack([u, np.cross(w, u), w]) + start, part.faces)


def rod(start: Sequence[float], end: Sequence[float], radius: float, segments: int = 24) -> Triangles:
    """Return an open cylinder between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = np.linalg.norm(end - start)
    return _aim(lathe([(radius, 0), (radius, length)], segments), start, end)


def prism(outline: Sequence[Sequence[float]], depth: float) -> Triangles:
    """Extrude a convex outline, (x, z) points counter-clockwise seen from -y, by `depth` along +y."""
    xz = np.asarray(outline, float)
    n = len(xz)
    front = np.stack([xz[:, 0], np.zeros(n), xz[:, 1]], -1)
    back = front + [0, depth, 0]
    fan = np.array([[0, i, i + 1] for i in range(1, n - 1)])
    j = np.arange(n)
    k = (j + 1) % n
    sides = np.concatenate([np.stack([j, j + n, k], -1), np.stack([k, j + n, k + n], -1)])
    return Triangles(np.concatenate([front, back]), np.concatenate([fan, fan[:, ::-1] + n, sides]))


def box(low: Sequence[float], high: Sequence[float]) -> Triangles:
    """Return an axis-aligned box."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return move(prism([(x0, z0), (x1, z0), (x1, z1), (x0, z1)], y1 - y0), (0, y0, 0))


def tube(path: np.ndarray, radius: float, segments: int = 12) -> Triangles:
    """Return a closed tube of this radius about a closed path (N, 3)."""
    tangent = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # A frame from the second derivative turns with the curve and closes on itself.
    bend = np.roll(path, -1, 0) + np.roll(path, 1, 0) - 2 * path
    normal = bend - (bend * tangent).sum(1, keepdims=True) * tangent
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = normal[:, None] * np.cos(phi)[None, :, None]
    ring = ring + np.cross(tangent, normal)[:, None] * np.sin(phi)[None, :, None]
    vertices = path[:, None] + radius * ring
    return Triangles(vertices.reshape(-1, 3), _grid_faces(len(path), segments, True, True))


def quads(corners: np.ndarray) -> Triangles:
    """Return two triangles for each of the quadrilaterals (N, 4, 3)."""
    base = 4 * np.arange(len(corners))[:, None, None]
    return Triangles(corners.reshape(-1, 3), (base + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3))


def to_mitsuba(
    part: Triangles,
    bsdf: dict[str, Any],
    *,
    smooth: bool = False,
    emitter: dict[str, Any] | None = None,
    name: str = "mesh",
) -> Any:
    """Return a ``mitsuba.Mesh`` of the active variant.

    Parameters
    ----------
    part : Triangles
        Vertices in scene units.
    bsdf, emitter : dict
        Material and, for a light, area emitter.
    smooth : bool
        Interpolate vertex normals; sharp edges want False.
    name : str
        Identifier in Mitsuba's messages.
    """
    require_variant()
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    if emitter is not None:
        props["emitter"] = mi.load_dict(emitter)
    mesh = mi.Mesh(name, len(part.vertices), len(part.faces), props, has_vertex_normals=smooth)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ravel(part.vertices).astype(np.float32)
    params["faces"] = np.ravel(part.faces).astype(np.uint32)
    params.update()
    return mesh
