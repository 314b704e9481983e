"""Local horizons of every point in one direction (§4), over lines that points share (`lines`).

Going outwards from a point, a sample of its line is seen when its slope from the point exceeds that of everything nearer;
of several on one sight line only the nearest is (the tie rule: a grazing sight line is cut where it touches). A local horizon
is the far end of a stretch of samples seen. Three ways find them, all with the same result, bit for bit:

- ``march`` looks at every sample (§1), sixteen lines at once.
- ``tree`` keeps the paper's convex hull tree a line (§5, `tree`), sixteen lines at once.
- ``blocks`` marches, but steps over stretches of samples whose highest points none of the sixteen receivers can see.

``auto`` takes the tree, and blocks where a reach is set, of which the tree knows nothing.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from . import tree
from .lanes import FAR_BELOW, LANES, look, lowest_bit, march, next_rise
from .lines import NOWHERE, first_line, lay, panel, points, span
from .sweep import packed

BLOCK = 16  # samples stepped over at once, at most the bits of a word
GROUP = 16  # blocks stepped over at once
SKIPPING, EVERY, EVERY_FLOAT32, TREE = range(4)
BUDGET = 24  # horizons a point for which room is made at first


@nb.njit(cache=True)
def _summits(heights, size):
    # Highest of every `size` rows, lane by lane
    out = np.full(((len(heights) + size - 1) // size, LANES), NOWHERE)
    for k in range(len(heights)):
        top = out[k // size]
        for lane in range(LANES):
            top[lane] = max(top[lane], heights[k, lane])
    return out


@nb.njit(cache=True)
def _ends(count, starts, words, receiver, heights, at, counts, totals, offsets, overs):
    """Turn the words of sixteen receivers into their horizons, nearest first; return the place after the last."""
    n, keep, rows = at, len(offsets) > 0, len(heights)
    for lane in range(LANES):
        before, total, end, here = n, 0, -1, heights[receiver, lane]
        for q in range(count):
            v, first = words[q, lane], starts[q]
            # A stretch that reached the end of the word before goes on here, or ended there
            if end >= 0 and not (end + 1 == first and v & np.uint32(1)):
                if keep:
                    offsets[n], overs[n] = end - receiver, heights[end, lane] - here
                n, total, end = n + 1, total + end - receiver, -1
            if v:
                end = -1
                ends = v & ~(v >> np.uint32(1))
                size = min(BLOCK - first % BLOCK, rows - first)
                if v >> np.uint32(size - 1):
                    end = first + size - 1
                    ends ^= np.uint32(1) << np.uint32(size - 1)
                while ends:
                    t = first + lowest_bit(ends)
                    ends &= ends - np.uint32(1)
                    if keep:
                        offsets[n], overs[n] = t - receiver, heights[t, lane] - here
                    n, total = n + 1, total + t - receiver
        if end >= 0:
            if keep:
                offsets[n], overs[n] = end - receiver, heights[end, lane] - here
            n, total = n + 1, total + end - receiver
        counts[receiver, lane], totals[receiver, lane] = n - before, total
    return n


@nb.njit(cache=True)
def search(heights, reach, how, room, counts, totals, offsets, overs):
    """Find the horizons of every sample of a panel.

    Parameters
    ----------
    heights : (n, LANES) float32 array
        As `lines.panel` lays them out.
    reach : int
        Samples to look at.
    how : int
        `SKIPPING`, `EVERY` or `EVERY_FLOAT32` (the fastest naive method, without exact ties: a baseline).
    room : int
        Entries of `offsets` after which to give up.
    counts, totals : (n, LANES) int32, int64 arrays
        Horizons of each sample and the sum of their distances in samples, written.
    offsets, overs : (m,) int32, float32 arrays
        Distance in samples and height above the receiver of all horizons: sample by sample, lane by lane, nearest first.
        Both may be empty: nothing is written then.

    Returns
    -------
    used : int
        Entries written, or -1 if there was no room.
    looked : int
        Samples looked at by all lanes together, and stretches tested.
    """
    n = len(heights)
    summits = _summits(heights, BLOCK)
    higher = _summits(summits, GROUP)
    words, starts = np.empty((len(summits) + 1, LANES), np.uint32), np.empty(len(summits) + 1, np.int64)
    here, least = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    rise, run = np.empty(LANES), np.ones(LANES)
    inverse = np.empty(n + 1, np.float32)
    inverse[0] = 0
    for k in range(1, n + 1):
        inverse[k] = np.float32(1) / np.float32(k)
    used, looked = 0, 0
    for receiver in range(n):
        for lane in range(LANES):
            known = heights[receiver, lane] != NOWHERE
            here[lane] = heights[receiver, lane] if known else np.float32(0)
            # A receiver beyond the border sees nothing
            rise[lane] = FAR_BELOW if known else -FAR_BELOW
            run[lane] = 1
            least[lane] = np.float32(-3e38) if known else np.float32(3e38)
        last = min(n, receiver + 1 + reach)
        blocks, groups = (last + BLOCK - 1) // BLOCK, (last + BLOCK * GROUP - 1) // (BLOCK * GROUP)
        q, k = 0, receiver + 1
        while k < last:
            b = k // BLOCK
            if how == SKIPPING and k == b * BLOCK:
                # Step over whole groups of blocks, then over blocks
                if b % GROUP == 0:
                    g = next_rise(higher, b // GROUP, groups, BLOCK * GROUP, n, here, least, inverse, receiver)
                    looked += LANES * (g + 1 - b // GROUP)
                    if g == groups:
                        break
                    b = g * GROUP
                stop = min((b // GROUP + 1) * GROUP, blocks)
                c = next_rise(summits, b, stop, BLOCK, n, here, least, inverse, receiver)
                looked += LANES * (c + 1 - b)
                k = c * BLOCK
                if c == stop:
                    continue
                b = c
            stop = min((b + 1) * BLOCK, last)
            looked += (stop - k) * LANES
            if how == EVERY_FLOAT32:
                some = march(heights, k, stop, here, least, words, q, inverse, receiver)
            else:
                some = look(heights, k, stop, here, rise, run, least, words, q, receiver)
            if some:
                starts[q] = k
                q += 1
            k = stop
        if used > room:
            return -1, looked
        after = _ends(q, starts, words, receiver, heights, used, counts, totals, offsets, overs)
        if len(offsets):
            used = after
    return used, looked


@nb.njit(cache=True, parallel=True)
def _panels(laid, slope, first, bend, reach, how, budget, counts, totals):
    """Search all lines, a panel a thread; fill ``counts`` and ``totals`` (laid as the field is), return what was found.

    ``budget`` is the room to make a point, 0 to count only. Returns the horizons' offsets and overs panel by panel, where
    each panel's end, and how much was looked at; ends of -1 mean that room ran out.
    """
    columns, rows = counts.shape
    panels = (rows - first + LANES - 1) // LANES
    # One sample's worth to spare: room is checked once a sample
    spare = LANES * columns
    room = spare * (budget + 1) if budget else 0
    limit = room - spare if budget else 1
    offsets, overs = np.empty((panels, room), np.int32), np.empty((panels, room), np.float32)
    begins, used, looked = np.zeros(panels, np.int64), np.zeros(panels, np.int64), np.zeros(panels, np.int64)
    for p in nb.prange(panels):
        line = first + LANES * p
        a, b = span(line, LANES, slope, rows, columns)
        if b > a:
            sheet = np.empty((b - a + 2, LANES), np.float32)
            panel(laid, line, slope, a, b, bend, sheet)
            c, t = np.empty((b - a, LANES), np.int32), np.empty((b - a, LANES), np.int64)
            if how == TREE:
                sheet[b - a :] = NOWHERE
                used[p], looked[p] = tree.search(sheet, c, t, offsets[p], overs[p])
                begins[p] = room - used[p]
            else:
                used[p], looked[p] = search(sheet[: b - a], reach, how, limit, c, t, offsets[p], overs[p])
            if used[p] >= 0:
                for x in range(a, b):
                    i, lo, hi = points(line, slope, x, rows)
                    if hi > lo:
                        counts[x, i + lo : i + hi], totals[x, i + lo : i + hi] = c[x - a, lo:hi], t[x - a, lo:hi]
    return offsets, overs, begins, used, looked


@nb.njit(cache=True, parallel=True)
def _deliver(order, slope, first, step, curve, counts, starts, offsets, overs, begins, distances, angles):
    # Move every panel's horizons to their points' places, as metres and radians
    (columns, rows), (origin, down, along) = counts.shape, order
    for p in nb.prange(len(offsets)):
        line = first + LANES * p
        a, b = span(line, LANES, slope, rows, columns)
        n = begins[p]
        for x in range(a, b):
            begin, lo, hi = points(line, slope, x, rows)
            for i in range(begin + lo, begin + hi):
                at = starts[origin + i * down + x * along]
                for _ in range(counts[x, i]):
                    k = offsets[p, n]
                    d = k * step
                    # The panel is bent from its first column; seen from the point, the surface falls by the square
                    bent = overs[p, n] + curve * step * step * (2.0 * (x - a) + k) * k
                    distances[at] = d
                    angles[at] = np.arctan(bent / d - curve * d)
                    at, n = at + 1, n + 1


def local_horizons(d, heights, curve: float = 0.0, reach: int | None = None, method: str = "auto"):
    """Find the local horizons of every grid point.

    Parameters
    ----------
    d : sweep.Direction
    heights : (rows, columns) float32 array
        North up, centred.
    curve : float
        A point at distance ``x`` metres lies ``curve · x²`` lower.
    reach : int, optional
        Columns of the turned grid to look at.
    method : {"auto", "tree", "march"}
        The tree knows no `reach`: it gives way to blocks where one is set.

    Returns
    -------
    offsets : (rows · columns + 1,) int64 array
        Point ``i``'s horizons are entries ``offsets[i]`` to ``offsets[i + 1]``, nearest first.
    distances, angles : (m,) float32 arrays
        Horizontal metres; radians above the horizontal.
    looked : int
        Samples looked at and tests of stretches, or convexity checks of the tree.
    naive : int
        Samples that the naive method looks at.
    """
    laid = lay(heights, d)
    shape = d.turn(heights).shape
    first = first_line(d.slope, shape[1])
    if method == "march":
        how = EVERY
    elif reach is not None:
        how = SKIPPING
    else:
        how = TREE
    counts, sums = (np.zeros(shape[::-1], dtype=t) for t in (np.int32, np.int64))
    far, bend, budget = shape[1] if reach is None else reach, curve * d.step**2, BUDGET
    while True:
        found = _panels(laid, d.slope, first, bend, far, how, budget, counts, sums)
        if found[3].min() >= 0:
            break
        budget *= 2
    starts = np.zeros(heights.size + 1, dtype=np.int64)
    np.cumsum(packed(d.lift(counts)).ravel(), out=starts[1:])
    distances, angles = (np.empty(starts[-1], dtype=np.float32) for _ in range(2))
    _deliver(_order(d, heights.shape), d.slope, first, d.step, curve, counts, starts, *found[:3], distances, angles)
    return starts, distances, angles, int(found[4].sum()), _naive(shape, d.slope, far)


def totals(d, heights, curve: float = 0.0, how: int | None = None):
    """Use the horizons in place and keep none: their number and the sum of their distances (in samples) at every point.

    Parameters
    ----------
    d, heights, curve
        As for `local_horizons`.
    how : int
        `SKIPPING`, `EVERY`, `EVERY_FLOAT32` or `TREE`; as ``auto`` chooses by default.

    Returns
    -------
    counts : (rows · columns,) int32 array
    totals : (rows · columns,) int64 array
    looked : int
    """
    laid = lay(heights, d)
    first = first_line(d.slope, len(laid))
    how = TREE if how is None else how
    counts, sums = (np.zeros(d.lay(heights).shape, dtype=t) for t in (np.int32, np.int64))
    found = _panels(laid, d.slope, first, curve * d.step**2, len(laid), how, 0, counts, sums)
    return *(packed(d.lift(v)).ravel() for v in (counts, sums)), int(found[4].sum())


def _naive(shape, slope, reach):
    # Samples beyond each point on its line, all together
    rows, columns = shape
    m, total = np.arange(first_line(slope, columns), rows), 0
    ahead = np.zeros(len(m), dtype=np.int64)
    for x in range(columns - 1, -1, -1):
        i = np.floor(m + slope * x + 0.5)
        on = (i >= 0) & (i < rows)
        total += int(np.minimum(ahead[on], reach).sum())
        ahead[on] += 1
    return total


def _order(d, shape):
    # Where the first point of the turned grid lies in the flat grid, north up, and how far its rows and columns lie apart
    sizes, steps = list(shape), [shape[1], 1]
    if d.transpose:
        sizes, steps = sizes[::-1], steps[::-1]
    flips = d.flip_rows, d.flip_columns
    origin = sum((size - 1) * step for size, step, flip in zip(sizes, steps, flips, strict=True) if flip)
    return origin, *(-step if flip else step for step, flip in zip(steps, flips, strict=True))
