"""Sixteen receivers side by side: what they gain from one crossing, written once as LLVM vectors (see `lanes`)."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, LANES, _any, _load, _pointer, _splat, address, sixteen
from .lanes_skip import FUSED, crossing

BEST, MINE, UP, ALONG, SEEN = range(5)  # rows of the working memory

# Minimax polynomial of the arc tangent over [0, 1], absolute error 2e-6
ARC = (-0.01172120, 0.05265332, -0.11643287, 0.19354346, -0.33262347, 0.99997726)
QUARTER = 1.5707963


def _constant(value):
    return ir.Constant(_F32, [value] * LANES)


def _weight(builder, t, nz, a):
    # W(t) = ½ (nz t² c + a (atan t + t c)), c = 1 / (1 + t²), in all lanes; the formula is `gather`'s
    one = _constant(1.0)
    magnitude = builder.fneg(t)
    magnitude = builder.select(builder.fcmp_ordered("<", t, _constant(0.0)), magnitude, t)
    steep = builder.fcmp_ordered(">", magnitude, one)
    z = builder.select(steep, builder.fdiv(one, magnitude), magnitude)
    q = builder.fmul(z, z)
    e = _constant(ARC[0])
    for coefficient in ARC[1:]:
        e = builder.fadd(builder.fmul(e, q, flags=FUSED), _constant(coefficient), flags=FUSED)
    e = builder.fmul(e, z)
    e = builder.select(steep, builder.fsub(_constant(QUARTER), e), e)
    e = builder.select(builder.fcmp_ordered("<", t, _constant(0.0)), builder.fneg(e), e)
    c = builder.fdiv(one, builder.fadd(one, builder.fmul(t, t, flags=FUSED), flags=FUSED))
    tc = builder.fmul(t, c)
    side = builder.fmul(a, builder.fadd(e, tc))
    return builder.fmul(_constant(0.5), builder.fadd(builder.fmul(nz, builder.fmul(t, tc), flags=FUSED), side, flags=FUSED))


@intrinsic
def start(typingctx, work, horizon, own, nz, a, at):
    """Fill the working memory of the receivers from place ``at`` of flat float32 arrays on; `SEEN` is W at their horizons."""
    sig = types.void(work, horizon, own, nz, a, types.intp)

    def generate(context, builder, signature, arguments):
        row = _rows(context, builder, signature.args[0], arguments[0])
        for k, kind, value in zip((BEST, MINE, UP, ALONG), signature.args[1:5], arguments[1:5], strict=True):
            builder.store(sixteen(context, builder, kind, value, arguments[5]), row(k), align=4)
        t, nz, a = (_load(builder, row(k)) for k in (BEST, UP, ALONG))
        builder.store(_weight(builder, t, nz, a), row(SEEN), align=4)

    return sig, generate


@intrinsic
def pour(typingctx, values, place, share, out, at):
    """Add ``share`` times ``values[place]`` and those that follow to ``out[at]`` and on, flat float32 arrays; leave 0."""
    sig = types.void(values, types.intp, types.float32, out, types.intp)

    def generate(context, builder, signature, arguments):
        values, place, share, out, at = arguments
        kinds = signature.args
        given = sixteen(context, builder, kinds[0], values, place)
        more = builder.fmul(given, _splat(builder, share, _F32))
        total = builder.fadd(sixteen(context, builder, kinds[3], out, at), more)
        for kind, array, index, value in ((kinds[3], out, at, total), (kinds[0], values, place, _constant(0.0))):
            target = builder.bitcast(address(context, builder, kind, array, index), ir.PointerType(_F32))
            builder.store(value, target, align=4)

    return sig, generate


@intrinsic
def climb(typingctx, work, heights, place, first, second, weight, scale, drop, begin, end, steps, which):
    """Let the receivers look at crossings ``begin`` to ``end`` (excluded); parameters as `lanes_skip.look` has them.

    Of every crossing above the horizon of any of them, the tangents of all horizons after it and its number are written to
    ``steps`` (flat float32) and ``which`` (int64), one after the other. Returns how many.
    """
    number = types.intp
    sig = number(work, heights, number, first, second, weight, scale, drop, number, number, steps, which)

    def generate(context, builder, signature, arguments):
        work, heights, place, first, second, weight, scale, drop, begin, end, steps, which = arguments
        kinds = signature.args
        row = _rows(context, builder, kinds[0], work)
        mine = _load(builder, row(MINE))
        best_at, count_at = cgutils.alloca_once(builder, _F32), cgutils.alloca_once(builder, begin.type)
        builder.store(_load(builder, row(BEST)), best_at)
        builder.store(ir.Constant(begin.type, 0), count_at)
        with cgutils.for_range_slice(builder, begin, end, ir.Constant(begin.type, 1), inc=True) as (n, _):
            rise = crossing(context, builder, kinds[1], heights, place, mine, n, zip(kinds[3:8], arguments[3:8], strict=True))
            best, count = builder.load(best_at), builder.load(count_at)
            new = builder.fcmp_ordered(">", rise, best)
            best = builder.select(new, rise, best)
            builder.store(best, best_at)
            # Written in any case, and overwritten unless it counts: what is seen cannot be predicted
            builder.store(best, _pointer(context, builder, kinds[10], steps, _F32, count), align=4)
            builder.store(n, address(context, builder, kinds[11], which, count))
            builder.store(builder.add(count, builder.zext(_any(builder, new), count.type)), count_at)
        builder.store(builder.load(best_at), row(BEST), align=4)
        return builder.load(count_at)

    return sig, generate


@intrinsic
def gains(typingctx, work, steps, count):
    """Turn ``count`` tangents, sixteen receivers each, into the differences of W that they make."""
    sig = types.void(work, steps, types.intp)

    def generate(context, builder, signature, arguments):
        work, steps, count = arguments
        row = _rows(context, builder, signature.args[0], work)
        nz, a = _load(builder, row(UP)), _load(builder, row(ALONG))
        seen = cgutils.alloca_once(builder, _F32)
        builder.store(_load(builder, row(SEEN)), seen)
        with cgutils.for_range(builder, count) as loop:
            at = _pointer(context, builder, signature.args[1], steps, _F32, loop.index)
            total = _weight(builder, _load(builder, at), nz, a)
            builder.store(builder.fsub(total, builder.load(seen)), at, align=4)
            builder.store(total, seen)
        builder.store(builder.load(seen), row(SEEN), align=4)

    return sig, generate


@intrinsic
def shine(typingctx, gains, which, begin, end, triangles, light, place, out, at):
    """Add gains ``begin`` to ``end`` times their triangles' light to ``out[at]`` and on (flat float32).

    Crossing ``n`` shows ``light[place + triangles[n]]`` and those that follow, a receiver each.
    """
    number = types.intp
    sig = types.void(gains, which, number, number, triangles, light, number, out, number)

    def generate(context, builder, signature, arguments):
        gains, which, begin, end, triangles, light, place, out, at = arguments
        kinds = signature.args
        target = builder.bitcast(address(context, builder, kinds[7], out, at), ir.PointerType(_F32))
        total = cgutils.alloca_once(builder, _F32)
        builder.store(_load(builder, target), total)
        with cgutils.for_range_slice(builder, begin, end, ir.Constant(begin.type, 1), inc=True) as (m, _):
            n = builder.load(address(context, builder, kinds[1], which, m))
            triangle = builder.load(address(context, builder, kinds[4], triangles, n))
            radiance = sixteen(context, builder, kinds[5], light, builder.add(place, triangle))
            gain = _load(builder, _pointer(context, builder, kinds[0], gains, _F32, m))
            more = builder.fmul(gain, radiance, flags=FUSED)
            builder.store(builder.fadd(builder.load(total), more, flags=FUSED), total)
        builder.store(builder.load(total), target, align=4)

    return sig, generate


@intrinsic
def worth(typingctx, work, top, near, fall, slack):
    """Whether a surface up to height ``top`` may add more than ``slack`` to W of any receiver, from ``near`` (inverse) on."""
    sig = types.boolean(work, types.float32, types.float32, types.float32, types.float32)

    def generate(context, builder, signature, arguments):
        work, top, near, fall, slack = arguments
        row = _rows(context, builder, signature.args[0], work)
        top, near, fall, slack = (_splat(builder, v, _F32) for v in (top, near, fall, slack))
        rise = builder.fsub(builder.fmul(builder.fsub(top, _load(builder, row(MINE))), near), fall)
        best = _load(builder, row(BEST))
        rise = builder.select(builder.fcmp_ordered(">", rise, best), rise, best)
        total = _weight(builder, rise, _load(builder, row(UP)), _load(builder, row(ALONG)))
        return _any(builder, builder.fcmp_ordered(">", builder.fsub(total, _load(builder, row(SEEN))), slack))

    return sig, generate


def _rows(context, builder, kind, work):
    # Address of each row of the working memory, (5, 16) float32
    def row(k):
        return _pointer(context, builder, kind, work, _F32, ir.Constant(ir.IntType(64), k))

    return row
