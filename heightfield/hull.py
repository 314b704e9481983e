"""Global horizons by hull stacks: near the receiver exactly, beyond by shared lines that say where to look.

Only the highest horizon is wanted here, so one upper convex hull a line is enough (Timonen and Westerholm 2010; the paper's
§2 names it as its ancestor): samples are pushed from the far end of the line, and the receiver's horizon is the tangent to
the hull. As on the paper's graphics hardware (§8) a line is one lane of a vector, written once in Dr.Jit, for LLVM and CUDA.

Lines are parallel, `LINES` of them a row, and each grid point takes the nearest. A line tells a receiver only *in which
column* its horizon is; the receiver's own ray over the cells around it tells how high. The first `NEAR` columns, where a line
beside the receiver would mislead most, are marched.
"""

from __future__ import annotations

import functools
import math

import drjit as dr
import numpy as np

from ..errors import interrupts
from . import march

NEAR = 16  # columns marched exactly
LINES = 3  # shared lines a row, beyond
BESIDE = 1e-4  # columns; a crossing that near to a sample of the line is none of its own
LEVEL, FAR = 1e-30, 1e9  # rows a column; columns
LONGEST = 1 << 14  # columns; a lane's hull lives on the thread's stack


@functools.cache
def _types():
    # Dr.Jit's array types of the fastest backend there is
    if dr.has_backend(dr.JitBackend.CUDA):
        from drjit import cuda as backend
    else:
        from drjit import llvm as backend
    return backend.Float, backend.Float64, backend.Int32, backend.UInt32


