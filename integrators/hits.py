"""How hits begin and end, in both passes: camera rays, BSDF samples, and colours of the film."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .camera import Frame
from .points import net_1d, net_2d, shuffle
from .shading import Shading, Surface


def to_rgb(value, wavelengths):
    """Film colour of a spectral, mono or rgb value."""
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, wavelengths)
    if mi.is_monochromatic:
        return mi.Color3f(value.x)
    return mi.Color3f(value)


def first_hit(shading: Shading, frame: Frame, corner, s, keys):
    """Shoot a primary ray; return the ray, interaction, emitted light, ray weight and film position."""
    ray, weight, position = frame.shoot(corner, s, keys)
    scene = shading.scene
    if shading.hide:
        si = scene.ray_intersect_preliminary(ray, True)
        si = shading.integrator.skip_area_emitters(scene, ray, True, mi.Bool(True))
        si = si.compute_surface_interaction(ray, mi.RayFlags.All)
        emission = mi.Spectrum(0)
    else:
        si = scene.ray_intersect(ray, mi.RayFlags.All, True)
        emission = si.emitter(scene).eval(si) if shading.lights.count else mi.Spectrum(0)
    emission = dr.select(dr.all(dr.isfinite(emission)), emission, 0)
    return ray, si, emission, weight, position


def reflected(shading: Shading, surface: Surface, s, keys, rays, trust, total, active=True):
    """Light found by following one BSDF sample where it is wanted, weighted against the light samples; rays; and the lobe."""
    value, l, pdf, density, traced, lobe = surface.reflect(
        net_1d(shuffle(s, keys[10]), keys[11]), net_2d(shuffle(s, keys[11]), keys[10], keys[6]), surface.follow & active
    )
    chance = mi.Float(1)
    if shading.lights.count > 1:
        top, share = surface.found(l, density > 0)
        chance = dr.select(total > 0, surface.importance(top) * trust(top) / total * share, 0)
    # Balance heuristic, the other side of Surface.integrand
    other = mi.Float(rays) * chance * density
    value *= dr.select(other > 0, pdf / dr.maximum(pdf + other, 1e-30), 1)
    return dr.select(dr.all(dr.isfinite(value)), value, 0), dr.select(traced, mi.UInt32(1), mi.UInt32(0)), lobe
