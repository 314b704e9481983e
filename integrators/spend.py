"""The second pass over the pixels: rays are spent where the pilot was undecided."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .bounce import indirect
from .camera import Frame, scramble
from .estimate import several_lights, single_light
from .hits import first_hit, reflected, to_rgb
from .pilot import Pilot
from .proof import tolerance
from .rectangle import rectangle_light
from .shading import Shading, Surface


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
    traced, spared, followed : mi.UInt32
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
    followed = mi.UInt32(0)
    if dr.hint(shading.lights.count > 0 and shading.follows and not closed_only, mode="scalar"):
        elsewhere = ~surface.plain if shading.closed else True
        extra, followed, _ = reflected(shading, surface, s, keys, rays, trust, total, elsewhere)
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
        followed,
    )
