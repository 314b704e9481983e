"""Lamps in view: what they send through each pixel, by light samples from the camera; looks miss those below a pixel."""

from __future__ import annotations

import re

import drjit as dr
import mitsuba as mi

from .camera import scramble
from .hits import to_rgb
from .points import net_1d, net_2d
from .shading import Shading

SHARE = 1 / 512  # of the rays of a render that may go here
MOST = 256  # samples of a light
LENS = 16  # points of a lens that a sample is seen from


def samples_of(shading: Shading, sensor, rays: int) -> int:
    """Return how many samples each light gets in a render of so many rays: 0 if lamps are hidden, or not placed on films."""
    placed = re.match("PerspectiveCamera|ThinLensCamera", str(sensor)) and not shading.hide
    return min(MOST, int(rays * SHARE) // shading.lights.count) if placed and shading.lights.count else 0


@dr.syntax
def in_view(shading: Shading, frame, seed, samples: int):
    """Estimate the mean and the mean square of lamps' luminance in each pixel.

    Parameters
    ----------
    shading : Shading
    frame : Frame
        Of a camera that can tell where on its film a point appears.
    seed : mi.UInt32
    samples : int
        Light samples a lamp, one shadow ray each.

    Returns
    -------
    mean, square : mi.Float
    traced : mi.UInt32
        Shadow rays that went to look.
    """
    lights, sensor = shading.lights, frame.sensor
    lane = dr.arange(mi.UInt32, lights.count * samples)
    l = lane // dr.opaque(mi.UInt32, samples)
    keys = scramble(l, seed, 3)
    ray, weight = frame.ray(mi.Point2f(0.5), wavelength=net_1d(lane, keys[0]))
    eye = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
    # Lamps as the middle of the lens sees them
    eye.p, eye.wavelengths = mi.Point3f(sensor.world_transform().translation()), ray.wavelengths
    lamp = dr.gather(mi.Float, lights.table, 12 * l + 3) >= 0
    ds, radiance = lights.sample(eye, l, net_2d(lane, keys[1], keys[2]), lamp)
    # A camera's response to a direction integrates to one over its film
    y = mi.luminance(to_rgb(radiance * weight, ray.wavelengths))
    useful = lamp & ~ds.delta & (y > 0) & dr.isfinite(y * y * ds.pdf)
    at = dr.zeros(mi.Interaction3f, dr.width(lane))
    at.p, at.wavelengths = ds.p, ray.wavelengths
    view, response = sensor.sample_direction(at, mi.Point2f(0.5))
    if dr.hint(not frame.lens, mode="scalar"):
        useful &= mi.unpolarized_spectrum(response)[0] > 0
    seen = useful & ~shading.scene.ray_test(eye.spawn_ray_to(ds.p), useful)
    traced = dr.zeros(mi.UInt32, frame.pixels)
    dr.scatter_add(traced, mi.UInt32(1), _pixel(frame, view.uv), useful)

    # Out of focus a point of a lamp is in many pixels, as seen from many points of the lens
    mean, square = (dr.zeros(mi.Float, frame.pixels) for _ in range(2))
    points = LENS if frame.lens else 1
    scale = dr.opaque(mi.Float, frame.crop.x * frame.crop.y / (samples * points))
    k, count = mi.UInt32(0), dr.opaque(mi.UInt32, points)
    while k < count:
        view, response = sensor.sample_direction(at, net_2d(lane * count + k, keys[3], keys[4]))
        share = mi.unpolarized_spectrum(response)[0] * dr.square(view.dist) * scale
        pixel, inside = _pixel(frame, view.uv), seen & (share > 0)
        dr.scatter_add(mean, y * share, pixel, inside)
        dr.scatter_add(square, y * share * y * ds.pdf, pixel, inside)
        k += 1
    return mean, square, traced


def _pixel(frame, uv):
    # Number of the pixel at a place on the film; the nearest of those outside
    width, height = (dr.opaque(mi.Int32, n) for n in (frame.width, frame.height))
    x, y = (mi.Int32(dr.floor(c)) + frame.border for c in (uv.x, uv.y))
    return mi.UInt32(dr.clip(y, 0, height - 1) * width + dr.clip(x, 0, width - 1))
