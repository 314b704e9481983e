"""Local horizons of every point in one direction (§4), over lines that points share (`lines`).

Going outwards from a point, a sample of its line is seen when its slope from the point exceeds that of everything nearer;
of several on one sight line only the nearest is (the tie rule: a grazing sight line is cut where it touches). A local horizon
is the far end of a stretch of samples seen. Three ways find them, all with the same result, bit for bit:

- ``march`` looks at every sample (§1), sixteen lines at once.
- ``tree`` keeps the paper's convex hull tree a line (§5, `tree`), sixteen lines at once.
- ``blocks`` marches, but steps over stretches of samples whose highest points none of the sixteen receivers can see.

``auto`` takes the tree, and blocks where a reach is set, of which the tree knows nothing, or a line is longer than it counts.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from . import tree
from .lanes import FAR_BELOW, LANES, look, lowest_bit, march, next_rise
from .lines import NOWHERE, first_line, lay, panel, points, span
from .march import NEARBY
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
    counts, totals : (n, LANES) int32 arrays
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
    summits = _summits(heights[: n if how == SKIPPING else 0], BLOCK)
    higher = _summits(summits, GROUP)
    size = (n + BLOCK - 1) // BLOCK + 1
    words, starts = np.empty((size, LANES), np.uint32), np.empty(size, np.int64)
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
def at_points(values, slope, first, out):
    """Spread values of samples, (panels, columns, LANES), over the grid points that they stand for, (rows, columns)."""
    rows = len(out)
    for p in nb.prange(len(values)):
        line = first + LANES * p
        a, b = span(line, LANES, slope, rows, out.shape[1])
        for x in range(a, b):
            i, lo, hi = points(line, slope, x, rows)
            for lane in range(lo, hi):
                out[i + lane, x] = values[p, x, lane]


@nb.njit(cache=True, parallel=True)
def _panels(laid, slope, first, bend, reach, how, budget, threads, counts, totals):
    """Search all lines, each thread a share of the panels; fill ``counts`` and ``totals``, (panels, columns, LANES).

    ``budget`` is the room to make a sample, 0 to count only. Returns the horizons' offsets and overs panel by panel, where
    each panel's begin, how many there are, and how much was looked at; -1 of them mean that room ran out.
    """
    columns, rows, panels = laid.shape[0], laid.shape[1] - 2, len(counts)
    # One sample's worth to spare: room is checked once a sample
    spare = LANES * columns
    room = spare * (budget + 1) if budget else 0
    limit = room - spare if budget else 1
    offsets, overs = np.empty((panels, room), np.int32), np.empty((panels, room), np.float32)
    begins, used, looked = np.zeros(panels, np.int64), np.zeros(panels, np.int64), np.zeros(panels, np.int64)
    for thread in nb.prange(threads):
        # Every thread keeps its space
        sheets = np.empty((columns + 3, LANES), np.float32)
        space = tree.work(columns if how == TREE else 0)
        for p in range(thread, panels, threads):
            line = first + LANES * p
            a, b = span(line, LANES, slope, rows, columns)
            if b <= a:
                continue
            sheet, c, t = sheets[: b - a + 3], counts[p, a:b], totals[p, a:b]
            panel(laid, line, slope, a, b, bend, sheet)
            if how == TREE:
                sheet[b - a :], sheet[b - a + 2] = NOWHERE, -NOWHERE
                found = tree.search(sheet, space, c, t, offsets[p], overs[p])
                begins[p] = room - found[0]
            else:
                found = search(sheet[: b - a], reach, how, limit, c, t, offsets[p], overs[p])
            used[p], looked[p] = found
    return offsets, overs, begins, used, looked


@nb.njit(cache=True, parallel=True)
def _deliver(order, slope, first, step, curve, counts, starts, offsets, overs, begins, distances, angles):
    # Move every panel's horizons to their points' places, as metres and radians
    (rows, columns), (origin, down, along) = counts.shape, order
    for p in nb.prange(len(offsets)):
        line = first + LANES * p
        a, b = span(line, LANES, slope, rows, columns)
        n = begins[p]
        for x in range(a, b):
            begin, lo, hi = points(line, slope, x, rows)
            for i in range(begin + lo, begin + hi):
                at = starts[origin + i * down + x * along]
                for _ in range(counts[i, x]):
                    k = offsets[p, n]
                    d = k * step
                    # The panel is bent from its first column; seen from the point, the surface falls by the square
                    bent = overs[p, n] + curve * step * step * (2.0 * (x - a) + k) * k
                    distances[at] = d
                    angles[at] = np.arctan(bent / d - curve * d)
                    at, n = at + 1, n + 1


def local_horizons(d, heights, curve: float = 0.0, reach: float | None = None, method: str = "auto"):
    """Find the local horizons of every grid point.

    Parameters
    ----------
    d : sweep.Direction
    heights : (rows, columns) float32 array
        North up, centred.
    curve : float
        A point at distance ``x`` metres lies ``curve · x²`` lower.
    reach : float, optional
        Columns of the turned grid to look.
    method : {"auto", "tree", "march"}
        The tree knows no `reach`: it gives way to blocks where one is set, or a line has more than `tree.MOST` samples.

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
    how = EVERY if method == "march" else _best(shape[1], reach)
    counts, sums = _room(*shape, first)
    far = shape[1] if reach is None else int(min(reach + NEARBY, shape[1]))
    bend, budget = curve * d.step**2, BUDGET
    while True:
        found = _panels(laid, d.slope, first, bend, far, how, budget, nb.get_num_threads(), counts, sums)
        if found[3].min() >= 0:
            break
        budget *= 2
    starts, each = np.zeros(heights.size + 1, dtype=np.int64), np.empty(shape, np.int32)
    at_points(counts, d.slope, first, each)
    np.cumsum(packed(d.back(each)).ravel(), out=starts[1:])
    distances, angles = (np.empty(starts[-1], dtype=np.float32) for _ in range(2))
    _deliver(_order(d, heights.shape), d.slope, first, d.step, curve, each, starts, *found[:3], distances, angles)
    return starts, distances, angles, int(found[4].sum()), _naive(shape, d.slope, far)


def totals(d, heights, curve: float = 0.0, how: int | None = None):
    """Use the horizons in place and keep none: of every sample, their number and the sum of their distances in samples.

    Parameters
    ----------
    d, heights, curve
        As for `local_horizons`.
    how : int
        `SKIPPING`, `EVERY`, `EVERY_FLOAT32` or `TREE`; as ``auto`` chooses by default.

    Returns
    -------
    counts, totals : (panels, columns, LANES) int32 arrays
        By the lines that points share, for `at_points`; the totals of fields of up to 65,535 samples a side.
    looked : int
    """
    laid, shape = lay(heights, d), d.turn(heights).shape
    first = first_line(d.slope, shape[1])
    counts, sums = _room(*shape, first)
    how = _best(shape[1], None) if how is None else how
    found = _panels(laid, d.slope, first, curve * d.step**2, shape[1], how, 0, nb.get_num_threads(), counts, sums)
    return counts, sums, int(found[4].sum())


def _best(columns, reach):
    return TREE if reach is None and columns <= tree.MOST else SKIPPING


def _room(rows, columns, first):
    # For the counts and totals of all lines
    panels = (rows - first + LANES - 1) // LANES
    return np.empty((panels, columns, LANES), np.int32), np.empty((panels, columns, LANES), np.int32)


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
