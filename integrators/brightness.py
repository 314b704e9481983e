"""How bright lights are, found by looking at them: what they send out, and how they are seen."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

_REFERENCE_SAMPLES = 256
# Luminance of a spectrum of ones: the integral of the CIE's y over wavelengths in nm
_WHITE = 106.85689
# What `mi.luminance` weights linear RGB by
_LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


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


def luminance(value, wavelengths) -> np.ndarray:
    """Luminance, as float64, of light whose weight counts the density of its wavelengths; 0 where it is no number."""
    scale = 1 / _WHITE if mi.is_spectral else 1.0
    y = np.array(mi.luminance(value, wavelengths), dtype=np.float64) * scale
    return np.where(np.isfinite(y), np.maximum(y, 0), 0)


def radiance_times_area(emitter, area: float, radiance=None) -> float:
    """Luminance times area of a light's surface: textures, spectra and meshes alike are simply looked at.

    Where it is one ``radiance`` all over, in mono or as linear RGB, that is all.
    """
    if radiance is not None and not mi.is_spectral:
        value = np.array(radiance, dtype=np.float64).ravel()
        value = float(value @ _LUMINANCE) if len(value) == 3 else float(value[0])
        return area * max(value, 0.0) if np.isfinite(value) else 0.0
    leaving = _leaving(emitter, _REFERENCE_SAMPLES)
    return area if leaving is None else float(np.mean(luminance(leaving[1], leaving[0].wavelengths))) / np.pi


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


def brightness_elsewhere(emitter, extent) -> tuple[np.ndarray, np.ndarray, float, float, float]:
    """Place, axis, cosine of the cut-off, radius and brightness of a light without a surface.

    The axis is zero but for spots, the radius −1 at infinity and else 0. The light is probed: from the middle of the
    scene, whose ``extent`` is by `bounds`, then, if it has a place, along the rays that it sends out.
    """
    axis, cutoff = _beam(emitter)
    lower, upper = extent
    centre, size = 0.5 * (lower + upper), max(float(np.linalg.norm(upper - lower)), 1e-6)
    position, value, distance = _probe(emitter, np.repeat(centre[:, None], 64, axis=1))
    # A sun has no place: seen from a wrong one it would be below horizons above which it stands
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite) or not np.all(np.isfinite(distance)):
        # Half of what is all around lies below a surface's horizon
        share = 0.5 if emitter.is_environment() else 1.0
        return centre, axis, cutoff, -1.0, max(share * float(np.mean(value)), 1e-6)
    # A spot may miss the scene's middle: its intensity is looked at along rays that it sends, and counts as its root mean
    # square, over all directions where its cone is not known, so that a narrow beam does not draw the rays of all it misses
    place = position[:, 0]
    leaving = _leaving(emitter, 1024)
    if leaving is None:
        return place, axis, cutoff, 0.0, max(float(np.max(value * distance**2)), 1e-6)
    ray, flux = leaving
    _, value, distance = _probe(emitter, place[:, None] + size * np.array(ray.d, dtype=np.float64))
    square = np.mean(value * distance**2 * luminance(flux, ray.wavelengths)) / (2 * np.pi * (1 - cutoff))
    return place, axis, cutoff, 0.0, max(float(np.sqrt(square)), 1e-6)


def _beam(emitter) -> tuple[np.ndarray, float]:
    # Axis of a spot, and the cosine of the angle around it beyond which there is no light; nought and −1 of other lights
    parameters = mi.traverse(emitter)
    if "cutoff_angle" not in parameters:
        return np.zeros(3), -1.0
    axis = np.array(emitter.world_transform().matrix, dtype=np.float64).reshape(4, 4)[:3, 2]
    angle = float(np.array(parameters["cutoff_angle"]).ravel()[0])
    # A light that shines behind itself too has no half-space that it misses
    return (axis / np.linalg.norm(axis), float(np.cos(np.radians(angle)))) if 0 < angle < 90 else (np.zeros(3), -1.0)


def onlookers(count: int) -> tuple:
    """Return interactions to sample lights from, all at the origin, and the weights of their wavelengths."""
    it, share = dr.zeros(mi.Interaction3f, count), mi.Spectrum(1)
    if mi.is_spectral:
        u = (mi.Float(dr.arange(mi.UInt32, count)) + 0.5) / count
        it.wavelengths, share = mi.sample_rgb_spectrum(mi.sample_shifted(u))
    return it, share


def _probe(emitter, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # Sample a light from some points: where it is seen, how bright, and how far
    it, share = onlookers(points.shape[1])
    it.p = mi.Point3f(points.astype(np.float32))
    i = dr.arange(mi.UInt32, points.shape[1])
    u = mi.Point2f((mi.Float(i % 8) + 0.5) / 8, (mi.Float((i // 8) % 8) + 0.5) / 8)
    ds, weight = emitter.sample_direction(it, u, True)
    value = np.broadcast_to(luminance(weight * share, it.wavelengths), points.shape[1])
    distance = np.broadcast_to(np.array(ds.dist, dtype=np.float64), points.shape[1])
    place = np.broadcast_to(np.array(ds.p, dtype=np.float64), points.shape)
    return place, value, distance
