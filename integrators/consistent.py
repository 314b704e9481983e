"""Consistent mode: neighbouring pixels of a penumbra share their visibility (non-local means on shadow ratios).

Only the ratio of shadowed to unshadowed light is shared, never texture or shading, and only between pixels of one
surface whose ratios agree within their noise (after Rousselle et al. 2012: each half of the samples is weighted by what
the other half says). The bias vanishes with the noise: as it shrinks, fewer pixels agree.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .cells import window_sum

RADIUS = 2  # share within 5×5 pixels
TOLERANCE = 1.0  # of what noise explains
WHOLE = 0.35  # variance of a whole net over that of its half


def smooth(total, image):
    """Return the image with its penumbrae shared between pixels.

    Parameters
    ----------
    total : Totals
        Sums of a finished render, with unshadowed and emitted light.
    image : mi.Color3f
        Its unbiased image.

    Returns
    -------
    mi.Color3f
    """
    frame, hits = total.frame, total.decision.hits
    n = mi.Float(dr.maximum(hits, 1))
    bright = mi.Color3f(total.bright) / n
    straight = mi.Color3f(total.straight) / n
    first, second = total.halves()
    level = mi.luminance(image)
    known = (hits >= 2) & (mi.luminance(bright) > 0.01 * level) & (level > 0)

    # Shadow ratios of each half, their local means, and the noise of those
    def ratio(colour):
        return dr.clip(dr.select(bright > 0, (colour - straight) / dr.maximum(bright, 1e-20), 0), -0.5, 1.5)

    a, b = ratio(first), ratio(second)
    va, vb = mi.luminance(a), mi.luminance(b)
    noise = dr.select(known, dr.square(va - vb) * 0.5, 0)
    one = dr.select(known, mi.Float(1), mi.Float(0))
    values = [dr.select(known, va, 0), dr.select(known, vb, 0), noise, one]
    near = window_sum(values, frame.width, frame.height, 1)
    count = dr.maximum(near[3] + one, 1)
    mean_a, mean_b, noise = ((x + y) / count for x, y in zip(near[:3], values[:3], strict=True))
    normal, point = mi.Vector3f(total.pilot.normal), mi.Point3f(total.pilot.point)
    dr.eval(a, b, mean_a, mean_b, noise, known, bright, straight)

    index = dr.compress(known & (noise > 0))
    if not dr.width(index):
        return image
    shared_a, shared_b = _share(frame, index, a, b, mean_a, mean_b, noise, count, known, normal, point)
    trust = _benefit(frame, index, va, vb, shared_a, shared_b)
    own = 0.5 * (dr.gather(mi.Color3f, a, index) + dr.gather(mi.Color3f, b, index))
    shared = dr.lerp(own, 0.5 * (shared_a + shared_b), trust)
    w = dr.gather(mi.Float, total.decision.pilot_weight, index)
    light = dr.gather(mi.Color3f, bright, index) * shared + dr.gather(mi.Color3f, straight, index)
    pilot = total.pilot.value + total.decision.mean * total.pilot.control + total.pilot.emission
    light = light * (1 - w) + dr.gather(mi.Color3f, pilot, index) * w
    out = mi.Color3f(image)
    for i in range(3):
        channel = mi.Float(out[i])
        dr.eval(channel)
        dr.scatter(channel, light[i], index)
        out[i] = channel
    return out


def _packed(columns: list):
    """Interleave images, sixteen floats a pixel, so that one pixel's values are read with a few wide loads."""
    flat = dr.zeros(mi.Float, 16 * dr.width(columns[0]))
    index = dr.arange(mi.UInt32, dr.width(columns[0])) * 16
    for c, column in enumerate(columns):
        dr.scatter(flat, mi.Float(column), index + c)
    dr.eval(flat)
    return flat


@dr.syntax
def _share(frame, index, a, b, mean_a, mean_b, noise, count, known, normal, point):
    # Half-buffer means over `count` pixels have a variance of noise/count; unknown pixels carry a negative one
    spread = dr.select(known, noise / count, -1)
    data = _packed([mean_a, mean_b, spread, a.x, a.y, a.z, b.x, b.y, b.z, normal.x, normal.y, normal.z, point.x, point.y,
                    point.z])
    read = lambda at, active, k: dr.gather(mi.Vector4f, data, 4 * at + k, active)  # noqa: E731
    width, height = dr.opaque(mi.Int32, frame.width), dr.opaque(mi.Int32, frame.height)
    x, y = mi.Int32(index) % width, mi.Int32(index) // width
    always = mi.Bool(True)
    h0, h1, h2, h3 = (read(index, always, k) for k in range(4))
    here_n, here_p = mi.Vector3f(h2.y, h2.z, h2.w), mi.Point3f(h3.x, h3.y, h3.z)
    sum_a, sum_b = mi.Color3f(h0.w, h1.x, h1.y), mi.Color3f(h1.z, h1.w, h2.x)
    weight_a, weight_b = mi.Float(1), mi.Float(1)
    side = 2 * RADIUS + 1
    o = mi.Int32(0)
    while o < side * side:
        u, v = x + o % side - RADIUS, y + o // side - RADIUS
        at = mi.UInt32(v * width + u)
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height) & (o != (side * side) // 2)
        t0, t1, t2, t3 = (read(at, inside, k) for k in range(4))
        # The same surface: alike normals, and a step that stays in the tangent plane
        step = mi.Point3f(t3.x, t3.y, t3.z) - here_p
        inside &= (t0.z >= 0) & (dr.dot(mi.Vector3f(t2.y, t2.z, t2.w), here_n) > 0.95)
        inside &= dr.abs(dr.dot(step, here_n)) < 0.2 * dr.norm(step)
        scale = TOLERANCE * (h0.z + t0.z) + 1e-7
        # Each half is weighted by the other
        wa = dr.select(inside, dr.exp(-dr.square(h0.y - t0.y) / scale), 0)
        wb = dr.select(inside, dr.exp(-dr.square(h0.x - t0.x) / scale), 0)
        sum_a += wa * mi.Color3f(t0.w, t1.x, t1.y)
        sum_b += wb * mi.Color3f(t1.z, t1.w, t2.x)
        weight_a += wa
        weight_b += wb
        o += 1
    return sum_a / weight_a, sum_b / weight_b


def _benefit(frame, index, va, vb, shared_a, shared_b):
    """How far to trust the shared value, in [0, 1]: as far as it predicts the other half better than the pixel did."""
    own = dr.square(va - vb)
    at = lambda image: dr.gather(mi.Float, image, index)  # noqa: E731
    error = 0.5 * (dr.square(mi.luminance(shared_a) - at(vb)) + dr.square(mi.luminance(shared_b) - at(va)))
    own, shared = dr.select(dr.isfinite(own), own, 0), dr.zeros(mi.Float, frame.pixels)
    dr.eval(own)
    shared += own
    dr.eval(shared)
    dr.scatter(shared, error, index)
    near_own, near_shared = window_sum([own, shared], frame.width, frame.height)
    gain = 1 - at(near_shared + shared) / dr.maximum(at(near_own + own), 1e-20)
    # A perfect value still misses the other half's noise: at best the error halves. What it misses beyond that is the
    # shared value's own error, here against that of a half; the whole pixel's is less than half of a half's
    error = dr.maximum(1 - 2 * gain, 0)
    return dr.select(gain > 0, dr.square(WHOLE / (WHOLE + error)), 0)
