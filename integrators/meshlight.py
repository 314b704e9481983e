"""Mesh lights in parts: groups of triangles that lie and face alike, so that those turned away cost no rays.

Half of a closed mesh faces away from any point outside it, and samples there are in vain. A mesh of one radiance is cut into
at most `PARTS` groups; each is a light of its own to the sampler, with a cone that holds its normals (as the clusters of
Conty Estévez and Kulla, *Importance Sampling of Many Lights with Adaptive Tree Splitting*, 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

LEVELS = 4
PARTS = 1 << LEVELS  # most groups of a mesh


@dataclass
class Triangles:
    """A mesh light's triangles, as float64 arrays.

    Attributes
    ----------
    corners, normals : ndarray, shape (N, 3, 3)
        Three points each, and the normals that Mitsuba interpolates between them.
    area : ndarray, shape (N,)
    """

    corners: np.ndarray
    normals: np.ndarray
    area: np.ndarray

    def part(self, index):
        """Triangles by their numbers."""
        return Triangles(self.corners[index], self.normals[index], self.area[index])

    def bounds(self):
        """Middle and radius of the bounding box's sphere, mean normal, and cosine of the cone around it that holds all."""
        low, high = self.corners.min((0, 1)), self.corners.max((0, 1))
        mean = np.average(self.normals.mean(1), axis=0, weights=self.area)
        size = np.linalg.norm(mean)
        cone = (self.normals @ (mean / size)).min() if size > 1e-3 else -1.0
        # Interpolated normals stay in the cone that holds the corners' if that is narrower than a half-space
        return 0.5 * (low + high), 0.5 * np.linalg.norm(high - low), mean, cone if cone > 0 else -1.0


def triangles(mesh) -> tuple[Triangles, np.ndarray] | None:
    """Return the triangles of a mesh (mi.Mesh) that have an area, and their numbers; None where one is not finite."""
    parameters = mi.traverse(mesh)
    points = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    faces = np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    kept = np.flatnonzero(double > 0)
    if not np.isfinite(double).all() or not len(kept):
        return None
    normals = np.repeat((cross[kept] / double[kept, None])[:, None], 3, axis=1)
    if mesh.has_vertex_normals():
        normals = np.array(parameters["vertex_normals"], dtype=np.float64).reshape(-1, 3)[faces[kept]]
        size = np.linalg.norm(normals, axis=-1, keepdims=True)
        if not np.isfinite(size).all() or not (size > 0).all():
            return None
        normals /= size
    return Triangles(corners[kept], -normals if mesh.has_flipped_normals() else normals, 0.5 * double[kept]), kept


def groups(mesh: Triangles, levels: int = LEVELS) -> np.ndarray:
    """Group of each triangle: halves of halves, cut where places or normals spread most.

    Parameters
    ----------
    mesh : Triangles
    levels : int
        At most ``2 ** levels`` groups.

    Returns
    -------
    ndarray of int, shape (N,)
        Groups are numbered from 0 without gaps.
    """
    middle = mesh.corners.mean(1)
    extent = max(float(np.ptp(middle, axis=0).max()), 1e-300)
    features = np.concatenate([middle * (2 / extent), mesh.normals.mean(1)], axis=1)
    group = np.zeros(len(features), dtype=np.int64)
    for _ in range(levels):
        count = int(group.max()) + 1
        weight = np.bincount(group, mesh.area, count)
        mean = np.stack([np.bincount(group, mesh.area * f, count) / weight for f in features.T], -1)
        away = features - mean[group]
        spread = np.stack([np.bincount(group, mesh.area * f * f, count) / weight for f in away.T], -1)
        axis = np.argmax(spread, axis=1)
        group = 2 * group + (away[np.arange(len(away)), axis[group]] > 0)
    return np.unique(group, return_inverse=True)[1].ravel()


class Parts:
    """The triangles of all mesh lights, group by group, where kernels can read them.

    Every light has a number of triangles here; that of a light that is no part of a mesh is zero.
    """

    def __init__(self, lights: int):
        self.first, self.count = np.zeros(lights, dtype=np.uint32), np.zeros(lights, dtype=np.uint32)
        self.area, self.share = np.zeros(lights), np.ones(lights)
        self.tables, self.upto, self.size = [], [], 0

    def add(self, light: int, part: Triangles, whole: float) -> None:
        """Add the triangles of light number ``light``, a part of a mesh of area ``whole``."""
        self.first[light], self.count[light] = self.size, len(part.area)
        self.area[light] = part.area.sum()
        self.share[light] = whole / self.area[light]
        self.tables.append(np.concatenate([part.corners, part.normals], axis=1).reshape(-1, 18))
        self.upto.append(np.cumsum(part.area) / self.area[light])
        self.size += len(part.area)

    def freeze(self):
        """Move all to Dr.Jit arrays."""
        as_float = lambda v: mi.Float(np.asarray(v, dtype=np.float32))  # noqa: E731
        self.first, self.count = mi.UInt32(self.first), mi.UInt32(self.count)
        self.area, self.share = as_float(self.area), as_float(self.share)
        self.tables, self.upto = as_float(np.concatenate(self.tables).ravel()), as_float(np.concatenate(self.upto))
        return self

    @dr.syntax
    def sample(self, it, emitter, l, u, active):
        """Sample a direction towards part ``l`` of a mesh light, uniformly by area, as Mitsuba samples the whole.

        Returns
        -------
        ds : mi.DirectionSample3f
        weight : mi.Spectrum
            Radiance over density.
        """
        first, count = dr.gather(mi.UInt32, self.first, l, active), dr.gather(mi.UInt32, self.count, l, active)
        # The triangle whose share of the part's area holds the second coordinate
        low, high = mi.UInt32(first), first + dr.maximum(count, 1) - 1
        while low < high:
            middle = (low + high) >> 1
            above = dr.gather(mi.Float, self.upto, middle) <= u.y
            low, high = dr.select(above, middle + 1, low), dr.select(above, high, middle)
        end = dr.gather(mi.Float, self.upto, low, active)
        begin = dr.gather(mi.Float, self.upto, low - 1, active & (low > first))
        v = dr.clip((u.y - begin) / dr.maximum(end - begin, 1e-30), 0, 1)
        row = [dr.gather(mi.Vector3f, self.tables, low * 6 + k, active) for k in range(6)]
        t = dr.sqrt(1 - u.x)
        b1, b2 = 1 - t, t * v
        p = row[0] + (row[1] - row[0]) * b1 + (row[2] - row[0]) * b2
        n = dr.normalize(row[3] + (row[4] - row[3]) * b1 + (row[5] - row[3]) * b2)

        ds = dr.zeros(mi.DirectionSample3f)
        ds.p, ds.n, ds.time, ds.delta = mi.Point3f(p), mi.Normal3f(n), it.time, mi.Bool(False)
        ds.emitter = emitter
        d = p - it.p
        d2 = dr.squared_norm(d)
        ds.dist = dr.sqrt(d2)
        ds.d = d / ds.dist
        cos = dr.dot(ds.d, n)
        pdf = d2 / (dr.abs(cos) * dr.gather(mi.Float, self.area, l, active))
        active = active & (cos < 0) & dr.isfinite(pdf)
        ds.pdf = dr.select(active, pdf, 0)
        return ds, dr.select(active, emitter.eval_direction(it, ds, active) / pdf, 0)
