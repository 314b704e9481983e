"""Sixteen rays side by side, from neighbouring rows: what they meet, written once as LLVM vectors (see `lanes`)."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, _I32, LANES, _any, _load, _pointer, _splat, address, sixteen

FUSED = ("contract",)


def crossing(context, builder, kind, heights, place, own, n, arrays):
    """Return the tangents under which receivers of heights ``own`` see crossing ``n``; see `look` for the arrays."""
    first, second, *numbers = (builder.load(address(context, builder, k, v, n)) for k, v in arrays)
    a, b = (sixteen(context, builder, kind, heights, builder.add(place, v)) for v in (first, second))
    weight, scale, drop = (_splat(builder, v, _F32) for v in numbers)
    h = builder.fadd(a, builder.fmul(weight, builder.fsub(b, a), flags=FUSED), flags=FUSED)
    return builder.fsub(builder.fmul(builder.fsub(h, own), scale, flags=FUSED), drop, flags=FUSED)


@intrinsic
def look(typingctx, heights, place, first, second, weight, scale, drop, begin, end, own, mine, best, at, column, where):
    """Raise horizons to the steepest rise towards crossings ``begin`` to ``end`` (excluded), in all lanes.

    Parameters
    ----------
    heights : (n,) float32 array
        Lanes lie side by side.
    place : int
        Where the receivers' cells lie in it.
    first, second : (m,) int64 arrays
        Offsets from there to the two ends of the crossed edges.
    weight, scale, drop : (m,) float32 arrays
        Of the second end; inverse distance; fall of the Earth's surface over it, as a slope.
    own, mine : (n,) float32 array, int
        Heights of the receivers from a place on.
    best, at : (n,) float32 array, int
        Tangents of their horizons, changed in place.
    column : int
        Written to ``where``, (16,) int32, in lanes whose horizon rises.
    """
    number, index = types.intp, types.int32
    sig = types.void(
        *(heights, number, first, second, weight, scale, drop, number, number, own, number, best, number, index, where)
    )

    def generate(context, builder, signature, arguments):
        heights, place, *_, begin, end, own, mine, best, where_best, column, where = arguments
        kinds = signature.args
        h0 = sixteen(context, builder, kinds[9], own, mine)
        best_at = builder.bitcast(address(context, builder, kinds[11], best, where_best), ir.PointerType(_F32))
        highest = cgutils.alloca_once(builder, _F32)
        before = _load(builder, best_at)
        builder.store(before, highest)
        with cgutils.for_range_slice(builder, begin, end, ir.Constant(begin.type, 1), inc=True) as (n, _):
            rise = crossing(context, builder, kinds[0], heights, place, h0, n, zip(kinds[2:7], arguments[2:7], strict=True))
            top = builder.load(highest)
            builder.store(builder.select(builder.fcmp_ordered(">", rise, top), rise, top), highest)
        after = builder.load(highest)
        builder.store(after, best_at, align=4)
        where_at = _pointer(context, builder, kinds[14], where, _I32)
        rises = builder.fcmp_ordered(">", after, before)
        builder.store(builder.select(rises, _splat(builder, column, _I32), _load(builder, where_at)), where_at, align=4)

    return sig, generate


@intrinsic
def reaches(typingctx, tops, place, near, far, drop, own, mine, best, at):
    """Whether heights up to ``tops[place]`` and on may exceed ``best`` in any lane, from ``near`` to ``far`` (inverse) away.

    ``own[mine]``, ``best[at]`` and what follows belong to the receivers, as in `look`.
    """
    number = types.intp
    sig = types.boolean(tops, number, types.float32, types.float32, types.float32, own, number, best, number)

    def generate(context, builder, signature, arguments):
        tops, place, near, far, drop, own, mine, best, where_best = arguments
        kinds = signature.args
        over = builder.fsub(sixteen(context, builder, kinds[0], tops, place), sixteen(context, builder, kinds[5], own, mine))
        a, b = (builder.fmul(over, _splat(builder, v, _F32)) for v in (near, far))
        bound = builder.fsub(builder.select(builder.fcmp_ordered(">", a, b), a, b), _splat(builder, drop, _F32))
        top = sixteen(context, builder, kinds[7], best, where_best)
        return _any(builder, builder.fcmp_ordered(">", bound, top))

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
