"""Irradiance at the points of a height field, path traced by Mitsuba: the reference that the fast way is held against."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from intervis.heightfield import HeightField
from intervis.heightfield.surface import normals

BATCH = 1 << 22  # paths a launch


def scene_of(field: HeightField, sky: float, sun, albedo: float):
    """Return a Mitsuba scene of the field's surface under a constant sky and a sun of no size."""
    out = {
        "type": "scene",
        "terrain": field.to_mitsuba({"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}),
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": sky}},
    }
    if sun is not None:
        az, el, w = sun
        to = [np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)]
        out["sun"] = {"type": "directional", "direction": [-x for x in to], "irradiance": {"type": "rgb", "value": w}}
    return mi.load_dict(out)


def path_irradiance(
    field: HeightField, sky: float, sun, albedo: float, bounces: int, samples: int, seed: int = 0, scene=None
):
    """Irradiance of every grid point from cosine-distributed paths.

    Parameters
    ----------
    field : HeightField
        All points known.
    sky, sun, albedo, bounces
        As for `HeightField.irradiance`; ``sun`` without a radius.
    samples : int
        Paths a point.
    seed : int
    scene : mitsuba.Scene, optional
        What `scene_of` returned for the same lights.

    Returns
    -------
    (rows, columns) float64 array
        W/m².
    """
    scene = scene_of(field, sky, sun, albedo) if scene is None else scene
    integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 1000})
    rows, columns = field.heights.shape
    y, x = np.mgrid[:rows, :columns]
    n = normals(field.heights, field.spacing).reshape(3, -1)
    lift = 1e-4 * min(field.spacing)
    place = np.stack([x * field.spacing[1], -y * field.spacing[0], field.heights - field.centre + lift]).reshape(3, -1)
    points = rows * columns
    each = max(min(samples, BATCH // points), 1)
    total = np.zeros(points)
    for launch in range(-(-samples // each)):
        # Stratified directions; every point has its own shuffle of the strata
        sampler = mi.load_dict({"type": "independent", "sample_count": each})
        sampler.set_samples_per_wavefront(each)
        sampler.seed(seed * 9973 + launch, points * each)
        lane = dr.arange(mi.UInt32, points * each)
        i = lane // each
        frame = mi.Frame3f(dr.gather(mi.Vector3f, mi.Vector3f(n.astype(np.float32)), i))
        d = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        ray = mi.Ray3f(dr.gather(mi.Point3f, mi.Point3f(place.astype(np.float32)), i), frame.to_world(d))
        value, _, _ = integrator.sample(scene, sampler, mi.RayDifferential3f(ray))
        total += np.array(dr.block_sum(mi.Float(value.x), each), dtype=np.float64) / each
    e = np.pi * total / -(-samples // each)
    if sun is not None:
        az, el, w = sun
        to = np.array([np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)])
        ray = mi.Ray3f(mi.Point3f(place.astype(np.float32)), mi.Vector3f(*map(float, to)))
        lit = ~np.array(scene.ray_test(ray))
        e += w * np.maximum(to @ n, 0) * lit
    return e.reshape(rows, columns)
