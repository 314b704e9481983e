"""Light cells: per-pixel counts of seen and unseen light samples, packed so that windows of pixels add up cheaply.

A light's sampling square is cut into 4×4 cells (§5.2). A pixel's pilot rays are counted by cell, eight 8-bit counters to
a 64-bit word, so that the sum over a window of pixels is one integer addition a word: neighbouring pixels share their
pilots. What a pixel decides from is always the window *without the pixel itself*: its own samples stay independent of
the decision, which is what keeps the estimate unbiased.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

RADIUS = 2  # windows are 5×5 pixels
MAX_PILOT = 8  # 25 pixels × 8 rays stay below an 8-bit counter's 255


def empty(bins: int) -> list:
    """Return zeroed counter words for ``bins`` bins."""
    return [mi.UInt64(0) for _ in range((bins + 7) // 8)]


def count(words: list, bin_index, active) -> list:
    """Add one to bin ``bin_index`` of packed counters where ``active``."""
    one = mi.UInt64(1) << mi.UInt64((bin_index & 7) << 3)
    which = bin_index >> 3
    return [w + dr.select(active & (which == i), one, mi.UInt64(0)) for i, w in enumerate(words)]


def sure(words: list, active, grid: int, rays: int) -> list:
    """Add one to ``rays`` bins along the diagonal of the grid where ``active``: a light known to be visible all over."""
    one = [0] * len(words)
    for k in range(rays):
        cell = 5 * (k % grid)
        one[cell >> 3] += 1 << (8 * (cell & 7))
    return [w + dr.select(active, mi.UInt64(o), mi.UInt64(0)) for w, o in zip(words, one, strict=True)]


def read(words: list, bin_index: int):
    """Return the counter of a (Python integer) bin as ``mi.UInt32``."""
    return mi.UInt32((words[bin_index >> 3] >> (8 * (bin_index & 7))) & 255)


def window_sum(values: list, width: int, height: int, radius: int = RADIUS, apart: int = 1) -> list:
    """Sum each array over square windows of pixels, the pixel itself left out.

    Parameters
    ----------
    values : list of Dr.Jit arrays
        Row-major images of ``width × height`` entries (packed counters or floats).
    width, height : int
        Image size in pixels.
    radius : int
        Window half-width; the window is ``(2 radius + 1)²`` pixels, cut at the image border.
    apart : int
        Pixels from one of them to the next.

    Returns
    -------
    list of Dr.Jit arrays
    """
    index = dr.arange(mi.UInt32, width * height)
    x, y = mi.Int32(index % dr.opaque(mi.UInt32, width)), mi.Int32(index // dr.opaque(mi.UInt32, width))
    w, h = dr.opaque(mi.Int32, width), dr.opaque(mi.Int32, height)

    def along(arrays, out, dx, dy):
        for step in [s for s in range(-radius, radius + 1) if s]:
            xs, ys = x + step * apart * dx, y + step * apart * dy
            inside = (xs >= 0) & (xs < w) & (ys >= 0) & (ys < h)
            at = mi.UInt32(ys * w + xs)
            out = [o + dr.gather(type(a), a, at, inside) for o, a in zip(out, arrays, strict=True)]
        return out

    # What is never added need not be taken away: differences of floats would keep some of a bright pixel
    dr.eval(values)
    beside = along(values, [dr.zeros(type(v), width * height) for v in values], 1, 0)
    rows = [b + v for b, v in zip(beside, values, strict=True)]
    dr.eval(beside, rows)
    out = along(rows, beside, 0, 1)
    dr.eval(out)
    return out


def window_count(width: int, height: int, radius: int = RADIUS):
    """Count the pixels that `window_sum` adds up, as ``mi.Float``."""
    index = dr.arange(mi.UInt32, width * height)
    w, h = dr.opaque(mi.Int32, width), dr.opaque(mi.Int32, height)
    length = lambda at, end: dr.minimum(at + radius, end - 1) - dr.maximum(at - radius, 0) + 1  # noqa: E731
    return mi.Float(length(mi.Int32(index) % w, w) * length(mi.Int32(index) // w, h) - 1)


def total(words: list):
    """Add up packed 8-bit counters, which are at most 255 together in a word."""
    return sum((mi.UInt32((w * mi.UInt64(0x0101010101010101)) >> mi.UInt64(56)) for w in words), mi.UInt32(0))


def neighbors(values: list, width: int, height: int, apart: int = 1):
    """Yield float images at each of the eight pixels ``apart`` away, nought beyond the border, and whether there is one."""
    index = dr.arange(mi.UInt32, width * height)
    w, h = dr.opaque(mi.Int32, width), dr.opaque(mi.Int32, height)
    x, y = mi.Int32(index) % w, mi.Int32(index) // w
    dr.eval(values)
    for dy in (-apart, 0, apart):
        for dx in (-apart, 0, apart):
            if dx or dy:
                xs, ys = x + dx, y + dy
                inside = (xs >= 0) & (xs < w) & (ys >= 0) & (ys < h)
                at = mi.UInt32(ys * w + xs)
                yield [dr.gather(mi.Float, v, at, inside) for v in values], inside


def pack_fractions(fractions: list):
    """Pack 16 fractions to 4 bits each; only exact 0 and 1 map to 0 and 15."""
    word = mi.UInt64(0)
    for c, f in enumerate(fractions):
        q = mi.UInt32(dr.clip(dr.round(f * 15), 1, 14))
        q = dr.select(f <= 0, 0, dr.select(f >= 1, 15, q))
        word |= mi.UInt64(q) << mi.UInt64(4 * c)
    return word


def fraction(word, cell):
    """Return the packed fraction of a cell, in [0, 1]."""
    return mi.Float(mi.UInt32((word >> mi.UInt64(cell << 2)) & 15)) * mi.Float(1 / 15)


def undecided(word):
    """Return a 16-bit mask of the cells that are neither fully lit nor fully hidden."""
    mask = mi.UInt32(0)
    for c in range(16):
        q = mi.UInt32((word >> (4 * c)) & 15)
        mask |= dr.select((q != 0) & (q != 15), mi.UInt32(1 << c), mi.UInt32(0))
    return mask


def sample(mask, u, floor):
    """Warp a point of the unit square so that undecided cells are visited more often (refinement, Kok and Jansen 1992).

    Parameters
    ----------
    mask : mi.UInt32
        Undecided cells; these get weight 1.
    u : mi.Point2f
        A stratified point; rows first, then cells within the row, so its strata survive.
    floor : mi.Float
        Weight of the other cells, > 0: what was decided is still checked.

    Returns
    -------
    cell : mi.UInt32
        Row-major cell index.
    v : mi.Point2f
        Point in the light's unit square.
    density : mi.Float
        Density of ``v`` over the square (1 for a uniform mask).
    """
    ones = mi.Float(dr.popcnt(mask & 0xFFFF))
    total = ones + (16 - ones) * floor
    # The row: a cumulative sum over the rows' weights
    t, row, weight = u.y * total, mi.UInt32(0), mi.Float(0)
    running = mi.Float(0)
    begin = mi.Float(0)
    for r in range(4):
        k = mi.Float(dr.popcnt((mask >> (4 * r)) & 15))
        w = k + (4 - k) * floor
        here = t >= running if r else mi.Bool(True)
        row, begin, weight = dr.select(here, r, row), dr.select(here, running, begin), dr.select(here, w, weight)
        running += w
    vy = dr.clip((t - begin) / weight, 0, 1 - 2**-20)
    # The cell within the row, the same way
    bits = (mask >> (row << 2)) & 15
    t, col, size = u.x * weight, mi.UInt32(0), mi.Float(1)
    running, begin = mi.Float(0), mi.Float(0)
    for c in range(4):
        w = dr.select((bits & (1 << c)) != 0, mi.Float(1), floor)
        here = t >= running if c else mi.Bool(True)
        col, begin, size = dr.select(here, c, col), dr.select(here, running, begin), dr.select(here, w, size)
        running += w
    vx = dr.clip((t - begin) / size, 0, 1 - 2**-20)
    v = mi.Point2f((mi.Float(col) + vx) * 0.25, (mi.Float(row) + vy) * 0.25)
    return row * 4 + col, v, 16 * size / total
