"""Irradiance at the points of a height field, path traced by Mitsuba: the reference that the fast way is held against."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from intervis.heightfield import HeightField
from intervis.heightfield.surface import normals

BATCH = 1 << 22  # paths a launch
LIFT = 1e-4, 1e-4  # cells above the surface: where paths start, and from where the sun is looked at
CLEAR, TILE = (5e-3, 1e-5), 48  # the same for the reference, and samples of its tiles, a side


def scene_of(field: HeightField, sky: float, sun, albedo: float, origin=(0.0, 0.0, 0.0)):
    """Return a Mitsuba scene of the field's surface under a constant sky and a sun of no size; ``origin`` lies at 0."""
    terrain = field.to_mitsuba({"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}})
    out = {
        "type": "scene",
        "terrain": {**terrain, "to_world": mi.ScalarTransform4f().translate([-float(v) for v in origin])},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": sky}},
    }
    if sun is not None:
        az, el, w = sun
        to = [np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)]
        out["sun"] = {"type": "directional", "direction": [-x for x in to], "irradiance": {"type": "rgb", "value": w}}
    return mi.load_dict(out)


def path_irradiance(
    field: HeightField, sky: float, sun, albedo: float, bounces: int, samples: int, seed: int = 0, scene=None,
    window=None, lift=LIFT,
):  # fmt: skip
    """Irradiance of every grid point, or those of a window, from cosine-distributed paths.

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
        What `scene_of` returned for the same lights, the whole field and no origin.
    window : (slice, slice), optional
        Rows and columns of the receivers, in the middle of which the origin is laid.
    lift : (float, float)
        Cells above the surface where paths start, and from where the sun is looked at.

    Returns
    -------
    (rows, columns) float64 array
        W/m².
    """
    integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 1000})
    rows, columns = field.heights.shape
    y, x = np.mgrid[:rows, :columns]
    n, place = (
        normals(field.heights, field.spacing),
        [x * field.spacing[1], -y * field.spacing[0], field.heights - field.centre],
    )
    place = np.stack(place)
    if window is not None:
        n, place = n[(slice(None), *window)], place[(slice(None), *window)]
    (rows, columns), n, place = n.shape[1:], n.reshape(3, -1), place.reshape(3, -1)
    if window is not None:
        middle = (place.min(axis=1) + place.max(axis=1)) / 2
        scene, place = scene_of(field, sky, sun, albedo, middle), place - middle[:, None]
    elif scene is None:
        scene = scene_of(field, sky, sun, albedo)
    start = place + np.array([[0], [0], [lift[0] * min(field.spacing)]])
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
        ray = mi.Ray3f(dr.gather(mi.Point3f, mi.Point3f(start.astype(np.float32)), i), frame.to_world(d))
        value, _, _ = integrator.sample(scene, sampler, mi.RayDifferential3f(ray))
        total += np.array(dr.block_sum(mi.Float(value.x), each), dtype=np.float64) / each
    e = np.pi * total / -(-samples // each)
    if sun is not None:
        az, el, w = sun
        to = np.array([np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)])
        place[2] += lift[1] * min(field.spacing)
        ray = mi.Ray3f(mi.Point3f(place.astype(np.float32)), mi.Vector3f(*map(float, to)))
        lit = ~np.array(scene.ray_test(ray))
        e += w * np.maximum(to @ n, 0) * lit
    return e.reshape(rows, columns)


def reference(field: HeightField, *light, samples: int, seed: int) -> np.ndarray:
    """Irradiance as `path_irradiance` finds it, ``light`` its arguments from sky to bounces, without light that leaks.

    Mitsuba moves the start of each ray off its surface by 9e-5 of its distance from the origin. At the foot of a wall that
    pushes it through the other wall: so the origin is moved along, and paths start further above the surface than that.
    """
    out = np.empty(field.heights.shape)
    for r in range(0, out.shape[0], TILE):
        for c in range(0, out.shape[1], TILE):
            window = slice(r, r + TILE), slice(c, c + TILE)
            # Other numbers in every tile
            own = seed + 100 * (r // TILE * -(-out.shape[1] // TILE) + c // TILE)
            out[window] = path_irradiance(field, *light, samples, own, window=window, lift=CLEAR)
    return out
