"""Direct light at a shading point: what is known in closed form, plus rays that correct what was guessed.

With ``g`` a guess of the visibility ``V`` (1, 0 or a cell's fraction) and ``ρ`` the unshadowed integrand,

    ∫ V ρ  =  ∫ g ρ  +  ∫ (V − g) ρ .

The first term needs no rays: it is a polygon's closed form, or a sum over cells. The second is sampled, mostly where the
guess is uncertain. It vanishes where the guess is right, so a fully visible light leaves no noise, and it is unbiased
whatever the guess: the guess only has to come from other samples.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from . import cells
from .clusters import TOPS
from .order import turn
from .points import net_2d
from .rectangle import FLOOR
from .shading import Surface


@dr.syntax
def single_light(surface: Surface, guess, mask, rays, s, s0, s1, refine):
    """Estimate one light's contribution at a hit.

    Parameters
    ----------
    surface : Surface
    guess : mi.UInt64
        Packed visibility guess of the 16 cells; ignored unless ``refine``.
    mask : mi.UInt32
        Undecided cells.
    rays : mi.UInt32
        Shadow rays to trace; none, no light.
    s : mi.UInt32
        Number of the hit in its pixel.
    s0, s1 : mi.UInt32
        Scrambling seeds.
    refine : bool
        Cells carry their own guesses and undecided ones are visited more often.

    Returns
    -------
    value, bright : mi.Spectrum
        Light with and without shadows.
    traced : mi.UInt32
        Shadow rays traced.
    """
    l = mi.UInt32(0)
    value, bright, traced = mi.Spectrum(0), mi.Spectrum(0), mi.UInt32(0)
    active = mi.Bool(surface.active)

    # What the cells' guesses are worth: one jittered point a cell, no rays
    if dr.hint(refine, mode="scalar"):
        jitter = net_2d(s, s1, s0)
        c, stop = mi.UInt32(0), dr.select(active, mi.UInt32(16), mi.UInt32(0))
        while c < stop:
            v = mi.Point2f((mi.Float(c & 3) + jitter.x) * 0.25, (mi.Float(c >> 2) + jitter.y) * 0.25)
            ds, weight = surface.sample(l, v, active)
            rho, useful = surface.integrand(ds, weight, mi.Float(1), active)
            value += rho * (cells.fraction(guess, c) * mi.Float(1 / 16))
            c += 1

    # Rays correct the guess
    r, acc, odd = mi.UInt32(0), mi.Spectrum(0), turn(s, rays)
    while r < rays:
        u = net_2d(s * rays + (r ^ odd), s0, s1)
        density, g = mi.Float(1), mi.Float(0)
        if dr.hint(refine, mode="scalar"):
            cell, u, density = cells.sample(mask, u, mi.Float(FLOOR))
            g = cells.fraction(guess, cell)
        ds, weight = surface.sample(l, u, active)
        rho, useful = surface.integrand(ds, weight, density, active)
        lit = surface.visible(ds.p, useful)
        acc += rho * (dr.select(lit, mi.Float(1), mi.Float(0)) - g)
        bright += rho
        traced += dr.select(useful, mi.UInt32(1), mi.UInt32(0))
        r += 1
    scale = dr.rcp(mi.Float(dr.maximum(rays, 1)))
    return value + acc * scale, bright * scale, traced


@dr.syntax
def several_lights(surface: Surface, trust, rays, s, keys):
    """Estimate many lights at a hit: one light a ray, chosen by what it would add and how visible it has been.

    The rays' choices are stratified over the lights, so lights that matter equally are visited equally.

    Parameters
    ----------
    surface : Surface
    trust : callable
        Index of a top (a light, or a cluster of lights) to the factor (> 0) by which its importance is scaled.
    rays, s : mi.UInt32
        Rays to trace, and the hit's number in its pixel.
    keys : list of mi.UInt32
        Two scrambling seeds.

    Returns
    -------
    value, bright : mi.Spectrum
        Light with and without shadows.
    traced : mi.UInt32
    total : mi.Float
        Sum of the tops' scaled importances: a top's over this is its chance.
    """
    lights = surface.shading.lights
    active = mi.Bool(surface.active)
    # Sums of the tops' importances up to each. Dr.Jit 1.5 takes kernels that differ in local memory's size alone for one,
    # and would run this scene's with another's: it is always of one size, which is a constant below, too
    upto = dr.alloc_local(mi.Float, TOPS)
    count = dr.opaque(mi.UInt32, lights.tops)
    # Of full width from the start: local memory is a lane's own
    none = 0 * s
    l, total = mi.UInt32(none), mi.Float(none)
    while l < count:
        total += surface.importance(l) * trust(l)
        upto.write(total, l)
        l += 1
    active &= total > 0

    value, bright, traced = mi.Spectrum(0), mi.Spectrum(0), mi.UInt32(0)
    r, odd = mi.UInt32(0), turn(s, rays)
    while active & (r < rays):
        # One net over all lights, each as wide as it is important
        u = net_2d(s * rays + (r ^ odd), keys[0], keys[1])
        target = u.x * total
        l, high = mi.UInt32(none), dr.minimum(none + count, TOPS) - 1
        while l < high:
            middle = (l + high) >> 1
            above = upto.read(middle) <= target
            l, high = dr.select(above, middle + 1, l), dr.select(above, high, middle)
        before = dr.select(l > 0, upto.read(dr.maximum(l, 1) - 1), 0)
        weight = upto.read(l) - before
        # A light takes over the rest of the coordinate
        u.x = dr.clip((target - before) / dr.maximum(weight, 1e-30), 0, 1 - 2**-20)
        chosen, share, u.x = surface.find(l, u.x, active & (weight > 0))
        chance = weight / total * share
        ds, w = surface.sample(chosen, u, active & (chance > 0))
        rho, useful = surface.integrand(ds, w, chance, active & (chance > 0))
        lit = surface.visible(ds.p, useful)
        bright += rho
        value += dr.select(lit, rho, 0)
        traced += dr.select(useful, mi.UInt32(1), mi.UInt32(0))
        r += 1
    scale = dr.rcp(mi.Float(dr.maximum(rays, 1)))
    return value * scale, bright * scale, traced, total
