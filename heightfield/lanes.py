"""Sixteen lines side by side: the vector operations that numba cannot spell, written once as LLVM vectors.

A panel holds sixteen neighbouring lines, one a lane: ``heights[k, lane]``. Receivers at the same place ``k`` of the sixteen
lines look along +k together. LLVM turns the vectors into whatever the machine has (AVX-512, AVX2, NEON, …).
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
FAR_BELOW = -1e300  # rise of the best sight line before anything was seen

_F32 = ir.VectorType(ir.FloatType(), LANES)
_F64 = ir.VectorType(ir.DoubleType(), LANES)
_I32 = ir.VectorType(ir.IntType(32), LANES)


def _splat(builder, value, vector):
    # The same scalar in every lane
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)


def _pointer(context, builder, kind, value, vector, row=None):
    # Address of a row of sixteen in a contiguous array
    data = context.make_array(kind)(context, builder, value=value).data
    if row is not None:
        data = builder.gep(data, [builder.mul(row, ir.Constant(row.type, LANES))])
    return builder.bitcast(data, ir.PointerType(vector))


def _load(builder, pointer, bytes_each=4):
    return builder.load(pointer, align=bytes_each)


def address(context, builder, kind, value, place):
    """Return the address of element ``place`` of a contiguous array."""
    return builder.gep(context.make_array(kind)(context, builder, value=value).data, [place])


def sixteen(context, builder, kind, value, place):
    """Load elements ``place`` to ``place + 15`` of a contiguous float32 array."""
    return _load(builder, builder.bitcast(address(context, builder, kind, value, place), ir.PointerType(_F32)))


def _any(builder, mask):
    whole = builder.bitcast(mask, ir.IntType(LANES))
    return builder.icmp_unsigned("!=", whole, ir.Constant(ir.IntType(LANES), 0))


@intrinsic
def next_rise(typingctx, tops, first, last, size, samples, here, least, inverse, receiver):
    """Return the first stretch from ``first`` (``last`` if none) whose highest points reach the rise ``least`` in any lane.

    Stretch ``i`` holds samples ``i · size`` to ``(i + 1) · size`` of ``samples`` in all, at most as high as ``tops[i]``: its
    rise is bounded by that height at its near end, or at its far end if that is below the receivers.
    """
    sig = types.intp(tops, types.intp, types.intp, types.intp, types.intp, here, least, inverse, types.intp)

    def generate(context, builder, signature, arguments):
        tops, first, last, size, samples, here, least, inverse, receiver = arguments
        kinds = signature.args
        h0 = _load(builder, _pointer(context, builder, kinds[5], here, _F32))
        low = _load(builder, _pointer(context, builder, kinds[6], least, _F32))
        inverses = context.make_array(kinds[7])(context, builder, value=inverse).data
        one = ir.Constant(first.type, 1)
        found = cgutils.alloca_once(builder, first.type)
        builder.store(last, found)
        with cgutils.for_range(builder, last, start=first, intp=first.type) as loop:
            i = loop.index
            near = builder.mul(i, size)
            far = builder.sub(builder.add(near, size), one)
            far = builder.select(builder.icmp_signed("<", far, samples), far, builder.sub(samples, one))
            over = builder.fsub(_load(builder, _pointer(context, builder, kinds[0], tops, _F32, i)), h0)
            a, b = (
                builder.fmul(over, _splat(builder, builder.load(builder.gep(inverses, [builder.sub(k, receiver)])), _F32))
                for k in (near, far)
            )
            best = builder.select(builder.fcmp_ordered(">", a, b), a, b)
            with cgutils.if_unlikely(builder, _any(builder, builder.fcmp_ordered(">=", best, low))):
                builder.store(i, found)
                loop.do_break()
        return builder.load(found)

    return sig, generate


@intrinsic
def look(typingctx, heights, first, last, here, rise, run, least, words, row, receiver):
    """Look at samples ``first`` to ``last`` (excluded, at most 32 of them) from ``receiver`` in all lanes.

    A sample is seen where ``(h − here) · run > rise · distance``: everything nearer is below its sight line. Cross-multiplied
    in float64, so exact for float32 heights of like magnitude. ``rise``, ``run`` (float64) hold the highest sight line so
    far and are updated, as is ``least`` (float32), its slope less a margin for `next_rise`. Bit ``t`` of ``words[row, lane]``
    says whether sample ``first + t`` is seen. Returns whether any lane saw any.
    """
    sig = types.boolean(heights, types.intp, types.intp, here, rise, run, least, words, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        heights, first, last, here, rise, run, least, words, row, receiver = arguments
        kinds = signature.args
        h0 = builder.fpext(_load(builder, _pointer(context, builder, kinds[3], here, _F32)), _F64)
        rise_at = _pointer(context, builder, kinds[4], rise, _F64)
        run_at = _pointer(context, builder, kinds[5], run, _F64)
        # Held in registers over the loop
        highest, away, seen = (cgutils.alloca_once(builder, v) for v in (_F64, _F64, _I32))
        builder.store(_load(builder, rise_at, 8), highest)
        builder.store(_load(builder, run_at, 8), away)
        builder.store(ir.Constant(_I32, [0] * LANES), seen)
        with cgutils.for_range_slice(builder, first, last, ir.Constant(first.type, 1), inc=True) as (k, _):
            h = builder.fpext(_load(builder, _pointer(context, builder, kinds[0], heights, _F32, k)), _F64)
            over = builder.fsub(h, h0)
            distance = _splat(builder, builder.sitofp(builder.sub(k, receiver), ir.DoubleType()), _F64)
            e, d = builder.load(highest), builder.load(away)
            sees = builder.fcmp_ordered(">", builder.fmul(over, d), builder.fmul(e, distance))
            builder.store(builder.select(sees, over, e), highest)
            builder.store(builder.select(sees, distance, d), away)
            bit = builder.shl(ir.Constant(ir.IntType(32), 1), builder.trunc(builder.sub(k, first), ir.IntType(32)))
            new = builder.select(sees, _splat(builder, bit, _I32), ir.Constant(_I32, [0] * LANES))
            builder.store(builder.or_(builder.load(seen), new), seen)
        e, d, word = builder.load(highest), builder.load(away), builder.load(seen)
        builder.store(e, rise_at, align=8)
        builder.store(d, run_at, align=8)
        # A margin wider than the rounding of float32 products
        slope = builder.fptrunc(builder.fdiv(e, d), _F32)
        low = builder.fsub(slope, builder.fmul(_absolute(builder, slope), ir.Constant(_F32, [1e-6] * LANES)))
        builder.store(low, _pointer(context, builder, kinds[6], least, _F32), align=4)
        builder.store(word, _pointer(context, builder, kinds[7], words, _I32, row), align=4)
        zero = ir.Constant(_I32, [0] * LANES)
        return _any(builder, builder.icmp_unsigned("!=", word, zero))

    return sig, generate


@intrinsic
def march(typingctx, heights, first, last, here, slope, words, row, inverse, receiver):
    """Look at samples as `look` does, in float32 with inverse distances: the naive method at its fastest (§1).

    ``inverse[d]`` is 1 / d; ``slope`` (float32) the highest so far, updated. Returns whether any lane saw any.
    """
    sig = types.boolean(heights, types.intp, types.intp, here, slope, words, types.intp, inverse, types.intp)

    def generate(context, builder, signature, arguments):
        heights, first, last, here, slope, words, row, inverse, receiver = arguments
        kinds = signature.args
        h0 = _load(builder, _pointer(context, builder, kinds[3], here, _F32))
        slope_at = _pointer(context, builder, kinds[4], slope, _F32)
        inverses = context.make_array(kinds[7])(context, builder, value=inverse).data
        highest, seen = (cgutils.alloca_once(builder, v) for v in (_F32, _I32))
        builder.store(_load(builder, slope_at), highest)
        builder.store(ir.Constant(_I32, [0] * LANES), seen)
        with cgutils.for_range_slice(builder, first, last, ir.Constant(first.type, 1), inc=True) as (k, _):
            h = _load(builder, _pointer(context, builder, kinds[0], heights, _F32, k))
            scale = _splat(builder, builder.load(builder.gep(inverses, [builder.sub(k, receiver)])), _F32)
            s = builder.fmul(builder.fsub(h, h0), scale)
            best = builder.load(highest)
            sees = builder.fcmp_ordered(">", s, best)
            builder.store(builder.select(sees, s, best), highest)
            bit = builder.shl(ir.Constant(ir.IntType(32), 1), builder.trunc(builder.sub(k, first), ir.IntType(32)))
            new = builder.select(sees, _splat(builder, bit, _I32), ir.Constant(_I32, [0] * LANES))
            builder.store(builder.or_(builder.load(seen), new), seen)
        word = builder.load(seen)
        builder.store(builder.load(highest), slope_at, align=4)
        builder.store(word, _pointer(context, builder, kinds[5], words, _I32, row), align=4)
        return _any(builder, builder.icmp_unsigned("!=", word, ir.Constant(_I32, [0] * LANES)))

    return sig, generate


def _absolute(builder, vector):
    bits = builder.bitcast(vector, _I32)
    return builder.bitcast(builder.and_(bits, ir.Constant(_I32, [0x7FFFFFFF] * LANES)), _F32)


@intrinsic
def lowest_bit(typingctx, word):
    """Return the place of the lowest set bit of a uint32 that has one."""

    def generate(context, builder, signature, arguments):
        place = builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))
        return builder.zext(place, ir.IntType(64))

    return types.int64(types.uint32), generate


@intrinsic
def between(typingctx, values, place, share, drop, out, row):
    """Write to row ``row`` what lies ``share`` of the way from elements ``place`` and on to those after them, less ``drop``.

    ``values`` is a flat float32 array, ``out`` one of sixteen a row; computed in float64.
    """
    sig = types.void(values, types.intp, types.float64, types.float64, out, types.intp)

    def generate(context, builder, signature, arguments):
        values, place, share, drop, out, row = arguments
        kinds = signature.args
        near, far = (
            builder.fpext(sixteen(context, builder, kinds[0], values, builder.add(place, ir.Constant(place.type, k))), _F64)
            for k in (0, 1)
        )
        more = builder.fmul(_splat(builder, share, _F64), builder.fsub(far, near))
        value = builder.fsub(builder.fadd(near, more), _splat(builder, drop, _F64))
        target = _pointer(context, builder, kinds[4], out, _F32, row)
        builder.store(builder.fptrunc(value, _F32), target, align=4)
        return context.get_dummy_value()

    return sig, generate
