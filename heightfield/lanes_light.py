"""Sixteen receivers side by side: what they gain from what they see, written once as LLVM vectors (see `lanes`)."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .lanes import _F32, LANES, _any, _load, _pointer, _splat, address, sixteen
from .lanes_moments import QUARTER, angle_of, bounded, constant, moments_of, weighed
from .lanes_skip import FUSED, crossing

# Rows of the working memory; the last four once for each normal
BEST, MINE, UP, ALONG, LEAST, NONE = range(6)
EACH = NONE + 1 - UP
TINY = 1e-30
SHORT = 0.05  # steps of tangents whose mean is their middle


def _fill(builder, row, nz, a, least):
    # `LEAST` is the tangent at which the plane rises, `NONE` W there: its sines and cosines cancel but for the angle's
    magnitude, below = bounded(builder, least)
    angle = angle_of(builder, magnitude, builder.fdiv(constant(1.0), magnitude), below)
    none = builder.fmul(builder.fmul(constant(0.5), a), angle)
    for k, value in ((UP, nz), (ALONG, a), (LEAST, least), (NONE, none)):
        builder.store(value, row(k), align=4)


@intrinsic
def start(typingctx, work, horizon, own, at):
    """Fill the working memory of the receivers from place ``at`` of flat float32 arrays on, but for their normals."""
    sig = types.void(work, horizon, own, types.intp)

    def generate(context, builder, signature, arguments):
        row = _rows(context, builder, signature.args[0], arguments[0])
        for k, kind, value in zip((BEST, MINE), signature.args[1:3], arguments[1:3], strict=True):
            builder.store(sixteen(context, builder, kind, value, arguments[3]), row(k), align=4)

    return sig, generate


@intrinsic
def face(typingctx, work, normals, size, at, east, north):
    """Fill in the one normal of each receiver: three components, ``size`` elements apart in a flat float32 array.

    ``east`` and ``north``: of the direction. Horizons are as high as the normals' planes at least.
    """
    number = types.intp
    sig = types.void(work, normals, number, number, types.float32, types.float32)

    def generate(context, builder, signature, arguments):
        work, normals, size, at, east, north = arguments
        row = _rows(context, builder, signature.args[0], work, ir.Constant(size.type, 0))
        places = at, builder.add(at, size), builder.add(at, builder.add(size, size))
        x, y, nz = (sixteen(context, builder, signature.args[1], normals, p) for p in places)
        a = builder.fadd(builder.fmul(x, _splat(builder, east, _F32)), builder.fmul(y, _splat(builder, north, _F32)))
        least = builder.fdiv(builder.fneg(a), nz)
        _fill(builder, row, nz, a, least)
        best = _load(builder, row(BEST))
        builder.store(builder.select(builder.fcmp_ordered(">", least, best), least, best), row(BEST), align=4)

    return sig, generate


@intrinsic
def facet(typingctx, work, which, heights, place, offsets, east, north, per_east, per_south):
    """Fill in normal number ``which``, of a triangle that meets the receivers.

    Its edge eastwards joins ``heights[place + offsets[4 which]]`` to ``[4 which + 1]``, that southwards ``[4 which + 2]`` to
    ``[4 which + 3]``; ``per_east`` and ``per_south`` are their inverse lengths, ``east`` and ``north`` the direction's.
    """
    number, real = types.intp, types.float32
    sig = types.void(work, number, heights, number, offsets, real, real, real, real)

    def generate(context, builder, signature, arguments):
        work, which, heights, place, offsets, east, north, per_east, per_south = arguments
        row, first = _rows(context, builder, signature.args[0], work, which), builder.mul(which, ir.Constant(which.type, 4))

        def height(k):
            at = address(context, builder, signature.args[4], offsets, builder.add(first, ir.Constant(first.type, k)))
            return sixteen(context, builder, signature.args[2], heights, builder.add(place, builder.load(at)))

        x, y = (
            builder.fmul(builder.fsub(height(k + 1), height(k)), _splat(builder, per, _F32))
            for k, per in ((0, per_east), (2, per_south))
        )
        long = builder.fadd(builder.fadd(constant(1.0), builder.fmul(x, x), flags=FUSED), builder.fmul(y, y), flags=FUSED)
        root = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_F32, [_F32]), f"llvm.sqrt.v{LANES}f32")
        root = builder.call(root, [long])
        nz = builder.fdiv(constant(1.0), root)
        least = builder.fsub(builder.fmul(x, _splat(builder, east, _F32)), builder.fmul(y, _splat(builder, north, _F32)))
        _fill(builder, row, nz, builder.fneg(builder.fmul(least, nz)), least)

    return sig, generate


@intrinsic
def open_sky(typingctx, work, which, share, out, at):
    """Add to ``out[at]`` and on (flat float32) what normal ``which`` gains from an even sky, times ``share``.

    That is W from the horizon, or the normal's plane, to the zenith, where its moments are ½ and π/4.
    """
    number = types.intp
    sig = types.void(work, number, types.float32, out, number)

    def generate(context, builder, signature, arguments):
        work, which, share, out, at = arguments
        row = _rows(context, builder, signature.args[0], work, which)
        nz, a, least, best = (_load(builder, row(k)) for k in (UP, ALONG, LEAST, BEST))
        t = builder.select(builder.fcmp_ordered(">", best, least), best, least)
        zenith = (constant(0.5), constant(0.5 * QUARTER))
        left = [builder.fsub(*pair) for pair in zip(zenith, moments_of(builder, t), strict=False)]
        w = weighed(builder, nz, a, left)
        w = builder.select(builder.fcmp_ordered(">", w, constant(0.0)), w, constant(0.0))
        target = builder.bitcast(address(context, builder, signature.args[3], out, at), ir.PointerType(_F32))
        more = builder.fmul(w, _splat(builder, share, _F32))
        builder.store(builder.fadd(_load(builder, target), more), target, align=4)

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
        for kind, array, index, value in ((kinds[3], out, at, total), (kinds[0], values, place, constant(0.0))):
            target = builder.bitcast(address(context, builder, kind, array, index), ir.PointerType(_F32))
            builder.store(value, target, align=4)

    return sig, generate


@intrinsic
def climb(typingctx, work, heights, place, first, second, weight, scale, drop, begin, end, tangents, which):
    """Let the receivers look at crossings ``begin`` to ``end`` (excluded); parameters as `lanes_skip.look` has them.

    The tangents under which they see each are written to ``tangents`` (flat float32, sixteen each), after those of the
    crossing before, and the numbers of crossings above the horizon of any of them to ``which`` (int64). Returns how many.
    """
    number = types.intp
    sig = number(work, heights, number, first, second, weight, scale, drop, number, number, tangents, which)

    def generate(context, builder, signature, arguments):
        work, heights, place, *_, begin, end, tangents, which = arguments
        kinds = signature.args
        row = _rows(context, builder, kinds[0], work)
        mine, zero, one = _load(builder, row(MINE)), ir.Constant(begin.type, 0), ir.Constant(begin.type, 1)
        best_at, count_at = cgutils.alloca_once(builder, _F32), cgutils.alloca_once(builder, begin.type)
        builder.store(_load(builder, row(BEST)), best_at)
        builder.store(zero, count_at)

        def look(n, k):
            ends, tangent = crossing(context, builder, kinds[3:8], arguments[3:8], n)
            a, b = (sixteen(context, builder, kinds[1], heights, builder.add(place, v)) for v in ends)
            rise = tangent(a, b, mine)
            builder.store(rise, _pointer(context, builder, kinds[10], tangents, _F32, k), align=4)
            return rise

        # Before the first crossing of all is the receiver itself
        look(builder.select(builder.icmp_signed(">", begin, zero), builder.sub(begin, one), begin), zero)
        with cgutils.for_range_slice(builder, begin, end, one, inc=True) as (n, _):
            rise, best, count = (
                look(n, builder.add(builder.sub(n, begin), one)),
                builder.load(best_at),
                builder.load(count_at),
            )
            new = builder.fcmp_ordered(">", rise, best)
            builder.store(builder.select(new, rise, best), best_at)
            # Written in any case, and overwritten unless it counts: what is seen cannot be predicted
            builder.store(n, address(context, builder, kinds[11], which, count))
            builder.store(builder.add(count, builder.zext(_any(builder, new), count.type)), count_at)
        return builder.load(count_at)

    return sig, generate


@intrinsic
def measure(typingctx, work, alone, tangents, begin, which, count, scale, bend, rises, sines, cosines, spots):
    """Raise the horizons to ``count`` crossings ``which``, and find what each of them newly shows.

    Written are, sixteen receivers each: the horizons before and after each to ``rises``, of them the two moments that make W
    to ``sines`` and ``cosines``, and to ``spots`` where between the crossing before (0) and this one (1) lies what is
    newly seen, on average. What is seen begins where the old horizon's sight line meets the surface. From afar its middle is
    half way from there, from near it is ``bend`` of the way (`gather.bends`). ``alone`` says that receivers have one normal.
    Other parameters as `climb` has them.
    """
    number = types.intp
    sig = types.void(work, types.boolean, tangents, number, which, number, scale, bend, rises, sines, cosines, spots)

    def generate(context, builder, signature, arguments):
        work, alone, tangents, begin, which, count, scale, bend, *results = arguments
        kinds = signature.args
        row = _rows(context, builder, kinds[0], work)
        best_at = cgutils.alloca_once(builder, _F32)
        nothing, zero, one = constant(0.0), ir.Constant(count.type, 0), ir.Constant(count.type, 1)

        def write(m, *values):
            for kind, target, value in zip(kinds[8:], results, values, strict=False):
                builder.store(value, _pointer(context, builder, kind, target, _F32, m), align=4)

        def positive(value):
            return builder.select(builder.fcmp_ordered(">", value, nothing), value, nothing)

        def listed(k, n):
            return _splat(builder, builder.load(address(context, builder, kinds[k], arguments[k], n)), _F32)

        def seen(k):
            return _load(builder, _pointer(context, builder, kinds[2], tangents, _F32, k))

        best = _load(builder, row(BEST))
        builder.store(best, best_at)
        moments = moments_of(builder, best)
        write(zero, best, *moments[:2])
        moments_at, middle_at = [cgutils.alloca_once_value(builder, v) for v in moments], cgutils.alloca_once(builder, _F32)
        with cgutils.for_range(builder, count) as loop:
            m = loop.index
            n = builder.load(address(context, builder, kinds[4], which, m))
            k, old = builder.sub(n, begin), builder.load(best_at)
            before, rise = seen(k), seen(builder.add(k, one))
            new = builder.select(builder.fcmp_ordered(">", rise, old), rise, old)
            builder.store(new, best_at)
            moments = moments_of(builder, new)
            more = []
            for at, value in zip(moments_at, moments, strict=True):
                more.append(builder.fsub(value, builder.load(at)))
                builder.store(value, at)
            # Heights below and above the old sight line; distances are inverse, so each is divided by the other's
            last = builder.select(builder.icmp_signed(">", n, zero), builder.sub(n, one), n)
            under = builder.fmul(positive(builder.fsub(old, before)), listed(6, n))
            step = builder.fsub(new, old)
            over = builder.fmul(step, listed(6, last))
            start = builder.fdiv(under, builder.fadd(builder.fadd(under, over), constant(TINY)))
            near = listed(7, n)
            middle = builder.fadd(near, builder.fmul(start, builder.fsub(constant(0.5), near), flags=FUSED), flags=FUSED)
            builder.store(middle, middle_at)
            wide = builder.and_(
                builder.fcmp_ordered(">", step, constant(SHORT)), builder.fcmp_ordered(">", old, constant(-1 / SHORT))
            )
            with cgutils.if_unlikely(builder, _any(builder, wide)):
                # Tangents count by what they add: to the one normal; of several, to level ground, or walls what lies below.
                # In short steps all count alike
                up = builder.fcmp_ordered(">=", old, constant(0.0))
                level = builder.select(up, constant(1.0), constant(0.0)), builder.select(up, constant(0.0), constant(1.0))
                shares = [builder.select(alone, _load(builder, row(k)), v) for k, v in zip((UP, ALONG), level, strict=True)]
                first, second = (weighed(builder, *shares, pair) for pair in ((more[2], more[0]), more))
                first = builder.fsub(first, builder.fmul(old, second))
                # Places lie the denser over tangents the farther; so does ``middle``, for tangents that count alike
                ratio = builder.fdiv(listed(6, n), listed(6, last))
                rest = builder.fsub(constant(1.0), ratio)
                ratio = builder.fadd(ratio, builder.fmul(start, rest))
                whole = builder.fsub(builder.fmul(step, second), builder.fmul(first, builder.fsub(constant(1.0), ratio)))
                lean = builder.fdiv(builder.fmul(first, builder.fadd(constant(1.0), ratio)), whole)
                leant = positive(builder.fmul(middle, lean))
                leant = builder.select(builder.fcmp_ordered("<", leant, constant(1.0)), leant, constant(1.0))
                builder.store(builder.select(wide, leant, middle), middle_at)
            middle = builder.load(middle_at)
            rest = builder.fmul(builder.fsub(constant(1.0), start), middle, flags=FUSED)
            at = _pointer(context, builder, kinds[11], results[3], _F32, m)
            builder.store(builder.fadd(start, rest, flags=FUSED), at, align=4)
            write(builder.add(m, one), new, *moments[:2])
        builder.store(builder.load(best_at), row(BEST), align=4)

    return sig, generate


@intrinsic
def tint(typingctx, which, spots, count, corners, weight, light, place, colours):
    """Write what ``count`` crossings show of the surface's radiance to ``colours``, sixteen receivers each.

    Crossing ``n`` shows a triangle between the one before and itself: its radiance there is straight between
    ``light[place + corners[4 n]]`` and ``[4 n + 1]``, by ``weight[n]``, and between ``[4 n + 2]`` and ``[4 n + 3]``, by
    ``weight[n + 1]``; how far between the two crossings is in ``spots``.
    """
    number = types.intp
    sig = types.void(which, spots, number, corners, weight, light, number, colours)

    def generate(context, builder, signature, arguments):
        which, spots, count, corners, weight, light, place, colours = arguments
        kinds = signature.args

        def between(a, b, share):
            return builder.fadd(a, builder.fmul(share, builder.fsub(b, a), flags=FUSED), flags=FUSED)

        with cgutils.for_range(builder, count) as loop:
            n = builder.load(address(context, builder, kinds[0], which, loop.index))
            ends = []
            for side in (0, 1):
                w = builder.load(address(context, builder, kinds[4], weight, builder.add(n, ir.Constant(n.type, side))))
                pair = []
                for k in (2 * side, 2 * side + 1):
                    four = builder.add(builder.mul(n, ir.Constant(n.type, 4)), ir.Constant(n.type, k))
                    offset = builder.load(address(context, builder, kinds[3], corners, four))
                    pair.append(sixteen(context, builder, kinds[5], light, builder.add(place, offset)))
                ends.append(between(*pair, _splat(builder, w, _F32)))
            spot = _load(builder, _pointer(context, builder, kinds[1], spots, _F32, loop.index))
            builder.store(between(*ends, spot), _pointer(context, builder, kinds[7], colours, _F32, loop.index), align=4)

    return sig, generate


@intrinsic
def total(typingctx, sines, cosines, colours, count, both):
    """Write the sums of the moments' differences times ``colours``, over ``count`` crossings, to ``both`` (32 float32)."""
    sig = types.void(sines, cosines, colours, types.intp, both)

    def generate(context, builder, signature, arguments):
        sines, cosines, colours, count, both = arguments
        kinds = signature.args
        one, parts = ir.Constant(count.type, 1), []
        for kind, values in ((kinds[0], sines), (kinds[1], cosines)):
            got = cgutils.alloca_once(builder, _F32)
            builder.store(constant(0.0), got)
            parts.append((kind, values, got))
        with cgutils.for_range(builder, count) as loop:
            colour = _load(builder, _pointer(context, builder, kinds[2], colours, _F32, loop.index))
            for kind, values, got in parts:
                before, now = (
                    _load(builder, _pointer(context, builder, kind, values, _F32, m))
                    for m in (loop.index, builder.add(loop.index, one))
                )
                more = builder.fmul(builder.fsub(now, before), colour, flags=FUSED)
                builder.store(builder.fadd(builder.load(got), more, flags=FUSED), got)
        for k, (*_, got) in enumerate(parts):
            at = _pointer(context, builder, kinds[4], both, _F32, ir.Constant(count.type, k))
            builder.store(builder.load(got), at, align=4)

    return sig, generate


