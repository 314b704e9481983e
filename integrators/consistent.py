"""Consistent mode: neighbouring pixels of a penumbra share their visibility (non-local means on shadow ratios).

Only the ratio of shadowed to unshadowed light is shared, never texture or shading, and only between pixels that see nothing
but one surface, of which the surroundings agree within their noise (after Rousselle et al. 2012: each half of the samples is
weighted by what the other half says). It is the ratio of the pixels' sums, each half's from hits of its own: what differs
inside pixels, such as a fine texture, is in both sums alike. The bias vanishes with the noise: as it shrinks, fewer agree.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from . import cells
from .share import SLOPE, TURN, share

WHOLE = 0.5  # variance of the whole over that of its half
SAMPLED = 0.8  # share of the pixels around that must have halves to compare
LEFT = 0.5  # of a pixel's standard error, after sharing: so much less is spent where pixels may share
SHARP = 0.6  # how sharp a shadow's edge may be before nothing is left to share
SURE = 8  # hits that are enough to tell on such edges who is alike


def smooth(total, image, grid):
    """Return the image with its penumbrae shared between pixels.

    Parameters
    ----------
    total : Totals
        Sums of a finished render, with unshadowed and emitted light.
    image : mi.Color3f
        Its unbiased image.
    grid : Grid

    Returns
    -------
    mi.Color3f
    """
    frame, hits = total.frame, total.decision.hits
    # Of each half its light and what it would be without shadows, and the shadow ratios' noise
    brights, straights = total.halves(total.bright), total.halves(total.straight)
    lights = [a - b for a, b in zip(total.halves(), straights, strict=True)]
    # Rounding leaves some pixels that no light reaches a little below nought
    level = dr.abs(mi.luminance(image))
    known = grid.shares(hits)
    for bright in brights:
        known &= mi.luminance(bright) > 0.01 * level
    lights, brights = ([dr.select(known, v, 0) for v in pair] for pair in (lights, brights))
    ratios = [_ratio(*pair) for pair in zip(lights, brights, strict=True)]
    values = [dr.squared_norm(ratios[0] - ratios[1]) * 0.5, dr.select(known, mi.Float(1), mi.Float(0))]
    near = cells.window_sum(values, frame.width, frame.height, 1)
    noise = (near[0] + values[0]) / dr.maximum(near[1] + values[1], 1)
    dr.eval(lights, brights, ratios, noise, known)
    if not dr.any(known & (noise > 0)):
        return image
    halves = share(frame, grid.normal, grid.point, list(zip(lights, brights, strict=True)), ratios, noise, known)
    light, bright = (0.5 * (a + b) for a, b in (lights, brights))
    ratio = _ratio(*(a + b for a, b in zip(*halves, strict=True)))
    # What light differs by between halves, and what it would if shared, each over brightness
    scale = dr.rcp(dr.maximum(mi.luminance(bright), 1e-30))
    own, shared = (lights[0] - lights[1]) * scale, (brights[0] - brights[1]) * ratio * scale
    trust = _benefit(frame, *ratios, *(_ratio(*half) for half in halves), own, shared)
    w = total.decision.pilot_weight
    pilot = total.pilot.value + total.decision.mean * total.pilot.control + total.pilot.straight
    out = (dr.lerp(light, bright * ratio, trust) + 0.5 * (straights[0] + straights[1])) * (1 - w) + pilot * w
    return mi.Color3f(dr.select(known & (noise > 0), out, image))


def _ratio(light, bright):
    # In [0, 1]; noise of wavelengths and of closed forms may put it a little beyond
    return mi.Color3f(dr.select(bright != 0, dr.clip(light / bright, -0.5, 1.5), 0))


class Grid:
    """Pixels' places in the image, and on which surface they are.

    Attributes
    ----------
    inner : mi.Bool
        Whether a pixel and its four neighbours are on one surface, as far as one look at each tells.
    sharp : mi.Float
        How much visibility differs from one side of a pixel to the other, squared, as a share of all that it varies by:
        about 1 where the edge of a shadow runs through the pixel that is too sharp for neighbours to share.
    """

    def __init__(self, frame, pilot):
        self.frame = frame
        self.width, self.height = dr.opaque(mi.Int32, frame.width), dr.opaque(mi.Int32, frame.height)
        index = dr.arange(mi.Int32, frame.pixels)
        self.x, self.y = index % self.width, index // self.width
        self.normal, self.point = mi.Vector3f(pilot.normal), mi.Point3f(pilot.point)
        dr.eval(self.x, self.y, self.normal, self.point)
        self.inner = mi.Bool(True)
        for u, v in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            other, inside = self.at(u, v)
            self.inner &= self.alike(other, inside) | ~inside
        self.sharp = self._sharpness(pilot)
        dr.eval(self.inner, self.sharp)

    def shares(self, hits):
        """Whether pixels of so many hits take part: they have halves to compare, and so have most around them.

        On a sharp edge of a shadow few hits happen to agree with those across it.
        """
        sampled, frame = dr.select(hits >= 2, mi.Float(1), mi.Float(0)), self.frame
        (around,) = cells.window_sum([sampled], frame.width, frame.height)
        whole = cells.window_count(frame.width, frame.height)
        enough = dr.select(self.sharp < SHARP, mi.UInt32(2), mi.UInt32(SURE))
        return (hits >= enough) & self.inner & (around >= SAMPLED * whole)

    def left(self):
        """Return the share of a pixel's standard error that counts: `LEFT` where pixels share, and 1 where they cannot."""
        return dr.select(self.inner, dr.lerp(mi.Float(LEFT), 1, dr.minimum(self.sharp / SHARP, 1)), 1)

    def _sharpness(self, pilot):
        # From the neighbours' pilots alone, as all decisions are. Both counts are small and travel in one word
        counts = cells.total(pilot.seen) | (cells.total(pilot.tried) << 16)
        dr.eval(counts)
        # West, east, north, south and all around
        sums = [mi.UInt32(0)] * 5
        reach = range(-cells.RADIUS, cells.RADIUS + 1)
        for u, v in ((u, v) for v in reach for u in reach if u or v):
            other = dr.gather(mi.UInt32, counts, *self.at(u, v))
            sums = [s + other if member else s for s, member in zip(sums, (u < 0, u > 0, v < 0, v > 0, True), strict=True)]
        seen, tried = [mi.Float(s & 0xFFFF) for s in sums], [mi.Float(s >> 16) for s in sums]
        west, east, north, south, mean = (s / dr.maximum(n, 1) for s, n in zip(seen, tried, strict=True))
        # What nobody asked has no edge
        asked = [n > 0 for n in tried]
        gaps = (dr.select(asked[k] & asked[k + 1], dr.square(a - b), 0) for k, a, b in ((0, west, east), (2, north, south)))
        return sum(gaps) / dr.maximum(4 * mean * (1 - mean), 1e-3)

    def at(self, u, v):
        """Return the number of the pixel ``u`` to the right and ``v`` below, and whether there is one."""
        x, y = self.x + u, self.y + v
        return mi.UInt32(y * self.width + x), (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)

    def alike(self, other, inside):
        """Whether another pixel is on the same surface: alike normals, and a step that stays in the tangent plane."""
        step = dr.gather(mi.Point3f, self.point, other, inside) - self.point
        same = dr.dot(dr.gather(mi.Vector3f, self.normal, other, inside), self.normal) > TURN
        return inside & same & (dr.abs(dr.dot(step, self.normal)) < SLOPE * dr.norm(step))


