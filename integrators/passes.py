"""The two passes over the pixels: a pilot that looks, and a main pass that spends rays where the pilot was undecided."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from . import cells
from .bounce import indirect
from .camera import Frame, scramble
from .clusters import COUNTED
from .estimate import several_lights, single_light
from .glints import Shine
from .guide import Counts
from .points import net_1d, net_2d, shuffle
from .proof import tolerance, unobstructed
from .rectangle import rectangle_light
from .shading import Shading, Surface


@dataclass
class Pilot:
    """What one hit and a few shadow rays a pixel have found; arrays of one entry a pixel."""

    value: object  # mi.Color3f, light reflected
    control: object  # mi.Color3f, closed form minus its own sample mean: times the guess, added to value
    bright: object  # mi.Color3f, light reflected were nothing in the way
    noise: object  # mi.Float, variance of `bright` from the light samples alone, were there one of them
    rays: int  # light samples a hit
    straight: object  # mi.Color3f, light that shadows cannot change: from emitters in view, and what BSDF samples found
    alpha: object  # mi.Float
    position: object  # mi.Point2f, film position
    normal: object  # mi.Vector3f, shading normal at the hit, zero on a miss
    point: object  # mi.Point3f
    seen: list  # packed counters by cell, then by light
    tried: list
    traced: object  # mi.UInt32, shadow rays
    reflected: object  # mi.UInt32, rays by BSDF sampling
    sky: Counts | None  # light samples of the sky
    proven: object  # mi.Float, radius within which of `point` nothing can stand before the light; 0 where unknown
    probe_bright: object = None  # mi.Float, luminance of `bright` at another hit of the pixel, for decisions only
    probe_straight: object = None  # mi.Float
    unlike: object = None  # mi.Float, variance of a hit by what BSDF samples find alone, if any surface is shiny
    shine: Shine | None = None  # at that other hit, if any surface is shiny
    glints: tuple | None = None  # mean and variance of highlights within pixels, and doubt of what mirrors: see `glints`
    lamps: object = None  # mi.Float, luminance of lamps in view, by light samples from the camera
    lamps_squared: object = None  # mi.Float, mean square of the same


def to_rgb(value, wavelengths):
    """Film colour of a spectral, mono or rgb value."""
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, wavelengths)
    if mi.is_monochromatic:
        return mi.Color3f(value.x)
    return mi.Color3f(value)


def first_hit(shading: Shading, frame: Frame, corner, s, keys):
    """Shoot a primary ray; return the ray, interaction, emitted light, ray weight, film position and coverage."""
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


def _trusting(shading: Shading, seen: list, tried: list):
    """Factor of each top's importance: lower for lights of which the neighbours' pilots saw nothing.

    How much of the others is visible a few rays do not tell well enough: choosing by that cost more than it gained.
    """
    if not seen:
        return lambda l: mi.Float(1)

    def trust(top):
        l = shading.lights.counter(top)
        shift = mi.UInt64((l & 7) << 3)
        word = lambda words: dr.select(l < 8, words[0], words[-1])  # noqa: E731
        v = mi.Float(mi.UInt32((word(seen) >> shift) & 255))
        n = mi.Float(mi.UInt32((word(tried) >> shift) & 255))
        return dr.select(v > 0, 1, dr.rsqrt(n + 1))

    return trust


def _reflected(shading: Shading, surface: Surface, s, keys, rays, trust, total, active=True):
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


@dr.syntax
def pilot(shading: Shading, frame: Frame, seed, rays: int, probe: bool) -> Pilot:
    """One camera hit and ``rays`` light samples a pixel; and, to ``probe``, another hit without shadow rays."""
    index = dr.arange(mi.UInt32, frame.pixels)
    keys = scramble(index, seed, 0)
    s, count = mi.UInt32(0), dr.opaque(mi.UInt32, rays)
    ray, si, straight, weight, position = first_hit(shading, frame, frame.corner(index), s, keys)
    surface = Surface(shading, si, si.is_valid(), count)
    lights = shading.lights
    grid = dr.opaque(mi.UInt32, shading.grid)

    # Choose a light for every ray in proportion to what it could add
    total, chance, l = mi.Float(0), mi.Float(1), mi.UInt32(0)
    several = lights.count > 1
    if dr.hint(several, mode="scalar"):
        number, k = dr.opaque(mi.UInt32, lights.tops), mi.UInt32(0)
        while k < number:
            total += surface.importance(k)
            k += 1
    active = surface.active & (lights.count > 0)
    if dr.hint(several, mode="scalar"):
        active &= total > 0
    proven, radius = mi.Bool(False), mi.Float(0)
    if shading.blockers is not None:
        radius = _footprint(frame, position, si)
        proven = unobstructed(shading.blockers, surface.rectangle(), radius, active)
    unsure = active & ~proven

    seen, tried = cells.empty(16), cells.empty(16)
    sky = None if lights.sky is None else Counts.empty(frame.width, frame.height)
    light_seen, light_tried = cells.empty(COUNTED), cells.empty(COUNTED)
    lit_sum, all_sum, squares, traced = mi.Spectrum(0), mi.Spectrum(0), mi.Float(0), mi.UInt32(0)
    r, before, weight_l, chosen = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.UInt32(0)
    if dr.hint(several, mode="scalar"):
        weight_l = surface.importance(l)
    if dr.hint(lights.count > 0, mode="scalar"):
        while unsure & (r < count):
            u = net_2d(r, keys[8], keys[9])
            if dr.hint(several, mode="scalar"):
                salt = r * mi.UInt32(0x9E3779B9)
                u = net_2d(s, keys[8] ^ salt, keys[9] ^ salt)
                target = (mi.Float(r) + u.x) / mi.Float(count) * total
                while (before + weight_l <= target) & (l + 1 < dr.opaque(mi.UInt32, lights.tops)):
                    before += weight_l
                    l += 1
                    weight_l = surface.importance(l)
                u.x = dr.clip((target - before) / dr.maximum(weight_l, 1e-30), 0, 1 - 2**-20)
                chosen, share, u.x = surface.find(l, u.x, unsure & (weight_l > 0))
                chance = weight_l / total * share
            ds, w = surface.sample(chosen, u, active & (chance > 0))
            rho, useful = surface.integrand(ds, w, chance, active & (chance > 0))
            lit = surface.visible(ds.p, useful)
            cell = mi.UInt32(u.y * grid) * 4 + mi.UInt32(u.x * grid)
            tried, seen = cells.count(tried, cell, useful), cells.count(seen, cell, lit)
            if dr.hint(sky is not None, mode="scalar"):
                it = chosen == lights.sky.index
                sky.add(sky.tile(index), u, useful & it, lit & it)
            if dr.hint(several, mode="scalar"):
                counter = lights.counter(l)
                light_tried, light_seen = cells.count(light_tried, counter, useful), cells.count(light_seen, counter, lit)
            all_sum += rho
            squares += dr.square(mi.luminance(to_rgb(rho * weight, ray.wavelengths)))
            lit_sum += dr.select(lit, rho, 0)
            traced += dr.select(useful, mi.UInt32(1), mi.UInt32(0))
            r += 1
    if dr.hint(shading.blockers is not None, mode="scalar"):
        tried, seen = (cells.sure(words, proven, shading.grid, rays) for words in (tried, seen))
    scale = mi.Float(1) / mi.Float(count)
    all_sum, lit_sum = all_sum * scale, lit_sum * scale
    control, bright, noise = mi.Spectrum(0), mi.Spectrum(all_sum), mi.Float(0)
    if dr.hint(rays > 1 and not (shading.closed and shading.lambert), mode="scalar"):
        # How much light samples differ inside one hit; a closed form has no such noise
        noise = squares * scale - dr.square(mi.luminance(to_rgb(all_sum * weight, ray.wavelengths)))
        noise = dr.maximum(noise, 0) * mi.Float(rays / (rays - 1))
    reflected, found = mi.UInt32(0), mi.Float(0)
    if dr.hint(lights.count > 0 and shading.follows, mode="scalar"):
        extra, reflected, _ = _reflected(shading, surface, s, keys, count, lambda l: mi.Float(1), total)
        straight += extra
        found = mi.luminance(to_rgb(extra * weight, ray.wavelengths))
    if dr.hint(shading.closed, mode="scalar"):
        light, plain = surface.rectangle(), surface.plain
        whole = light.radiance * light.unshadowed()
        control = dr.select(plain & ~surface.follow & ~proven, whole - all_sum, 0)
        bright, noise = dr.select(plain, whole, bright), dr.select(plain, 0, noise)
        lit_sum = dr.select(proven, whole, lit_sum)
    covered = dr.select(si.is_valid(), mi.Float(1), mi.Float(0))
    if dr.hint(shading.path, mode="scalar"):
        beyond, covered = indirect(shading, si, seed, index, s, mi.UInt32(0))
        straight += beyond
    lam = ray.wavelengths
    hit = si.is_valid()
    return Pilot(
        to_rgb(lit_sum * weight, lam),
        to_rgb(control * weight, lam),
        to_rgb(bright * weight, lam),
        noise,
        rays,
        to_rgb(straight * weight, lam),
        covered,
        position,
        dr.select(hit, surface.facing(), 0),
        dr.select(hit, si.p, 0),
        seen + (light_seen if several else []),
        tried + (light_tried if several else []),
        traced,
        reflected,
        sky,
        dr.select(proven, radius, 0),
        *(_probe(shading, frame, seed, index, count, found) if probe else ()),
    )


def _probe(shading: Shading, frame: Frame, seed, index, rays, found):
    """Light of another hit a pixel, whose luminance tells of edges inside the pixel; how unlike that is which was found."""
    keys = scramble(index, seed, 2)
    # As wide as the film: lights keep their importances lane by lane
    s = 0 * index
    ray, si, straight, weight, _ = first_hit(shading, frame, frame.corner(index), s, keys)
    surface = Surface(shading, si, si.is_valid(), rays)
    surface.blind = True
    full, total, shine, extra = mi.Spectrum(0), mi.Float(0), None, mi.Spectrum(0)
    if shading.lights.count == 1 and not (shading.closed and shading.lambert):
        full = single_light(surface, mi.UInt64(0), mi.UInt32(0), rays, s, keys[8], keys[9], False)[1]
    elif shading.lights.count > 1:
        _, full, _, total = several_lights(surface, lambda l: mi.Float(1), rays, s, [keys[8], keys[9]])
    if shading.lights.count and shading.follows and not (shading.closed and shading.lambert):
        extra, _, (lobe, strength, n) = _reflected(shading, surface, s, keys, rays, lambda l: mi.Float(1), total)
        straight += extra
        if not shading.lambert:
            hit = si.is_valid()
            shine = Shine(dr.select(hit, si.p, 0), dr.select(hit, n, 0), lobe, strength, surface.matt)
    if shading.closed:
        light = surface.rectangle()
        full = dr.select(surface.plain, light.radiance * light.unshadowed(), full)
    full, straight, other = (mi.luminance(to_rgb(x * weight, ray.wavelengths)) for x in (full, straight, extra))
    return full, straight, None if shine is None else 0.5 * dr.square(other - found), shine


def _footprint(frame: Frame, position, si):
    """How far from a hit its pixel can reach on the surface's plane, by rays one pixel off along both diagonals."""
    reach = mi.Float(0)
    for x, y in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
        ray, _ = frame.ray(position + mi.Vector2f(x, y))
        t = dr.dot(si.p - ray.o, si.n) / dr.dot(ray.d, si.n)
        reach = dr.maximum(reach, dr.select(t > 0, dr.norm(ray.o + t * ray.d - si.p), dr.inf))
    return reach