@intrinsic
def shine(typingctx, work, which, rises, sines, cosines, colours, count, both, out, at):
    """Add to ``out[at]`` and on (flat float32) what normal ``which`` gains from ``count`` crossings.

    That is the differences of W that ``rises``, whose moments are ``sines`` and ``cosines``, make above the normal's plane,
    times the crossings' ``colours``; where all lies above it, ``both`` sums (see `total`) say it.
    """
    number = types.intp
    sig = types.void(work, number, rises, sines, cosines, colours, number, both, out, number)

    def generate(context, builder, signature, arguments):
        work, which, rises, sines, cosines, colours, count, both, out, at = arguments
        kinds = signature.args
        row = _rows(context, builder, kinds[0], work, which)
        nz, a, least = (_load(builder, row(k)) for k in (UP, ALONG, LEAST))
        target = builder.bitcast(address(context, builder, kinds[8], out, at), ir.PointerType(_F32))
        zero, one = ir.Constant(count.type, 0), ir.Constant(count.type, 1)

        def reached(m):
            arrays = (kinds[2], rises), (kinds[3], sines), (kinds[4], cosines)
            return [_load(builder, _pointer(context, builder, k, v, _F32, m)) for k, v in arrays]

        got = cgutils.alloca_once(builder, _F32)
        builder.store(_load(builder, target), got)
        first, *moments = reached(zero)
        with builder.if_else(_any(builder, builder.fcmp_ordered("<", first, least))) as (some, none):
            with some:
                hidden, seen = _load(builder, row(NONE)), cgutils.alloca_once(builder, _F32)
                builder.store(
                    builder.select(builder.fcmp_ordered(">", first, least), weighed(builder, nz, a, moments), hidden), seen
                )
                with cgutils.for_range(builder, count) as loop:
                    t, *now = reached(builder.add(loop.index, one))
                    w = builder.select(builder.fcmp_ordered(">", t, least), weighed(builder, nz, a, now), hidden)
                    colour = _load(builder, _pointer(context, builder, kinds[5], colours, _F32, loop.index))
                    more = builder.fmul(builder.fsub(w, builder.load(seen)), colour, flags=FUSED)
                    builder.store(builder.fadd(builder.load(got), more, flags=FUSED), got)
                    builder.store(w, seen)
            with none:
                sums = [
                    _load(builder, _pointer(context, builder, kinds[7], both, _F32, ir.Constant(count.type, k)))
                    for k in (0, 1)
                ]
                builder.store(builder.fadd(builder.load(got), weighed(builder, nz, a, sums), flags=FUSED), got)
        builder.store(builder.load(got), target, align=4)

    return sig, generate


