"""Rays that step over what they cannot see: every receiver follows its own ray, exactly, over the few crossings that matter.

The march (`march`) looks at every crossing. Most lie in stretches whose highest point is too low to be seen over what stands
before them. Here the heights at most of stretches of `SIZES` columns are known, sheared along the direction, so that a
stretch of one ray is one number; sixteen rays from neighbouring rows, a lane each, look into a stretch only if one of them
may see it.

The field lies with its columns side by side, (planes, columns, rows + margin), so that lanes lie side by side too.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numba as nb
import numpy as np

from . import march
from .faces import planes
from .lanes import LANES
from .lanes_skip import look, reaches, soon

SHIFTS = (3, 5, 7, 9)
SIZES = tuple(1 << n for n in SHIFTS)  # columns of a stretch
TOP = len(SIZES) - 1
AHEAD = 4  # columns at which to fetch results before they are needed
SEEDS = 4  # stretches at which to look first


class Way(NamedTuple):
    """What rays of one direction meet, and how high it is at most, from all receivers that lie alike in their cells.

    Attributes
    ----------
    first, second : (n,) int64 arrays
        Places in the laid field of the crossed edges' two ends, from the receiver's cell.
    weight, scale : (n,) float32 arrays
        Of the second end; inverse distance, 1/m.
    drop : (n,) float32 array or None
        Fall of the Earth's surface over the distance, as a slope.
    upto : (m,) int64 array
        Crossings up to each column, from the receiver's cell.
    down : (m,) int64 array
        Row of each cell that the ray enters, from the receiver's cell.
    inverse, fall : (m,) float32 arrays
        Inverse distance of each column, 1/m; ``drop`` there.
    tops : (l,) float32 array
        Heights at most of stretches, by size, stretch and row at which it is entered.
    begins : (4,) int64 array
        Where each size begins in ``tops``.
    """

    first: np.ndarray
    second: np.ndarray
    weight: np.ndarray
    scale: np.ndarray
    drop: np.ndarray | None
    upto: np.ndarray
    down: np.ndarray
    inverse: np.ndarray
    fall: np.ndarray
    tops: np.ndarray
    begins: np.ndarray


@functools.lru_cache(256)
def swept(d, s: int, stride: int, size: int):
    """List what rays sweep over, in a stretch of `SIZES[0]` columns, that enter it between one row and the next.

    They are highest where the first or the last of them crosses an edge, or at a vertex between those two.

    Returns
    -------
    first, second : (n,) int64 arrays
        Places of edges' ends in the laid field, from the cell where the stretch begins.
    row, column : (n,) int64 arrays
        Of the farther end.
    weight : (n,) float32 array
        Of the second end.
    """
    ends = []
    for y in (0, s):
        offset, weight, _ = march.crossings(d.slope, d.diagonal, s * SIZES[0], y, 0.0)
        ends += [(*offset[n], weight[n]) for n in range(len(offset))]
    for c in range(s * SIZES[0] + 1):
        low, high = np.ceil(d.slope * c - march.NEARBY), np.floor(s + d.slope * c + march.NEARBY)
        ends += [(r, c, r, c, 0.0) for r in range(int(low), int(high) + 1)]
    ra, ca, rb, cb = (np.array(v, dtype=np.int64) for v in zip(*(e[:4] for e in ends), strict=True))
    first, second = (((c % s) * s + r % s) * size + c // s * stride + r // s for r, c in ((ra, ca), (rb, cb)))
    first, second, weight = _from_nearer(first, second, np.array([e[4] for e in ends]))
    return first, second, np.maximum(ra, rb) // s, np.maximum(ca, cb) // s, weight.astype(np.float32)


@nb.njit(cache=True, parallel=True)
def _lowest_level(heights, columns, stride, first, second, row, column, weight, out):
    for b in nb.prange(len(out)):
        t = out[b]
        t[:] = np.float32(march.ABYSS)
        for n in range(len(first)):
            if SIZES[0] * b + column[n] < columns:
                place, count, w = SIZES[0] * b * stride, stride - row[n], weight[n]
                f, g = heights[place + first[n] :], heights[place + second[n] :]
                for i in range(count):
                    h = f[i] + w * (g[i] - f[i])
                    t[i] = max(t[i], h)


@nb.njit(cache=True)
def _next_level(source, slope, size, ratio, out):
    # Rays that enter between one row and the next enter each following stretch over two
    for b in range(len(out)):
        t = out[b]
        t[:] = np.float32(march.ABYSS)
        for k in range(min(ratio, len(source) - ratio * b)):
            row = int(np.floor(slope * size * k + march.NEARBY))
            for r in (row, row + 1):
                s = source[ratio * b + k, r:]
                for i in range(len(s)):
                    t[i] = max(t[i], s[i])


def stretches(laid, d, s: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights at most of all stretches along a direction, flat, and where each size begins; see `Way`."""
    size, columns, stride = laid[0].size, *laid.shape[1:]
    begins = np.concatenate([[0], np.cumsum([-(-columns // size) for size in SIZES])])
    out = np.empty((begins[-1], stride), np.float32)
    level = out[: begins[1]]
    _lowest_level(laid.ravel(), columns, stride, *swept(d, s, stride, size), level)
    for n in range(1, len(SIZES)):
        below, level = level, out[begins[n] : begins[n + 1]]
        _next_level(below, d.slope, SIZES[n - 1], SIZES[n] // SIZES[n - 1], level)
    return out.ravel(), begins[:-1] * stride


def _from_nearer(first, second, weight):
    # Weights count from the nearer end, so that rounding makes none 1: the other end may be in the abyss
    swap = weight > 0.5
    return np.where(swap, second, first), np.where(swap, first, second), np.where(swap, 1 - weight, weight)


def way(shape, tops, d, curve: float, edges, weight, distance, y: float = 0.0, x: float = 0.0) -> Way:
    """Prepare what `seek` needs.

    Parameters
    ----------
    shape : (int, int, int)
        Planes, columns, and rows and margin of the laid field.
    tops : (array, array)
        As `stretches` returns them for ``d``.
    d : sweep.Direction
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    edges, weight, distance
        Crossings, as `faces.Ray` has them, at least one.
    y, x : float
        Row and column of the receivers in their cells.
    """
    size, stride = shape[1] * shape[2], shape[2]
    first, second = (edges[:, e].astype(np.int64) @ [size, 1, stride] for e in (slice(0, 3), slice(3, 6)))
    first, second, weight = _from_nearer(first, second, weight)
    k = np.arange(int(np.ceil(distance[-1] + x)) + 3)
    metres = np.maximum(k - x, 1e-3) * d.step
    upto = np.searchsorted(distance, k - x + march.NEARBY, side="right")
    down = np.floor(y + d.slope * (k - x) + march.NEARBY).astype(np.int64)
    drop, fall = (curve * d.step * v for v in (distance, np.maximum(k - x, 0)))
    numbers = weight, 1 / (distance * d.step), drop, 1 / metres, fall
    weight, scale, drop, inverse, fall = (v.astype(np.float32) for v in numbers)
    return Way(first, second, weight, scale, drop if curve else None, upto, down, inverse, fall, *tops)


@nb.njit(cache=True, forceinline=True, _nrt=False)
def seek(down, inverse, fall, tops, begins, stride, x, i, k, last, gap, own, mine, best, at, pitch):
    """Follow rays from column ``x`` and rows ``i`` to ``i + 15`` to the next stretch that any of them may see.

    Parameters
    ----------
    down, inverse, fall, tops, begins
        Of the `Way`.
    stride : int
        Of the laid field.
    k, last : int
        Columns from the receivers, a stretch's first one where the search begins, and one where it ends.
    gap, own, mine, best, at, pitch
        Which receivers, their heights and the tangents of their horizons, as `lanes_skip.reaches` has them.

    Returns
    -------
    k : int
        Where the stretch, or what is left of it, begins; ``last`` if there is none.
    tests : int
    """
    tests = 0
    while k < last:
        c = x + k
        level = TOP
        while level > 0 and c & (SIZES[level] - 1):
            level -= 1
        while True:
            tests += 1
            end = min(k + SIZES[level], last)
            rows = begins[level] + (c >> SHIFTS[level]) * stride + i
            if not reaches(tops, rows, down, inverse, fall, k, end, gap, own, mine, best, at, pitch):
                break
            if level == 0:
                return k, tests
            level -= 1
        k = end
    return last, tests


@nb.njit(cache=True)
def leaves(down, stride, i):
    """Return after how many columns the last of the rays from rows ``i`` to ``i + 15`` leaves the field."""
    return min(np.searchsorted(down, stride - march.BLOCK - i), len(down) - 2)


@nb.njit(cache=True)
def _strip(
    heights, stride, edge, own, out, pitch, i, first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins
):
    # `steepest` for receivers in rows ``i`` to ``i + 15``
    leave = leaves(down, stride, i)
    # Where the last receivers found their horizons: the next ones find theirs near, and need to look at less on the way
    where, seeds = np.full(LANES, -1, np.int32), np.full(SEEDS, -1, np.int64)
    steps, x = 0, len(own) // pitch - 1
    while x >= 0:
        # Two neighbours in one stretch look together, at what either has to: the nearer one's way is a column longer
        gap = x & 1
        place, mine, room = x * stride + i, x * pitch + i, edge - x
        if out[mine] == np.inf and out[mine - gap * pitch] == np.inf:
            # None of the sixteen receives
            x -= 1 + gap
            continue
        last = min(room, leave)
        for ahead in (AHEAD, AHEAD + 1):
            soon(own, mine - ahead * pitch)
            soon(out, mine - ahead * pitch)
        # To the first whole stretch all is looked at, then the seeds, then what may still be seen
        whole = min(SIZES[0] - (x & (SIZES[0] - 1)), last)
        c, begin, end, k, seed = x - (x & (SIZES[0] - 1)), 0, whole, whole, 0
        while True:
            a, b = upto[begin], upto[min(end + gap, last)]
            look(heights, place, stride, first, second, weight, scale, drop, a, b, gap, own, out, mine, pitch, c, where)
            steps += (1 + gap) * (b - a)
            if gap and end == room < leave:
                # The nearer one's last column is beyond the other's border
                a, b, to, at = upto[room], upto[room + 1], place - stride, mine - pitch
                look(heights, to, stride, first, second, weight, scale, drop, a, b, 0, own, out, at, pitch, c, where)
            c = -1
            while seed < SEEDS and c < 0:
                c = seeds[seed] if whole <= seeds[seed] - x < last else -1
                seed += 1
            while c < 0:
                k, tests = seek(down, inverse, fall, tops, begins, stride, x, i, k, last, gap, own, mine, out, mine, pitch)
                steps += (1 + gap) * tests
                if k == last:
                    break
                if x + k not in seeds:
                    c = x + k
                k = min(k + SIZES[0], last)
            if c < 0:
                break
            begin, end = c - x, min(c - x + SIZES[0], last)
        # Few lanes stand for all
        before = -1
        for seed in range(SEEDS):
            c = where[seed * (LANES // SEEDS) + LANES // SEEDS // 2]
            seeds[seed] = -1 if c == before else c
            before = c
        x -= 1 + gap
    return steps


@nb.njit(cache=True, parallel=True)
def steepest(laid, way, own, out, receivers):
    """Raise ``out`` to the steepest rise towards any crossing.

    Parameters
    ----------
    laid : (planes, columns, rows + margin) float32 array
        Turned heights, centred, with `march.ABYSS` beyond the border.
    way : Way
    own : (m, n) float32 array
        Heights of the receivers, columns first; n is at least the next multiple of 16.
    out : (m, n) float32 array
        Tangents of the horizons so far, changed in place; infinite for what is no receiver.
    receivers : int
        Rows of receivers.

    Returns
    -------
    int
        Crossings looked at and tests of stretches, over all receivers.
    """
    heights, strips = laid.ravel(), -(-receivers // LANES)
    mine, best = own.ravel(), out.ravel()
    half, looked = (strips + 1) // 2, 0
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins = way
    for t in nb.prange(strips):
        # Rays from the first rows are the longest: threads, which take neighbours, get some of all
        i = LANES * (2 * t if t < half else 2 * (t - half) + 1)
        looked += min(LANES, receivers - i) * _strip(
            *(heights, laid.shape[2], laid.shape[1] - 1, mine, best, own.shape[1], i),
            *(first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins),
        )
    return looked


def lay(heights, d) -> np.ndarray:
    """Return (rows, columns) heights, north up, as rays of a direction see them: (1, columns, rows + margin)."""
    return planes(d.lay(heights), 1, march.ABYSS)


def horizons(laid, d, curve: float = 0.0, reach: float | None = None, tally=None) -> np.ndarray:
    """Tangent of the horizon of every grid point.

    Parameters
    ----------
    laid : (1, columns, rows + margin) float32 array
        As `lay` returns it for this direction, or another that turns the grid alike.
    d, curve, reach, tally
        As `march.horizons` has them.

    Returns
    -------
    (columns, rows) float32 array
        Laid as the field is; −inf where nothing of it lies in the direction.
    """
    columns, rows = laid.shape[1], laid.shape[2] - march.BLOCK
    ahead = march.edges(d, columns - 1, reach)
    out = np.full(laid.shape[1:], -np.inf, np.float32)
    out[:, rows:] = np.inf
    if len(ahead[0]):
        looked = steepest(laid, way(laid.shape, stretches(laid, d), d, curve, *ahead), laid[0], out, rows)
        if tally is not None:
            tally.append(looked)
    return out[:, :rows]