def _benefit(frame, a, b, shared_a, shared_b, x, y):
    """How far to trust what is shared, in [0, 1].

    As far as a half's shared ratio predicts the other half's better than its own did; and no farther than the light so made
    is less noisy than the pixel's own: brightness is noisy too, say where lights that nobody sees are seldom asked.
    """
    own = dr.squared_norm(a - b)
    shared = 0.5 * (dr.squared_norm(shared_a - b) + dr.squared_norm(shared_b - a))
    # (1 - t) x + t y is least on average at t = <x (x - y)> / <(x - y)²>
    values = [own, shared, dr.dot(x, x - y), dr.squared_norm(x - y)]
    # Over 9×9 pixels: 3×3, of each 3×3. Over fewer the noise of the comparison costs more than its sharpness is worth
    for apart in (1, 3):
        near = cells.window_sum(values, frame.width, frame.height, 1, apart)
        values = [n + v for n, v in zip(near, values, strict=True)]
    near_own, near_shared, less, more = values
    gain = 1 - near_shared / dr.maximum(near_own, 1e-20)
    # A perfect value still misses the other half's noise: at best the error halves. What it misses beyond that is the
    # shared value's own error, here against that of a half; the whole pixel's is less than half of a half's
    error = dr.maximum(1 - 2 * gain, 0)
    useful = dr.select(more > 0, dr.clip(less / dr.maximum(more, 1e-30), 0, 1), 1)
    return dr.select(gain > 0, WHOLE / (WHOLE + error), 0) * useful
