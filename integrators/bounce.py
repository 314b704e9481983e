"""Light that arrives over two or more bounces: Mitsuba-style path tracing from a first hit onwards."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def _finite(value):
    return dr.select(dr.all(dr.isfinite(value)), value, 0)


@dr.syntax
def indirect(shading, si, seed, index, s, salt, active=True):
    """Estimate the light that reaches a first hit from other surfaces, direct light excluded; and whether it covers a pixel.

    As in Mitsuba's ``path``, a pixel is covered where a path does more than pass straight through (masks, ``null``), and
    everywhere before an environment that is shown. One that is hidden stays hidden behind surfaces passed straight through.

    Parameters
    ----------
    shading : Shading
        ``depth`` is Mitsuba's ``max_depth`` (-1: no limit), ``rr_depth`` where Russian roulette begins.
    si : mi.SurfaceInteraction3f
        First hits.
    seed, index, s, salt : mi.UInt32
        Render seed, pixel, number of the hit in its pixel, and pass.
    active : mi.Bool, optional
        Which of them are wanted.

    Returns
    -------
    value : mi.Spectrum
    covered : mi.Float
        Alpha, 0 or 1.
    """
    scene = shading.scene
    a, b = mi.sample_tea_32(index, seed * 2 + salt, 4)
    rng = mi.PCG32(initstate=mi.UInt64(a) ^ (mi.UInt64(s) << 32), initseq=mi.UInt64(b))
    context = mi.BSDFContext()
    limit = mi.UInt32(0xFFFFFFFF if shading.depth < 0 else shading.depth)

    # Leave the first hit; what this ray meets first is an emitter already accounted for, or the second vertex
    bsdf = si.bsdf()
    active = si.is_valid() & active
    sample, weight = bsdf.sample(
        context, si, rng.next_float32(), mi.Point2f(rng.next_float32(), rng.next_float32()), active
    )
    value, beta, eta = mi.Spectrum(0), mi.Spectrum(weight), mi.Float(sample.eta)
    straight = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    covered = active & ~straight
    if dr.hint(not shading.hide and scene.environment() is not None, mode="scalar"):
        covered |= True
    active &= dr.any(beta != 0) & (straight | (limit > 2))
    ray = si.spawn_ray(si.to_world(sample.wo))
    depth = mi.UInt32(1)
    first, pdf, delta = mi.Bool(True), mi.Float(1), mi.Bool(True)
    previous = dr.zeros(mi.Interaction3f, dr.width(index))
    while active:
        hit = scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        # Emission met by chance, weighted against having sampled it; the direct light's share is left out
        emitter = hit.emitter(scene, active)
        ds = mi.DirectionSample3f(scene, hit, previous)
        p = scene.pdf_emitter_direction(previous, ds, active & ~delta & ~first)
        mis = dr.select(delta, 1, dr.square(pdf) / dr.maximum(dr.square(pdf) + dr.square(p), 1e-30))
        hidden = first
        if dr.hint(shading.hide, mode="scalar"):
            hidden |= straight & ~hit.is_valid()
        # Densities of what does not shine, such as black environment maps, are not numbers: they add nothing
        value += _finite(dr.select(hidden, 0, beta * emitter.eval(hit, active) * mis))

        here = active & hit.is_valid() & (depth + 1 < limit)
        bsdf = hit.bsdf(ray)
        lit = here & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ds, weight = scene.sample_emitter_direction(
            hit, mi.Point2f(rng.next_float32(), rng.next_float32()), False, lit
        )
        lit &= ds.pdf != 0
        lit &= ~scene.ray_test(hit.spawn_ray_to(shading.lights.end(ds, ds.emitter, hit.p)), lit)
        f, q = bsdf.eval_pdf(context, hit, hit.to_local(ds.d), lit)
        mis = dr.select(ds.delta, 1, dr.square(ds.pdf) / dr.maximum(dr.square(ds.pdf) + dr.square(q), 1e-30))
        value += _finite(dr.select(lit, beta * f * weight * mis, 0))

        sample, weight = bsdf.sample(
            context, hit, rng.next_float32(), mi.Point2f(rng.next_float32(), rng.next_float32()), here
        )
        ray = hit.spawn_ray(hit.to_world(sample.wo))
        beta *= weight
        eta *= sample.eta
        pdf, delta = mi.Float(sample.pdf), mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        straight &= mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
        covered |= active & hit.is_valid() & ~straight
        previous = mi.Interaction3f(hit)
        depth = depth + 1
        first = mi.Bool(False)
        # Russian roulette, as Mitsuba's path tracer does
        survive = dr.minimum(dr.max(beta) * dr.square(eta), 0.95)
        roulette = depth >= shading.rr_depth
        active = here & dr.any(beta != 0) & (~roulette | (rng.next_float32() < survive))
        beta = dr.select(roulette, beta / dr.maximum(survive, 1e-20), beta)
    return _finite(value), dr.select(covered, mi.Float(1), mi.Float(0))
