"""Shadow rays that need not be traced: points between which and a rectangle light nothing can stand.

Whatever a shadow ray may pass lies in the hull of its point and the light. Where a plane parts that hull from every
blocker, the light is visible for certain, and no ray is needed to know it: the shafts of Haines and Wallace (*Shaft
Culling for Efficient Ray-Traced Radiosity*, 1991), with their planes taken exactly. A proof costs as much as some five
rays. It is made once a pixel, for all points of a small disk, and a hit only asks whether it lies on that disk.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from .rectangle import read_matrix

MOST = 24  # blockers, all of which every pixel is held against
FEW = 64  # triangles of meshes that are worth cutting into planes
CORNERS = 8
RAY_EPSILON = 4.4e-5  # half of how far from a surface Mitsuba's rays begin, relative to 1 + the largest coordinate


@dataclass
class Blockers:
    """What might stand in the way, as a few convex hulls.

    Attributes
    ----------
    count : int
        Number of hulls.
    corners : mi.Point3f
        Eight points a hull, some of them equal; the hull holds all of the blocker.
    low, high : mi.Point3f
        Bounding box of each.
    normal : mi.Vector3f
        Unit normal of the flat ones, zero for the others.
    """

    count: int
    corners: object
    low: object
    high: object
    normal: object


def _box(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    # Corners of the box along some orthonormal axes (its rows) that holds the points
    t = points @ axes.T
    ends = np.stack([t.min(0), t.max(0)])
    corner = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(-1, 3)
    return ends[corner, [0, 1, 2]] @ axes


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return eight corners of a hull of points, and its normal if they lie in a plane (else zero).

    Parameters
    ----------
    points : ndarray, shape (N, 3)

    Returns
    -------
    corners : ndarray, shape (8, 3)
    normal : ndarray, shape (3,)
    """
    points = np.unique(points, axis=0)
    _, sizes, axes = np.linalg.svd(points - points.mean(0), full_matrices=len(points) < 3)
    flat = len(points) >= 3 and sizes[1] > 1e-6 * sizes[0] and sizes[2] <= 1e-6 * sizes[0]
    normal = axes[2] if flat else np.zeros(3)
    if len(points) <= CORNERS:
        return points[np.arange(CORNERS) % len(points)], normal
    boxes = [_box(points, a) for a in ([axes] if flat else [np.eye(3), axes])]
    return min(boxes, key=lambda b: np.prod(np.linalg.norm(b[[4, 2, 1]] - b[0], axis=1))), normal


