"""Vector operations of the hull tree (`tree`), for the sixteen lines of a panel together.

What is true of a lane is a bit of a word: bit ``lane`` of sixteen.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, _I32, LANES, _load, _pointer, _splat, address

PART = 8  # lanes at a time: what registers hold

_F64 = ir.VectorType(ir.DoubleType(), PART)
_INT = ir.IntType(64)
_BOOLS = ir.VectorType(ir.IntType(1), LANES)


def _row(context, builder, kind, value, place, part):
    # Eight float64 of row `place` of a flat array of sixteen a row; float32 ones are widened
    data = context.make_array(kind)(context, builder, value=value).data
    data = builder.gep(data, [builder.add(builder.mul(place, ir.Constant(_INT, LANES)), ir.Constant(_INT, part * PART))])
    if kind.dtype == types.float32:
        return builder.fpext(_load(builder, builder.bitcast(data, ir.PointerType(ir.VectorType(ir.FloatType(), PART)))), _F64)
    if kind.dtype == types.int32:
        part = _load(builder, builder.bitcast(data, ir.PointerType(ir.VectorType(ir.IntType(32), PART))))
        return builder.sitofp(part, _F64)
    return _load(builder, builder.bitcast(data, ir.PointerType(_F64)), 8)


def _every(builder, value):
    one = builder.insert_element(ir.Constant(_F64, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), PART), [0] * PART)
    return builder.shuffle_vector(one, ir.Constant(_F64, ir.Undefined), mask)


def _word(builder, masks):
    # One word of sixteen bits from the masks of all parts
    out = None
    for k, mask in enumerate(masks):
        bits = builder.zext(builder.bitcast(mask, ir.IntType(PART)), _INT)
        bits = builder.shl(bits, ir.Constant(_INT, PART * k))
        out = bits if out is None else builder.or_(out, bits)
    return out


def _mask(builder, word):
    return builder.bitcast(builder.trunc(word, ir.IntType(LANES)), _BOOLS)


@intrinsic
def classify(typingctx, heights, receiver, top, top_height):
    """Compare receiver, old root and the sample before; and the receiver's last visible child with the old root."""
    sig = types.UniTuple(types.int64, 4)(heights, types.intp, top, top_height)

    def generate(context, builder, signature, arguments):
        heights, receiver, top, top_height = arguments
        kh, _, kt, kth = signature.args
        r = _every(builder, builder.sitofp(receiver, ir.DoubleType()))
        low = ir.Constant(_F64, [float("-inf")] * PART)
        two = ir.Constant(_F64, [2.0] * PART)
        zero = ir.Constant(_INT, 0)
        words = [[], [], [], []]
        for part in range(LANES // PART):
            here, old, before = (
                _row(context, builder, kh, heights, builder.add(receiver, ir.Constant(_INT, k)), part) for k in range(3)
            )
            t, h = (_row(context, builder, k, v, zero, part) for k, v in ((kt, top), (kth, top_height)))
            on = builder.and_(builder.fcmp_ordered(">", here, low), builder.fcmp_ordered(">", old, low))
            s = builder.fsub(old, here)
            a, b = builder.fsub(before, here), builder.fmul(s, two)
            seen = builder.fcmp_ordered(">", builder.fsub(h, here), builder.fmul(s, builder.fsub(t, r)))
            words[0].append(on)
            words[1].append(builder.and_(on, builder.fcmp_ordered(">", a, b)))
            words[2].append(builder.and_(on, builder.fcmp_ordered("<", a, b)))
            words[3].append(builder.and_(on, builder.not_(seen)))
        return context.make_tuple(builder, signature.return_type, [_word(builder, w) for w in words])

    return sig, generate


@intrinsic
def crossed(typingctx, lines, opened, used, last, heights, receiver, active, found):
    """Find the levels where receivers may have crossed a child's line: ``level · 2¹⁶ + lanes``, written to ``found``.

    Returns how many there are.
    """
    sig = types.int64(lines, opened, used, types.intp, heights, types.intp, types.int64, found)

    def generate(context, builder, signature, arguments):
        lines, opened, used, last, heights, receiver, active, found = arguments
        kinds = signature.args
        r = _splat(builder, builder.sitofp(receiver, ir.FloatType()), _F32)
        here = _load(builder, _pointer(context, builder, kinds[4], heights, _F32, receiver))
        zero, one, two = (ir.Constant(_INT, k) for k in (0, 1, 2))
        count = cgutils.alloca_once_value(builder, zero)

        def each(k, place):
            return address(context, builder, kinds[k], arguments[k], place)

        with cgutils.for_range(builder, last, intp=_INT) as loop:
            e, row = loop.index, builder.mul(loop.index, two)
            at, by = (
                _load(builder, _pointer(context, builder, kinds[0], lines, _F32, k)) for k in (row, builder.add(row, one))
            )
            above = builder.fcmp_ordered(">", here, builder.fadd(at, builder.fmul(by, r)))
            new = builder.xor(builder.zext(builder.bitcast(above, ir.IntType(LANES)), _INT), builder.load(each(1, e)))
            new = builder.and_(new, builder.and_(active, builder.load(each(2, e))))
            # Written in any case, and overwritten unless it counts
            n = builder.load(count)
            builder.store(builder.or_(builder.shl(e, ir.Constant(_INT, LANES)), new), each(7, n))
            builder.store(builder.add(n, builder.zext(builder.icmp_unsigned("!=", new, zero), _INT)), count)
        return builder.load(count)

    return sig, generate


@intrinsic
def begin(typingctx, nodes, old, bits, none):
    """Begin the old root's nodes: its only child is the sample before where ``bits`` say so, elsewhere it has ``none``."""
    sig = types.void(nodes, types.intp, types.int64, types.intp)

    def generate(context, builder, signature, arguments):
        nodes, old, bits, none = arguments
        half = ir.VectorType(ir.IntType(16), LANES)
        p = builder.add(old, ir.Constant(_INT, 1))
        p, none = (_splat(builder, builder.trunc(k, ir.IntType(16)), half) for k in (p, none))
        child = builder.select(_mask(builder, bits), p, none)
        data = address(context, builder, signature.args[0], nodes, builder.mul(old, ir.Constant(_INT, 4 * LANES)))
        order = [k for lane in range(LANES) for k in (lane, LANES, LANES, LANES)]
        value = builder.shuffle_vector(child, none, ir.Constant(ir.VectorType(ir.IntType(32), 4 * LANES), order))
        builder.store(value, builder.bitcast(data, ir.PointerType(ir.VectorType(ir.IntType(16), 4 * LANES))), align=2)

    return sig, generate


@intrinsic
def put(typingctx, number, total, bits, counts, totals, row):
    """Write a row of counts and totals, one more where ``bits`` say so, and step one sample farther away."""
    sig = types.void(number, total, types.int64, counts, totals, types.intp)

    def generate(context, builder, signature, arguments):
        number, total, bits, counts, totals, row = arguments
        kinds = signature.args
        more = builder.zext(_mask(builder, bits), _I32)
        n = _load(builder, _pointer(context, builder, kinds[0], number, _I32))
        at = _pointer(context, builder, kinds[1], total, _I32)
        t = _load(builder, at)
        for k, array, value in ((3, counts, n), (4, totals, t)):
            builder.store(builder.add(value, more), _pointer(context, builder, kinds[k], array, _I32, row), align=4)
        builder.store(builder.add(t, n), at, align=4)
        return context.get_dummy_value()

    return sig, generate