@dr.syntax
def _locate(heights, where, looked, rows, columns, slope, bend, diagonal, shared, first, per_row, near, depth):
    """Write to ``where`` the column of every receiver's horizon beyond ``near`` columns, as its line sees it."""
    Float, Float64, Int32, UInt32 = _types()
    b = Float64(first) + Float64(dr.arange(Int32, per_row * shared)) / shared
    half = 0.5 / shared
    # Columns over which the line lies on the field
    steep, above = dr.maximum(slope, LEVEL), Float64(rows - 1) - b
    x0 = Int32(dr.clip(dr.ceil((-half - b) / steep - 1e-9), 0, FAR))
    x1 = dr.minimum(columns - 1, Int32(dr.clip(dr.floor((above + march.NEARBY) / steep), -1, FAR)))
    # Between two columns it may end on the last row
    leave = above / steep
    end = dr.select((x1 >= 0) & (x1 < columns - 1) & (leave > Float64(x1) + 1e-9), x1 + 1, x1)
    px, ph = dr.alloc_local(Float, depth), dr.alloc_local(Float, depth)
    # Of full width from the start: loops keep no lane apart in what begins as one number. The bound, which is never reached,
    # is for Dr.Jit 1.5: it takes kernels that differ in their local memory's size alone for one, and runs the older
    x, slope32 = dr.minimum(Int32(x1), depth), Float(slope)
    n, steps = 0 * x, UInt32(0 * x)
    # The two nearest corners of the hull, t before u, are kept at hand
    tx, th, ux, uh, beyond, ahead = (Float(n) for _ in range(6))
    while dr.hint(x >= x0, mode="symbolic"):
        # Push the line's sample `near` columns ahead, and drop what it and the corner below it overtop
        c = x + near
        new, last = c <= end, c > x1
        y = dr.clip(b + slope * Float64(c), 0, Float64(rows - 1))
        r = Int32(y)
        f = Float(y - Float64(r))
        h = dr.gather(Float, heights, r * columns + c, new)
        between = new & (r + 1 < rows)
        g = dr.gather(Float, heights, (r + 1) * columns + c, between)
        edge = dr.select(between, h + f * (g - h), h)
        # On the last row, where it ends
        before = dr.gather(Float, heights, r * columns + c - 1, new & last)
        part = Float(leave - Float64(c - 1))
        edge = dr.select(last, before + part * (h - before), edge)
        at = Float(c) + dr.select(last, part - 1, 0)
        # The next cell's diagonal, or row: whichever rises more above the straight way through the cell comes first
        inner = between & (c < end)
        across = dr.gather(Float, heights, (r + 1) * columns + c + 1, inner)
        if dr.hint(diagonal, mode="scalar"):
            t = f / (1 - slope32)
            ridge = h + t * (across - h)
        else:
            t = (1 - f) / (1 + slope32)
            other = dr.gather(Float, heights, r * columns + c + 1, inner)
            ridge = g + t * (other - g)
        chord = (beyond - edge) / (ahead - at)
        over = dr.select(inner & (t > BESIDE) & (t < 1 - BESIDE), ridge - (edge + t * chord), 0)
        t_row = (1 - f) / slope32
        row = g + t_row * (across - g)
        higher = inner & (t_row > BESIDE) & (t_row < 1 - BESIDE) & (row - (edge + t_row * chord) > dr.maximum(over, 0))
        crossing = Float(c) + dr.select(higher, t_row, t), dr.select(higher, row, ridge), higher | (over > 0)
        beyond, ahead = dr.select(new, edge, beyond), dr.select(new, at, ahead)
        for cf, h, push in (crossing, (at, edge, new)):
            # A parabola for the Earth's curvature: one for the whole line keeps the order of slopes at every receiver
            h -= bend * cf * cf
            drop = push & (n >= 2)
            while dr.hint(drop, mode="symbolic"):
                drop &= ~((th - h) * (ux - cf) > (uh - h) * (tx - cf))
                n = dr.select(drop, n - 1, n)
                tx, th = dr.select(drop, ux, tx), dr.select(drop, uh, th)
                drop &= n >= 2
                q = UInt32(n - 2)
                ux, uh = dr.select(drop, px.read(q, drop), ux), dr.select(drop, ph.read(q, drop), uh)
                steps += 1
            px.write(cf, UInt32(n), push)
            ph.write(h, UInt32(n), push)
            ux, uh = dr.select(push, tx, ux), dr.select(push, th, uh)
            tx, th = dr.select(push, cf, tx), dr.select(push, h, th)
            n = dr.select(push, n + 1, n)
            steps += dr.select(push, UInt32(1), UInt32(0))

        # The receiver in this column whose nearest line this is: slopes along the hull rise, then fall
        y = b + slope * Float64(x)
        i = Int32(dr.floor(y + 0.5))
        d = y - Float64(i)
        mine = (n > 0) & (i >= 0) & (i < rows) & (d > -half) & (d <= half)
        if dr.hint(mine, mode="symbolic"):
            xf = Float(x)
            own = dr.gather(Float, heights, i * columns + x, mine) - bend * xf * xf
            at, best, k = Float(tx), (th - own) / (tx - xf), n - 1
            more = mine & (k > 0)
            while dr.hint(more, mode="symbolic"):
                q = UInt32(k - 1)
                ahead = px.read(q, more)
                rise = (ph.read(q, more) - own) / (ahead - xf)
                more &= rise > best
                best, at = dr.select(more, rise, best), dr.select(more, ahead, at)
                k = dr.select(more, k - 1, k)
                more &= k > 0
                steps += 1
            dr.scatter(where, Int32(at), i * columns + x, mine)
        x -= 1
    dr.scatter(looked, steps, dr.arange(UInt32, per_row * shared))