def _pieces(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Cut a mesh into planar pieces if it has few triangles: walls that were merged part again.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray, shape (F, 3)

    Returns
    -------
    list of ndarray, each of shape (N, 3)
    """
    if len(faces) > FEW:
        return [_box(vertices, np.eye(3))]
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    offset = np.einsum("ij,ij->i", normal, corners[:, 0])
    size = max(float(np.abs(corners).max()), 1e-300)
    planes = np.round(np.column_stack([normal, offset / size]) * 1e4)
    _, group = np.unique(planes, axis=0, return_inverse=True)
    return [corners[group.ravel() == g].reshape(-1, 3) for g in range(group.max() + 1)]


# What Mitsuba's own shapes fill before their transform
_EXTENT = {"Rectangle": (-1, 1, 0, 0), "Disk": (-1, 1, 0, 0), "Cylinder": (-1, 1, 0, 1), "Sphere": (-1, 1, -1, 1)}


def _outline(shape) -> list[np.ndarray] | None:
    # Points whose hulls hold the shape; None for kinds of shapes that are not known here
    parameters = mi.traverse(shape)
    if "vertex_positions" in parameters:
        vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        return _pieces(vertices, np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3))
    extent = _EXTENT.get(str(shape).split("[")[0])
    if extent is None or "to_world" not in parameters:
        return None
    m = read_matrix(parameters["to_world"].matrix)
    inverse = read_matrix(parameters["to_world"].inverse_transpose).T
    # Rays are intersected by the inverse, which is another map where a rotation's axis was not of unit length
    if not np.allclose(m @ inverse, np.eye(4), atol=1e-3):
        return None
    a, b, low, high = extent
    corners = np.array([[x, y, z, 1] for x in (a, b) for y in (a, b) for z in sorted({low, high})])
    return [corners @ m.T[:, :3]]


def collect_blockers(scene, emitter) -> Blockers | None:
    """Take everything but the light's own shape apart into hulls.

    Parameters
    ----------
    scene : mi.Scene
    emitter : mi.Emitter
        The only light, a rectangle.

    Returns
    -------
    Blockers or None
        None where the scene has more shapes than are worth asking about, or others than meshes and plain quadrics.
    """
    points = []
    for shape in scene.shapes():
        if shape.is_emitter() and shape.emitter().ptr == emitter.ptr:
            continue
        pieces = _outline(shape)
        points += pieces or []
        if pieces is None or len(points) > MOST:
            return None
    if not all(np.isfinite(p).all() for p in points):
        return None
    hulls = [_hull(p) for p in points]
    columns = lambda rows: np.array(rows, dtype=np.float32).reshape(-1, 3).T  # noqa: E731
    return Blockers(
        len(hulls),
        mi.Point3f(columns([c for c, _ in hulls])) if hulls else None,
        mi.Point3f(columns([c.min(0) for c, _ in hulls])) if hulls else None,
        mi.Point3f(columns([c.max(0) for c, _ in hulls])) if hulls else None,
        mi.Vector3f(columns([n for _, n in hulls])) if hulls else None,
    )


class _Shaft:
    """The hull of a disk around each point and a rectangle light, as what may part it from a blocker."""

    def __init__(self, light, radius):
        self.p, self.n, self.corners, self.normal, self.radius = light.p, light.n, light.corners, light.normal, radius
        self.eps = tolerance(self.p)
        self.low, self.high = self.p - radius, self.p + radius
        for c in self.corners:
            self.low, self.high = dr.minimum(self.low, c), dr.maximum(self.high, c)
        # Sides through the point and an edge of the light, facing outwards
        self.axis = 0.5 * (self.corners[0] + self.corners[2]) - self.p
        self.sides = []
        for i in range(4):
            side = dr.normalize(dr.cross(self.corners[i] - self.p, self.corners[(i + 1) & 3] - self.p))
            self.sides.append(dr.select(dr.dot(side, self.axis) > 0, -side, side))

    def apart(self, blockers: Blockers, b):
        """Whether some plane has all of blocker ``b`` on its other side."""
        eps, r = self.eps, self.radius
        low, high = dr.gather(mi.Point3f, blockers.low, b), dr.gather(mi.Point3f, blockers.high, b)
        apart = dr.any((high <= self.low + eps) | (low >= self.high - eps))
        # The receiver's horizon, the light's plane, and the four sides
        q = [dr.gather(mi.Point3f, blockers.corners, b * CORNERS + k) for k in range(CORNERS)]
        apart |= _all(dr.dot(x - self.p, self.n) <= eps for x in q)
        apart |= _all(dr.dot(x - self.corners[0], self.normal) <= eps for x in q)
        for side in self.sides:
            apart |= _all(dr.dot(x - self.p, side) > eps + r for x in q)
        # A flat blocker's own plane
        t = dr.gather(mi.Vector3f, blockers.normal, b)
        light = [dr.dot(c - q[0], t) for c in self.corners]
        here = dr.dot(self.p - q[0], t)
        # The disk reaches no farther from its plane than the two planes are tilted
        reach = r * dr.norm(dr.cross(t, self.n))
        sided = _all(h >= -eps for h in [*light, here - reach]) | _all(h <= eps for h in [*light, here + reach])
        return apart | (sided & (dr.squared_norm(t) > 0))


def _all(conditions):
    result = mi.Bool(True)
    for c in conditions:
        result = result & c
    return result


def tolerance(p):
    """How close to a plane something may come and not be in a ray's way: half of the ray's own offset."""
    return RAY_EPSILON * (1 + dr.max(dr.abs(p)))


@dr.syntax
def unobstructed(blockers: Blockers, light, radius, active):
    """Where nothing can stand between any place of the light and any point of a disk, above the disk's horizon.

    Parameters
    ----------
    blockers : Blockers
    light : Rectangle
        The light, as the disks' centres see it.
    radius : mi.Float
        The disks' radii; they lie in the plane of the centres' normals.
    active : mi.Bool

    Returns
    -------
    mi.Bool
    """
    clear = mi.Bool(active & light.active & (radius < dr.inf))
    if dr.hint(blockers.count > 0, mode="scalar"):
        shaft = _Shaft(light, radius)
        # Far from the origin rays begin so far off that nothing is certain
        clear = clear & (shaft.eps < 1e-3 * dr.norm(shaft.axis))
        b, number = mi.UInt32(0), dr.opaque(mi.UInt32, blockers.count)
        while clear & (b < number):
            clear = clear & shaft.apart(blockers, b)
            b += 1
    return clear
