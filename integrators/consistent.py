"""Consistent mode: neighbouring pixels of a penumbra share their visibility (non-local means on shadow ratios).

Only the ratio of shadowed to unshadowed light is shared, never texture or shading, and only between pixels that see nothing
but one surface, of which the surroundings agree within their noise (after Rousselle et al. 2012: each half of the samples is
weighted by what the other half says). The bias vanishes with the noise: as it shrinks, fewer pixels agree.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .cells import window_sum
from .share import SLOPE, TURN, share

WHOLE = 0.5  # variance of the whole over that of its half
LEFT = 0.5  # of a pixel's standard error, after sharing: so much less is spent where pixels may share


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
    n = mi.Float(dr.maximum(hits, 1))
    bright = mi.Color3f(total.bright) / n
    straight = mi.Color3f(total.straight) / n
    level = mi.luminance(image)
    known = (hits >= 2) & (mi.luminance(bright) > 0.01 * level) & (level > 0) & grid.inner

    # Shadow ratios of each half, and the noise of those
    def ratio(colour):
        inside = known & (bright > 0)
        return mi.Color3f(dr.select(inside, dr.clip((colour - straight) / dr.maximum(bright, 1e-20), -0.5, 1.5), 0))

    a, b = (ratio(half) for half in total.halves())
    va, vb = mi.luminance(a), mi.luminance(b)
    values = [dr.square(va - vb) * 0.5, dr.select(known, mi.Float(1), mi.Float(0))]
    near = window_sum(values, frame.width, frame.height, 1)
    noise = (near[0] + values[0]) / dr.maximum(near[1] + values[1], 1)
    dr.eval(a, b, va, vb, noise, known)
    if not dr.any(known & (noise > 0)):
        return image
    means = share(frame, grid.normal, grid.point, (a, b), (va, vb), noise, known)
    shared_a, shared_b = mi.Color3f(means[:3]), mi.Color3f(means[3:])
    trust = _benefit(frame, va, vb, mi.luminance(shared_a), mi.luminance(shared_b))
    shared = dr.lerp(0.5 * (a + b), 0.5 * (shared_a + shared_b), trust)
    w = total.decision.pilot_weight
    pilot = total.pilot.value + total.decision.mean * total.pilot.control + total.pilot.emission
    out = (bright * shared + straight) * (1 - w) + pilot * w
    return mi.Color3f(dr.select(known & (noise > 0), out, image))


class Grid:
    """Pixels' places in the image, and on which surface they are.

    Attributes
    ----------
    inner : mi.Bool
        Whether a pixel and its four neighbours are on one surface, as far as one look at each tells.
    """

    def __init__(self, frame, pilot):
        self.width, self.height = dr.opaque(mi.Int32, frame.width), dr.opaque(mi.Int32, frame.height)
        index = dr.arange(mi.Int32, frame.pixels)
        self.x, self.y = index % self.width, index // self.width
        self.normal, self.point = mi.Vector3f(pilot.normal), mi.Point3f(pilot.point)
        dr.eval(self.x, self.y, self.normal, self.point)
        self.inner = mi.Bool(True)
        for u, v in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            other, inside = self.at(u, v)
            self.inner &= self.alike(other, inside) | ~inside
        dr.eval(self.inner)

    def at(self, u, v):
        """Return the number of the pixel ``u`` to the right and ``v`` below, and whether there is one."""
        x, y = self.x + u, self.y + v
        return mi.UInt32(y * self.width + x), (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)

    def alike(self, other, inside):
        """Whether another pixel is on the same surface: alike normals, and a step that stays in the tangent plane."""
        step = dr.gather(mi.Point3f, self.point, other, inside) - self.point
        same = dr.dot(dr.gather(mi.Vector3f, self.normal, other, inside), self.normal) > TURN
        return inside & same & (dr.abs(dr.dot(step, self.normal)) < SLOPE * dr.norm(step))


def _benefit(frame, a, b, shared_a, shared_b):
    """How far to trust the shared value, in [0, 1]: as far as it predicts the other half better than the pixel did."""
    own = dr.square(a - b)
    shared = 0.5 * (dr.square(shared_a - b) + dr.square(shared_b - a))
    near_own, near_shared = window_sum([own, shared], frame.width, frame.height)
    gain = 1 - (near_shared + shared) / dr.maximum(near_own + own, 1e-20)
    # A perfect value still misses the other half's noise: at best the error halves. What it misses beyond that is the
    # shared value's own error, here against that of a half; the whole pixel's is less than half of a half's
    error = dr.maximum(1 - 2 * gain, 0)
    return dr.select(gain > 0, WHOLE / (WHOLE + error), 0)