def _cell(heights, i, j, h0, k, slope, bend, rows, columns, diagonal, active):
    # Steepest rise a column from receivers (i, j) to the crossings of their own rays in columns k (included) to k + 1
    Float, _, Int32, _ = _types()
    kf = Float(k)
    y = slope * kf
    r = Int32(y)
    f = y - Float(r)
    r, x = r + i, j + k
    s = r + 1
    at = r * columns + x
    on = active & (x < columns) & (r < rows)
    below = on & (s < rows)

    def height(offset, mask):
        return dr.gather(Float, heights, at + offset, mask)

    def rise(a, b, t, distance):
        return (a + t * (b - a) - h0) / distance - bend * distance

    best = Float(-dr.inf)
    a, b = height(0, on), height(columns, below)
    best = dr.select(below, rise(a, b, f, kf), dr.select(on & (f < march.NEARBY), rise(a, a, 0, kf), -dr.inf))
    inner = below & (x + 1 < columns)
    d = height(columns + 1, inner)
    climbs = f + slope > 1
    t = (1 - f) / slope
    best = dr.select(inner & climbs, dr.maximum(best, rise(b, d, t, kf + t)), best)
    if diagonal:
        t = f / (1 - slope)
        best = dr.select(inner & ~climbs & (t > 0) & (t < 1), dr.maximum(best, rise(a, d, t, kf + t)), best)
    else:
        t = (1 - f) / (1 + slope)
        best = dr.select(inner & (t < 1), dr.maximum(best, rise(b, height(1, inner), t, kf + t)), best)
        t = (2 - f) / (1 + slope)
        inner &= climbs & (s + 1 < rows) & (t < 1)
        best = dr.select(inner, dr.maximum(best, rise(height(2 * columns, inner), d, t, kf + t)), best)
    return best


def horizons(heights, d, curve: float = 0.0, near: int = NEAR, lines: int = LINES, tally=None) -> np.ndarray:
    """Tangent of the horizon of every grid point along +x.

    Parameters
    ----------
    heights : (rows, columns) float32 array
        Turned heights, centred; at most `LONGEST` columns.
    d : sweep.Direction
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    near : int
        Columns looked at on the receiver's own ray.
    lines : int
        Shared lines a row, for what lies beyond.
    tally : list of int, optional
        What was looked at is appended: crossings, and corners of hulls.

    Returns
    -------
    (rows, columns) float32 array
        −inf where nothing of the field lies in the direction.
    """
    Float, Float64, Int32, UInt32 = _types()
    heights = np.ascontiguousarray(heights, dtype=np.float32)
    out = march.horizons(heights, d, curve, near, tally)
    shape = heights.shape
    if shape[1] - 1 <= near:
        return out
    # Where every ray through a grid point is a line of the grid, one line a row is all there is (and exact, but for crossings
    # that displace a sample where slope is 1 and cells are cut the other way)
    lines = 1 if d.slope in (0.0, 1.0) else lines
    first = -math.ceil(d.slope * (shape[1] - 1)) - 1
    looked = dr.zeros(UInt32, (shape[0] + 1 - first) * lines)
    field, where = Float(heights.ravel()), dr.full(Int32, -1, heights.size)
    # Opaque: one kernel for every direction and field
    rows, columns, near = (dr.opaque(Int32, v) for v in (*shape, near))
    slope, bend, step = dr.opaque(Float64, d.slope), dr.opaque(Float, curve * d.step**2), dr.opaque(Float, d.step)
    dr.eval(field, where, looked, rows, columns, near, slope, bend, step)
    # Two corners a column at most
    depth = 2 << (shape[1] - 1).bit_length()
    with interrupts():
        _locate(
            field,
            where,
            looked,
            rows,
            columns,
            slope,
            bend,
            d.diagonal,
            lines,
            dr.opaque(Int32, first),
            shape[0] + 1 - first,
            near,
            depth,
        )
    dr.eval(where, looked)
    if tally is not None:
        # In the columns before and behind the hull's corner, two or three crossings each
        tally += [int(looked.numpy().sum(dtype=np.int64)), round((2 + d.slope) * 3 * heights.size)]

    # How high: on the receiver's own ray, around that column
    index = dr.arange(Int32, heights.size)
    i = Int32((Float64(index) + 0.5) * dr.opaque(Float64, 1 / shape[1]))
    j = index - i * columns
    # The line may leave the field later than the receiver's ray
    last = Int32(dr.minimum((Float64(rows - 1 - i) + march.NEARBY) / dr.maximum(slope, LEVEL), FAR))
    k, slope = dr.minimum(where - j, last), Float(slope)
    found = where >= 0
    h = dr.gather(Float, field, index)
    rise = [_cell(field, i, j, h, k + o, slope, bend, rows, columns, d.diagonal, found & (k + o >= near)) for o in (-1, 0, 1)]
    far = functools.reduce(dr.maximum, rise) / step
    return np.maximum(out, far.numpy().reshape(shape))