@intrinsic
def worth(typingctx, work, which, top, near, fall, slack):
    """Whether a surface up to ``top`` may add more than ``slack`` to W of any receiver, from ``near`` (inverse) on."""
    sig = types.boolean(work, types.intp, types.float32, types.float32, types.float32, types.float32)

    def generate(context, builder, signature, arguments):
        work, which, top, near, fall, slack = arguments
        row = _rows(context, builder, signature.args[0], work, which)
        top, near, fall, slack = (_splat(builder, v, _F32) for v in (top, near, fall, slack))
        rise = builder.fsub(builder.fmul(builder.fsub(top, _load(builder, row(MINE))), near), fall)
        nz, a, least, best = (_load(builder, row(k)) for k in (UP, ALONG, LEAST, BEST))
        seen = builder.select(builder.fcmp_ordered(">", best, least), best, least)
        rise = builder.select(builder.fcmp_ordered(">", rise, seen), rise, seen)
        after, before = (weighed(builder, nz, a, moments_of(builder, t)) for t in (rise, seen))
        return _any(builder, builder.fcmp_ordered(">", builder.fsub(after, before), slack))

    return sig, generate


def _rows(context, builder, kind, work, which=None):
    # Address of each row of the working memory, (2 + 4 m, 16) float32
    def row(k):
        place = ir.Constant(ir.IntType(64), k)
        if which is not None and k >= UP:
            place = builder.add(place, builder.mul(which, ir.Constant(ir.IntType(64), EACH)))
        return _pointer(context, builder, kind, work, _F32, place)

    return row
