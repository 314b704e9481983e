"""Sixteen rays side by side, from neighbouring rows: what they meet, written once as LLVM vectors (see `lanes`)."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, _I32, LANES, _any, _load, _pointer, _splat, address, sixteen

FUSED = ("contract",)


def crossing(context, builder, kinds, arrays, n):
    """Return where crossing ``n`` of `look`'s arrays is, and what turns heights there into a receiver's tangent.

    Returns
    -------
    ends : two places
    rise : callable
        Takes the heights of both ends and the receiver's, returns the tangent.
    """
    first, second, *numbers = (
        None if isinstance(k, types.NoneType) else builder.load(address(context, builder, k, v, n))
        for k, v in zip(kinds, arrays, strict=True)
    )
    weight, scale, drop = (None if v is None else _splat(builder, v, _F32) for v in numbers)

    def rise(a, b, own):
        h = builder.fadd(a, builder.fmul(weight, builder.fsub(b, a), flags=FUSED), flags=FUSED)
        tangent = builder.fmul(builder.fsub(h, own), scale, flags=FUSED)
        return tangent if drop is None else builder.fsub(tangent, drop, flags=FUSED)

    return (first, second), rise


def _both(builder, place, pitch, gap):
    # Of a receiver and of the one ``gap`` columns nearer; of the receiver alone where there is no gap
    return [place] if gap is None else [place, builder.sub(place, builder.mul(gap, pitch))]


@intrinsic
def look(
    typingctx, heights, place, stride, first, second, weight, scale, drop, begin, end, gap,
    own, best, mine, pitch, column, where,
):  # fmt: skip
    """Raise horizons to the steepest rise towards crossings ``begin`` to ``end`` (excluded), in all lanes of two receivers.

    Parameters
    ----------
    heights : (n,) float32 array
        Lanes lie side by side.
    place, stride : int
        Where the first receivers' cells lie in it, and how far before them the next column.
    first, second : (m,) int64 arrays
        Offsets from there to the two ends of the crossed edges.
    weight, scale : (m,) float32 arrays
        Of the second end; inverse distance.
    drop : (m,) float32 array or None
        Fall of the Earth's surface over the distance, as a slope.
    gap : int
        How many columns before the first receivers the second ones stand: 1, or 0 if they are the same.
    own, best : (n,) float32 arrays
        Heights of the receivers, and tangents of their horizons, changed in place.
    mine, pitch : int
        Where the first receivers are in these, and how far before them the next column.
    column : int
        Written to ``where``, (16,) int32, in lanes where a horizon rises.
    """
    number = types.intp
    sig = types.void(
        *(heights, number, number, first, second, weight, scale, drop, number, number, number),
        *(own, best, number, number, types.int32, where),
    )

    def generate(context, builder, signature, arguments):
        heights, place, stride, *arrays, begin, end, gap, own, best, mine, pitch, column, where = arguments
        kinds = signature.args
        receivers = _both(builder, mine, pitch, gap)
        heights_at = [sixteen(context, builder, kinds[11], own, m) for m in receivers]
        best_at = [builder.bitcast(address(context, builder, kinds[12], best, m), _F32.as_pointer()) for m in receivers]
        before = [_load(builder, v) for v in best_at]
        highest = [cgutils.alloca_once_value(builder, v) for v in before]
        places = _both(builder, place, stride, gap)
        with cgutils.for_range_slice(builder, begin, end, ir.Constant(begin.type, 1), inc=True) as (n, _):
            ends, rise = crossing(context, builder, kinds[3:8], arrays, n)
            for cell, h0, top_at in zip(places, heights_at, highest, strict=True):
                a, b = (sixteen(context, builder, kinds[0], heights, builder.add(cell, v)) for v in ends)
                new, top = rise(a, b, h0), builder.load(top_at)
                builder.store(builder.select(builder.fcmp_ordered(">", new, top), new, top), top_at)
        rises = []
        for old, top_at, at in zip(before, highest, best_at, strict=True):
            new = builder.load(top_at)
            builder.store(new, at, align=4)
            rises.append(builder.fcmp_ordered(">", new, old))
        where_at = _pointer(context, builder, kinds[16], where, _I32)
        columns = builder.select(builder.or_(*rises), _splat(builder, column, _I32), _load(builder, where_at))
        builder.store(columns, where_at, align=4)

    return sig, generate


@intrinsic
def reaches(typingctx, tops, place, down, inverse, fall, k, end, gap, own, mine, best, at, pitch):
    """Whether a stretch from column ``k`` to column ``end`` from the receivers may rise above ``best`` in any lane.

    Parameters
    ----------
    tops, down, inverse, fall
        Of `skip.Way`.
    place : int
        Where in ``tops`` the receivers' rows are.
    gap : int or None
        As `look` has it; None if there is one receiver.
    own, mine, best, at, pitch
        Heights of the receivers and tangents of their horizons, as in `look`.
    """
    number = types.intp
    sig = types.boolean(tops, number, down, inverse, fall, number, number, gap, own, number, best, number, number)

    def generate(context, builder, signature, arguments):
        tops, place, down, inverse, fall, k, end, gap, own, mine, best, at, pitch = arguments
        kinds, single, found = signature.args, isinstance(signature.args[7], types.NoneType), None
        gap = None if single else gap

        def of(which, column):
            return builder.load(address(context, builder, kinds[which], arguments[which], column))

        nearer = ir.Constant(k.type, -1)
        columns = (_both(builder, v, nearer, gap) for v in (k, end))
        receivers = (_both(builder, v, pitch, gap) for v in (mine, at))
        for near, far, m, b in zip(*columns, *receivers, strict=True):
            top = sixteen(context, builder, kinds[0], tops, builder.add(place, of(2, near)))
            over = builder.fsub(top, sixteen(context, builder, kinds[8], own, m))
            rises = [builder.fmul(over, _splat(builder, of(3, column), _F32)) for column in (near, far)]
            bound = builder.select(builder.fcmp_ordered(">", *rises), *rises)
            bound = builder.fsub(bound, _splat(builder, of(4, near), _F32))
            more = builder.fcmp_ordered(">", bound, sixteen(context, builder, kinds[10], best, b))
            found = more if found is None else builder.or_(found, more)
        return _any(builder, found)

    return sig, generate


@intrinsic
def soon(typingctx, values, place):
    """Bring elements ``place`` to ``place + 15`` of a float32 array near: no hardware sees it coming."""

    def generate(context, builder, signature, arguments):
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        at = builder.bitcast(address(context, builder, signature.args[0], *arguments), byte)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        for ahead in (0, 4 * LANES - 4):
            builder.call(fetch, [builder.gep(at, [ir.Constant(number, ahead)]), *(ir.Constant(number, v) for v in (0, 3, 1))])

    return types.void(values, types.intp), generate