def _proven(shading: Shading, look: Pilot, index, surface: Surface):
    """Whether a hit lies where its pixel's pilot has proven the light to be visible."""
    if shading.blockers is None:
        return mi.Bool(False)
    d = surface.si.p - dr.gather(mi.Point3f, look.point, index)
    n = dr.gather(mi.Normal3f, look.normal, index)
    near = dr.squared_norm(d) < dr.square(dr.gather(mi.Float, look.proven, index))
    # One plane, but for rounding
    flat = dr.abs(dr.dot(d, n)) <= 0.5 * tolerance(surface.si.p)
    return near & flat & (dr.squared_norm(n - surface.facing()) < 1e-12)


@dr.syntax
def spend(shading: Shading, frame: Frame, seed, index, s, look: Pilot, decision, refine: bool):
    """Render one more hit a lane.

    Parameters
    ----------
    shading : Shading
    frame : Frame
    seed, index, s : mi.UInt32
        Render seed; each lane's pixel, and which of the pixel's hits it is. Lanes of one pixel lie side by side, so that
        a packet's rays start close together.
    look : Pilot
    decision : Decision
    refine : bool
        Visit undecided light cells more often.

    Returns
    -------
    colour, bright, straight : mi.Color3f
        Light at the hit; what it would be without shadows; the part that shadows cannot change.
    covered : mi.Float
        Alpha: 1 where a surface was hit, in paths where one did more than let the ray pass.
    position : mi.Point2f
        Film position.
    traced, spared, reflected : mi.UInt32
        Shadow rays, those that a proof of visibility made needless, and BSDF rays.
    """
    keys = scramble(index, seed, 1)
    mean = dr.gather(mi.Float, decision.mean, index)
    rays = dr.gather(mi.UInt32, decision.rays, index)
    guess, mask = mi.UInt64(0), mi.UInt32(0)
    if dr.hint(refine, mode="scalar"):
        guess, mask = dr.gather(mi.UInt64, decision.guess, index), dr.gather(mi.UInt32, decision.mask, index)
    seen = [dr.gather(mi.UInt64, w, index) for w in decision.light_seen]
    tried = [dr.gather(mi.UInt64, w, index) for w in decision.light_tried]
    trust = _trusting(shading, seen, tried)

    ray, si, straight, weight, position = first_hit(shading, frame, frame.corner(index), s, keys)
    surface = Surface(shading, si, si.is_valid(), rays)
    if decision.sky is not None:
        surface.guide, surface.tile = decision.sky, decision.sky.tile(index)
    value, full, total = mi.Spectrum(0), mi.Spectrum(0), mi.Float(0)
    traced, spared = mi.UInt32(0), mi.UInt32(0)
    closed_only = shading.closed and shading.lambert
    if dr.hint(shading.lights.count == 0, mode="scalar"):
        traced = mi.UInt32(0)
    elif dr.hint(shading.lights.count == 1 and not closed_only, mode="scalar"):
        # Where there is a closed form, no rays here
        sampled = dr.select(surface.plain, 0, rays) if shading.closed else rays
        value, full, traced = single_light(surface, guess, mask, sampled, s, keys[8], keys[9], refine)
    elif dr.hint(shading.lights.count > 1, mode="scalar"):
        value, full, traced, total = several_lights(surface, trust, rays, s, [keys[8], keys[9]])
    reflected = mi.UInt32(0)
    if dr.hint(shading.lights.count > 0 and shading.follows and not closed_only, mode="scalar"):
        elsewhere = ~surface.plain if shading.closed else True
        extra, reflected, _ = _reflected(shading, surface, s, keys, rays, trust, total, elsewhere)
        straight += extra
    if dr.hint(shading.closed, mode="scalar"):
        some = dr.select(surface.plain, rays, 0)
        proven = _proven(shading, look, index, surface)
        known, unshadowed, further, spared = rectangle_light(surface, guess, mask, mean, some, s, keys, refine, proven)
        value, full, traced = value + known, full + unshadowed, traced + further
    covered = dr.select(si.is_valid(), mi.Float(1), mi.Float(0))
    if dr.hint(shading.path, mode="scalar"):
        beyond, covered = indirect(shading, si, seed, index, s, mi.UInt32(1))
        straight += beyond
    lam = ray.wavelengths
    return (
        to_rgb((value + straight) * weight, lam),
        to_rgb(full * weight, lam),
        to_rgb(straight * weight, lam),
        covered,
        position,
        traced,
        spared,
        reflected,
    )
