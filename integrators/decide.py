"""From pilot counts to decisions: a class for every pixel, guesses for its light cells, and how many rays to spend."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..visibility import VisibilityClass, classify_grid
from . import cells
from .guide import Guide, guide

PILOT = 4.0  # how much more one full hit is worth than the pilot's
EXPONENT = 0.75  # hits ∝ (expected relative error)^EXPONENT: below Neyman's 1, as errors fall faster than N^-1/2
LEAST = 0.1  # rays for a pixel, however sure its neighbours are of it, as a share of the mean: rare sights stand out in few
PRIOR = 0.005  # doubt about a cell that looked decided: share of the light that the pilots may have missed
FAR = 5  # pixels from one window to the next: with its eight neighbours a window sees 15×15 pixels
AROUND = 0.1  # share of the undecidedness of 15×15 pixels that every pixel there doubts its own look by
RARE = 0.02  # share of what hits in one pixel differ by, over 15×15 pixels: thin things escape most looks nearby
GENTLE = 0.02  # differences of neighbours, relative to their light, below which they are shading rather than edges
HIT_COST = 8.0  # cost of a camera hit in shadow rays
OUTLINE = 0.01  # share of the variance, within 5×5 pixels, of light that no shadow changes: all there are on their guard
BESIDE = 0.03  # the same of lamps within 3×3 pixels, told by light samples from the camera
SMOOTH = 0.3  # where nothing is in the way, light samples vary smoothly: nets leave less of their noise than a ray suggests
MAX_LOG_RAYS = 3  # at most 8 shadow rays a hit


@dataclass
class Decision:
    """What to do in each pixel; arrays of one entry a pixel."""

    label: object  # mi.UInt32, VisibilityClass
    guess: object  # mi.UInt64, packed cell fractions
    mask: object  # mi.UInt32, undecided cells
    mean: object  # mi.Float, mean visibility
    refine: object  # mi.Bool, sample undecided cells more
    rays: object  # mi.UInt32, shadow rays a hit
    error: object  # mi.Float, expected relative standard error of one hit
    need: object  # mi.Float, the same, less what sharing between pixels takes away: hits follow it
    light_seen: list  # packed counters by light, of the window
    light_tried: list
    sky: Guide | None  # where of the sky something is seen
    hits: object = None  # mi.UInt32, camera hits to add
    pilot_weight: object = None  # mi.Float, weight of the pilot's own estimate


def decide(pilot, frame, classifier: str, grid: int, named: bool, refinement: bool, left=1.0, alpha=None):
    """Classify each pixel's light from its neighbours' pilots, and predict the error of one more hit.

    Parameters
    ----------
    pilot : Pilot
    frame : Frame
    classifier : str
        ``mlp``, ``svm`` or ``threshold``.
    grid : int
        Light cells along each side, at most 4.
    named : bool
        Tell the partial configurations apart.
    refinement : bool
        Mark pixels whose light cells disagree for refinement.
    left : mi.Float, optional
        Share of the standard error of light samples that is left where pixels share.
    alpha : mi.Float, optional
        What the pilots covered, for films that want alpha: outlines need hits even where they are dark.

    Returns
    -------
    Decision
        With ``hits`` and ``pilot_weight`` still empty.
    """
    one = mi.Float(dr.full(mi.Float, 1, frame.pixels))
    glow = mi.luminance(pilot.straight) + 0 * one
    apart = 0 * one
    if pilot.probe_bright is not None:
        apart = 0.5 * dr.square(mi.luminance(pilot.bright) - pilot.probe_bright)
    means = [glow, dr.square(glow), apart] + ([] if pilot.unlike is None else [pilot.unlike])
    sums = cells.window_sum(pilot.seen + pilot.tried + means, frame.width, frame.height)
    near, means = sums[: -len(means)], sums[-len(means) :]
    glow1, glow2, apart, *unlike = (v / dr.maximum(cells.window_count(frame.width, frame.height), 1) for v in means)
    half = len(near) // 2
    near_seen, near_tried = near[:half], near[half:]
    bins = [4 * row + column for row in range(grid) for column in range(grid)]

    total_seen = sum((cells.read(near_seen, c) for c in bins), mi.UInt32(0))
    total_tried = sum((cells.read(near_tried, c) for c in bins), mi.UInt32(0))
    mean = dr.select(total_tried > 0, mi.Float(total_seen) / dr.maximum(mi.Float(total_tried), 1), 0)

    fractions = []
    for c in bins:
        v, n = mi.Float(cells.read(near_seen, c)), mi.Float(cells.read(near_tried, c))
        fractions.append(dr.select(n > 0, v / dr.maximum(n, 1), mean))

    # The seven configurations are told apart only where somebody looks at them
    label = classify_grid(fractions, classifier) if named else mi.UInt32(int(VisibilityClass.PARTIAL_SOLID))
    full = mean >= 1
    hidden = (mean <= 0) & (total_tried > 0)
    # The counts are certain about these two; the classifier tells the others apart
    label = dr.select(full, int(VisibilityClass.FULLY_VISIBLE), label)
    label = dr.select(hidden | (total_tried == 0), int(VisibilityClass.INVISIBLE), label)
    decided = full | (mean <= 0)

    guess = cells.pack_fractions(fractions if grid == 4 else [mean] * 16)
    mask = cells.undecided(guess)
    refine = ~decided & (mask != 0xFFFF) & refinement
    # Standard deviation of one shadow ray: every cell counts by how undecided it is
    spread = mi.Float(0)
    for f in fractions:
        spread += dr.sqrt(dr.maximum(f * (1 - f), PRIOR * PRIOR))
    spread /= len(fractions)
    # A window's look is a small sample. Those around tell how likely it has missed something, but not where
    wide, windows = [apart, mean * (1 - mean), *unlike], mi.Float(1)
    for far, inside in cells.neighbors(wide, frame.width, frame.height, FAR):
        windows += dr.select(inside, one, 0)
        wide = [w + f for w, f in zip(wide, far, strict=True)]
    apart, mixed, *unlike = (w / windows for w in wide)
    spread = dr.sqrt(dr.square(spread) + AROUND * mixed)
    # Noise from inside the pixel (edges, textures) shows as differences between neighbours. Those of this pixel are in no
    # sum of its own; but its probe is, which is in no estimate
    looks = [mi.luminance(pilot.bright), mi.luminance(pilot.straight)]
    looks += [pilot.noise + 0 * one, dr.select(pilot.proven > 0, mi.Float(1), mi.Float(0)) + 0 * one]
    probe = [] if pilot.probe_bright is None else [pilot.probe_bright, pilot.probe_straight]
    cover = [] if alpha is None else [alpha]
    moments = _moments(*probe) if probe else [mi.Float(0)] * 5
    count, noise, proven, covered = mi.Float(0), mi.Float(0), mi.Float(0), mi.Float(0)
    for (b, e, n, p, *other), inside in cells.neighbors(looks + cover + probe, frame.width, frame.height):
        count += dr.select(inside, one, 0)
        noise, proven = noise + n, proven + p
        if cover:
            covered += other.pop(0)
        for pair in ((b, e), other) if probe else ((b, e),):
            moments = [m + v for m, v in zip(moments, _moments(*pair), strict=True)]
    alone = count == 0
    noise, proven = (x / dr.maximum(count, 1) for x in (noise, proven))
    b1, b2, e1, e2, be = (m / dr.maximum(2 * count + 1 if probe else count, 1) for m in moments)
    # Neighbours' light is scaled by this pixel's guess: theirs would carry this pixel's own rays back to it
    level = b1 * mean + e1
    # What the light samples inside a hit add to those differences is noise that more rays a hit reduce
    sampling = noise / float(pilot.rays)
    camera = mean * mean * (b2 - b1 * b1 - sampling) + (e2 - e1 * e1) + 2 * mean * (be - b1 * e1)
    camera = dr.maximum(camera, 0)
    # Shading varies less inside a pixel than from one to the next, and nets leave next to nothing of it
    camera *= camera / (camera + GENTLE * GENTLE * (level * level + 0.01))
    camera += RARE * mean * mean * dr.maximum(apart - sampling, 0)
    if unlike:
        # Glass mirrors one ray in many, as likely here as nearby
        chance = RARE if pilot.glints is None else dr.maximum(pilot.glints[2], RARE)
        camera += chance * unlike[0]
    doubt = dr.square(b1 * spread)
    light = doubt + mean * mean * noise * dr.select(mean >= 1, SMOOTH, 1)
    # As many shadow rays a hit as balance what is left of the two, given what a hit and a ray cost
    balance = dr.sqrt(HIT_COST * dr.square(left) * light / dr.maximum(camera, 1e-12 + 1e-6 * level * level))
    # Squares of what is too bright for float32 say nothing
    balance = dr.select(dr.isfinite(balance), balance, 1)
    most = mi.Float(MAX_LOG_RAYS)
    if pilot.sky is not None and pilot.shine is not None:
        # The BSDF sample of each hit finds skies better, if all that a surface does is mirror
        most = dr.select((pilot.shine.lobe > 0) & ~pilot.shine.matt, 0, most)
    rays = mi.UInt32(1) << mi.UInt32(dr.clip(dr.round(dr.log2(dr.maximum(balance, 1))), 0, most))
    # Where nothing can stand in the way there is no doubt, and rays that were planned are spared
    light -= proven * doubt
    light /= dr.power(mi.Float(rays), 1.3)
    # A film of one pixel has no neighbours to tell
    error, need = ((camera + share * share * light) / (level * level + 0.01) for share in (1.0, left))
    covered /= dr.maximum(count, 1)
    edge = covered * (1 - covered)
    # Small bright lamps may escape all looks nearby; one hit in few that meets them would stand out
    edge = dr.maximum(edge, OUTLINE * dr.maximum(glow2 - glow1 * glow1, 0) / (glow1 * glow1 + 0.01))
    if pilot.lamps is not None:
        edge = dr.maximum(edge, _unmet(pilot, frame, level, e1))
    if pilot.glints is not None:
        highlight, variance, _ = pilot.glints
        # Mirrors try no light samples, and small things few
        seen = mi.Float(total_seen + 1) / mi.Float(total_tried + 1)
        edge = dr.maximum(edge, seen * variance / (dr.square(level + seen * highlight) + 0.01))
    error, need = (dr.sqrt(dr.maximum(x, edge)) for x in (error, need))
    error, need = (dr.select(alone | ~dr.isfinite(x), 1, x) for x in (error, need))
    sky = None if pilot.sky is None else guide(pilot.sky)
    return Decision(label, guess, mask, mean, refine, rays, error, need, near_seen[2:], near_tried[2:], sky)


def _unmet(pilot, frame, level, met):
    """Relative variance of a hit from lamps in view, which light samples tell of; less what looks nearby have met of them."""
    lamps = pilot.lamps
    most = pilot.lamps_squared / dr.maximum(lamps, 1e-30)
    # Few samples of a lamp larger than a pixel may add up to more than it has: below nought then
    inside = lamps * (most - lamps) * dr.maximum(1 - met / dr.maximum(most, 1e-30), 0)
    sums = cells.window_sum([pilot.lamps, pilot.lamps_squared], frame.width, frame.height, 1)
    m, q = (v / 8 for v in sums)
    beside = BESIDE * dr.maximum(q - m * m, 0)
    return dr.maximum(inside / (dr.square(level + lamps) + 0.01), beside / (m * m + 0.01))


def _moments(b, e):
    return [b, b * b, e, e * e, b * e]


def allocate(decision, frame, seed, budget: float, max_rays: int, pilot_rays: int, threshold: float) -> None:
    """Spread a budget of rays over the pixels (sets ``hits`` and ``pilot_weight``).

    Hits are proportional to ``need^EXPONENT``, rounded at random (by the pixel's number and the seed, not its samples).
    """
    share = dr.power(decision.need, EXPONENT)
    cost = mi.Float(decision.rays) + 1
    most = mi.Float(dr.maximum((max_rays - pilot_rays) // decision.rays, 0))
    if threshold > 0:
        # Enough hits for the error wanted, at the rate at which stratified hits converge
        most = dr.minimum(most, dr.ceil(dr.power(decision.error / threshold, 1.5)))
    dr.eval(share, cost, most)
    # The scale stays opaque: as a literal it would make a new kernel of every render
    scale = dr.opaque(mi.Float, float(budget / max(dr.sum(share * cost)[0], 1e-20)))
    # Pixels at their limit hand on what they cannot use; the least that others get is taken from all
    least = dr.opaque(mi.Float, budget / frame.pixels * LEAST) / cost
    for _ in range(8):
        spent = float(dr.sum(dr.minimum(dr.maximum(share * scale, least), most) * cost)[0])
        if spent <= 0 or abs(spent - budget) <= 0.005 * budget:
            break
        scale = dr.opaque(mi.Float, scale[0] * min(budget / spent, 4.0))
    wanted = dr.minimum(dr.maximum(share * scale, least), most)
    jitter = mi.sample_tea_float32(dr.arange(mi.UInt32, frame.pixels), ~seed, 4)
    # Powers of two, where the points form nets: the two nearest are mixed so that the expected number is as wanted
    low = dr.select(wanted >= 1, dr.exp2(dr.floor(dr.log2(dr.maximum(wanted, 1)))), 0)
    high = dr.select(wanted >= 1, 2 * low, 1)
    hits = dr.select(jitter * (high - low) < wanted - low, high, low)
    decision.hits = mi.UInt32(dr.minimum(hits, dr.select(most >= 1, dr.exp2(dr.floor(dr.log2(dr.maximum(most, 1)))), 0)))
    decision.pilot_weight = weight_of_pilot(decision.hits)


def weight_of_pilot(hits):
    """Weight of the pilot in a pixel of so many hits: one hit of few rays; it may not depend on its own outcome."""
    return dr.select(hits == 0, 1, dr.rcp(1 + PILOT * dr.power(mi.Float(hits), 1.3)))
