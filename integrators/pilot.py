"""The first pass over the pixels: a pilot that looks."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from . import cells
from .bounce import indirect
from .camera import Frame, scramble
from .clusters import COUNTED
from .glints import Shine
from .guide import Counts
from .hits import first_hit, reflected, to_rgb
from .points import net_2d
from .proof import unobstructed
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
    found: object  # mi.Float, luminance of what BSDF samples found
    probe_bright: object = None  # mi.Float, luminance of `bright` at another hit of the pixel, for decisions only
    probe_straight: object = None  # mi.Float
    unlike: object = None  # mi.Float, variance of a hit by what BSDF samples find alone, if any surface is shiny
    shine: Shine | None = None  # at that other hit, if any surface is shiny
    glints: tuple | None = None  # mean and variance of highlights within pixels, and doubt of what mirrors: see `glints`
    lamps: object = None  # mi.Float, luminance of lamps in view, by light samples from the camera
    lamps_squared: object = None  # mi.Float, mean square of the same


def pilot(shading: Shading, frame: Frame, seed, rays: int, probe: bool) -> Pilot:
    """One camera hit and ``rays`` light samples a pixel; and, to ``probe``, another hit without shadow rays."""
    pixels, index = dr.opaque(mi.UInt32, frame.pixels), dr.arange(mi.UInt32, frame.pixels)
    if probe and not shading.lambert:
        # Both in one launch: for each, Mitsuba traces all materials of the scene anew
        lane = dr.arange(mi.UInt32, 2 * frame.pixels)
        first = lane < pixels
        both = _look(shading, frame, seed, dr.select(first, lane, lane - pixels), first, rays)
        dr.eval(vars(both))
        look, other = _rows(both, index), _rows(both, index + pixels)
    else:
        look = _look(shading, frame, seed, index, True, rays)
        other = _look(shading, frame, seed, index, False, rays) if probe else None
    if other is not None:
        look.probe_bright, look.probe_straight = mi.luminance(other.bright), mi.luminance(other.straight)
        look.reflected = look.reflected + other.reflected
        look.unlike = None if look.shine is None else 0.5 * dr.square(look.found - other.found)
        look.shine = other.shine
    return look


def _rows(value, at):
    # Some lanes of all that a look has found
    if isinstance(value, (Pilot, Shine)):
        return type(value)(**{name: _rows(v, at) for name, v in vars(value).items()})
    if isinstance(value, list):
        return [_rows(v, at) for v in value]
    if value is None or isinstance(value, (int, Counts)) or dr.width(value) == 1:
        return value
    return dr.gather(type(value), value, at)


@dr.syntax
def _look(shading: Shading, frame: Frame, seed, index, first, rays: int):
    # What hits of pixels ``index`` find: ``first`` ones, all, some (a mask) or none; others trace no shadow rays
    first, some = mi.Bool(first), first is not False
    keys = scramble(index, seed, dr.select(first, mi.UInt32(0), mi.UInt32(2)))
    s, count = mi.UInt32(0), dr.opaque(mi.UInt32, rays)
    ray, si, straight, weight, position = first_hit(shading, frame, frame.corner(index), s, keys)
    hit = si.is_valid()
    surface = Surface(shading, si, hit, count)
    lights = shading.lights
    grid = dr.opaque(mi.UInt32, shading.grid)

    # Choose a light for every ray in proportion to what it could add
    total, chance, l = mi.Float(0), mi.Float(1), mi.UInt32(0)
    several, closed_only = lights.count > 1, shading.closed and shading.lambert
    sampled = lights.count > 0 and (some or not closed_only)
    if dr.hint(several, mode="scalar"):
        number, k = dr.opaque(mi.UInt32, lights.tops), mi.UInt32(0)
        while k < number:
            total += surface.importance(k)
            k += 1
    active = surface.active & (lights.count > 0)
    if dr.hint(several, mode="scalar"):
        active &= total > 0
    proven, radius = mi.Bool(False), mi.Float(0)
    if shading.blockers is not None and some:
        radius = _footprint(frame, position, si)
        proven = unobstructed(shading.blockers, surface.rectangle(), radius, active & first)
    unsure = active & ~proven

    seen, tried = cells.empty(16), cells.empty(16)
    sky = Counts.empty(frame.width, frame.height) if some and lights.sky is not None else None
    light_seen, light_tried = cells.empty(COUNTED), cells.empty(COUNTED)
    lit_sum, all_sum, squares, traced = mi.Spectrum(0), mi.Spectrum(0), mi.Float(0), mi.UInt32(0)
    r, before, weight_l, chosen = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.UInt32(0)
    if dr.hint(several, mode="scalar"):
        weight_l = surface.importance(l)
    if dr.hint(sampled, mode="scalar"):
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
            useful &= first
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
    if dr.hint(shading.blockers is not None and some, mode="scalar"):
        tried, seen = (cells.sure(words, proven, shading.grid, rays) for words in (tried, seen))
    scale = mi.Float(1) / mi.Float(count)
    all_sum, lit_sum = all_sum * scale, lit_sum * scale
    control, bright, noise = mi.Spectrum(0), mi.Spectrum(all_sum), mi.Float(0)
    if dr.hint(rays > 1 and not closed_only, mode="scalar"):
        # How much light samples differ inside one hit; a closed form has no such noise
        noise = squares * scale - dr.square(mi.luminance(to_rgb(all_sum * weight, ray.wavelengths)))
        noise = dr.maximum(noise, 0) * mi.Float(rays / (rays - 1))
    followed, found, shine = mi.UInt32(0), mi.Float(0), None
    if dr.hint(sampled and shading.follows, mode="scalar"):
        even = lambda l: mi.Float(1)  # noqa: E731
        extra, followed, (lobe, strength, n) = reflected(shading, surface, s, keys, count, even, total)
        straight += extra
        found = mi.luminance(to_rgb(extra * weight, ray.wavelengths))
        if not shading.lambert:
            shine = Shine(dr.select(hit, si.p, 0), dr.select(hit, n, 0), lobe, strength, surface.matt)
    if dr.hint(shading.closed, mode="scalar"):
        light, plain = surface.rectangle(), surface.plain
        whole = light.radiance * light.unshadowed()
        control = dr.select(plain & ~surface.follow & ~proven, whole - all_sum, 0)
        bright, noise = dr.select(plain, whole, bright), dr.select(plain, 0, noise)
        lit_sum = dr.select(proven, whole, lit_sum)
    covered = dr.select(hit, mi.Float(1), mi.Float(0))
    if dr.hint(shading.path and some, mode="scalar"):
        beyond, covered = indirect(shading, si, seed, index, s, mi.UInt32(0), first)
        straight += beyond

    lam = ray.wavelengths
    return Pilot(
        value=to_rgb(lit_sum * weight, lam),
        control=to_rgb(control * weight, lam),
        bright=to_rgb(bright * weight, lam),
        noise=noise,
        rays=rays,
        straight=to_rgb(straight * weight, lam),
        alpha=covered,
        position=position,
        normal=dr.select(hit, surface.facing(), 0),
        point=dr.select(hit, si.p, 0),
        seen=seen + (light_seen if several else []),
        tried=tried + (light_tried if several else []),
        traced=traced,
        reflected=followed,
        sky=sky,
        proven=dr.select(proven, radius, 0),
        found=found,
        shine=shine,
    )


def _footprint(frame: Frame, position, si):
    """How far from a hit its pixel can reach on the surface's plane, by rays one pixel off along both diagonals."""
    reach = mi.Float(0)
    for x, y in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
        ray, _ = frame.ray(position + mi.Vector2f(x, y))
        t = dr.dot(si.p - ray.o, si.n) / dr.dot(ray.d, si.n)
        reach = dr.maximum(reach, dr.select(t > 0, dr.norm(ray.o + t * ray.d - si.p), dr.inf))
    return reach
