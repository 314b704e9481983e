"""Sixteen receivers side by side: what they gain from one crossing, written once as LLVM vectors (see `lanes`)."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, LANES, _any, _load, _pointer, _splat, address, sixteen

BEST, MINE, UP, ALONG, SEEN, GAIN = range(6)  # rows of the working memory
FUSED = ("contract",)

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
def cross(typingctx, work, heights, first, second, weight, scale, drop):
    """Let the receivers look at a crossing, between ``heights[first]`` and ``heights[second]`` and those that follow.

    Where it stands above the horizon, that is raised and row `GAIN` is the difference of W, else 0. Returns whether any did.
    """
    sig = types.boolean(work, heights, types.intp, types.intp, types.float32, types.float32, types.float32)

    def generate(context, builder, signature, arguments):
        work, heights, first, second, weight, scale, drop = arguments
        kinds = signature.args
        row = _rows(context, builder, kinds[0], work)
        a, b = (sixteen(context, builder, kinds[1], heights, v) for v in (first, second))
        weight, scale, drop = (_splat(builder, v, _F32) for v in (weight, scale, drop))
        height = builder.fadd(a, builder.fmul(weight, builder.fsub(b, a), flags=FUSED), flags=FUSED)
        over = builder.fmul(builder.fsub(height, _load(builder, row(MINE))), scale, flags=FUSED)
        rise = builder.fsub(over, drop, flags=FUSED)
        best = _load(builder, row(BEST))
        new = builder.fcmp_ordered(">", rise, best)
        some = _any(builder, new)
        with cgutils.if_unlikely(builder, some):
            best = builder.select(new, rise, best)
            total = _weight(builder, best, _load(builder, row(UP)), _load(builder, row(ALONG)))
            builder.store(builder.fsub(total, _load(builder, row(SEEN))), row(GAIN), align=4)
            builder.store(best, row(BEST), align=4)
            builder.store(total, row(SEEN), align=4)
        return some

    return sig, generate


@intrinsic
def shine(typingctx, work, light, place, out, at):
    """Add the receivers' gain times ``light[place]`` and those that follow to ``out[at]`` and on, flat float32 arrays."""
    sig = types.void(work, light, types.intp, out, types.intp)

    def generate(context, builder, signature, arguments):
        work, light, place, out, at = arguments
        kinds = signature.args
        gain = _load(builder, _rows(context, builder, kinds[0], work)(GAIN))
        radiance = sixteen(context, builder, kinds[1], light, place)
        target = builder.bitcast(address(context, builder, kinds[3], out, at), ir.PointerType(_F32))
        total = builder.fadd(_load(builder, target), builder.fmul(gain, radiance, flags=FUSED), flags=FUSED)
        builder.store(total, target, align=4)

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
    # Address of each row of the working memory, (6, 16) float32
    def row(k):
        return _pointer(context, builder, kind, work, _F32, ir.Constant(ir.IntType(64), k))

    return row
