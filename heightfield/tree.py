"""The convex hull trees of sixteen lines (§4, §5): all local horizons by visiting what is seen, and little else.

Every stretch of a line that is convex starts a path of its tree; each path is the upper convex hull from there to the
root, which is the receiver. The root's children are then the ends of its sight lines. A new receiver becomes the root and
the tree is mended from the top. Of the children of the old root the nearest ones may be hidden by it now, and stay its own;
the others are the new root's. A child that is no longer convex with its own first child hands that child to the root.

Departures from the paper. Nodes are the samples themselves, and the leaf that §5 duplicates is a mark on its sample: it
stays when its last child has left, but not otherwise. A leaf whose outer neighbour is seen too ends no visible stretch, so
it is no local horizon: it is *open*. Every child of a root has a *target*, its first child or, if it has none, its outer
neighbour, and changes when receivers cross the line through both: all that a step asks of children that stay is on which
side it is. So their lines are kept as such, in slots that vector units go over (`lanes_tree.crossed`), and only where a
receiver may have crossed one does the tree follow pointers. The children's order is in the pointers, not in the slots.
"""

from __future__ import annotations

from collections import namedtuple

import numba as nb
import numpy as np

from .lanes import LANES, lowest_bit
from .lanes_tree import begin, classify, crossed, put

NONE = np.uint32(0xFFFFFFFF)
CHILD, FARTHER, NEARER, SLOT = range(4)  # of a node: first child, neighbours among its parent's children, place in `lines`
FIELDS = 4 * LANES  # of the nodes of a row
MARGIN = np.float32(1e-6)  # of a line, wider than its rounding
LEAST = np.float32(1e-30)  # of the same

# heights: flat rows of sixteen, two rows beyond the end; inverse: 1 / d; nodes: fields of every sample; starts: words of
# the samples that start a convex stretch. A slot holds one child of each lane's root: samples, lines (rows of heights at
# sample 0 and of slopes), words of where it is open and where it is used; free: lowest slot that may be free. Of each
# lane: last, top: the root's nearest child and its height; number, total: closed children and their distances.
# size: slots in use in any lane, children in all lanes, convexity checks.
Trees = namedtuple("Trees", "heights inverse nodes starts samples lines opened used free last top number total size")


@nb.njit(cache=True)
def _plant(heights):
    # Trees without a node
    rows = len(heights)
    inverse = np.empty(rows, np.float32)
    inverse[0] = 0
    for k in range(1, rows):
        inverse[k] = np.float32(1) / np.float32(k)
    return Trees(
        heights.reshape(-1),
        inverse,
        np.empty(rows * FIELDS, np.uint32),
        np.empty(rows, np.int64),
        np.empty(rows * LANES, np.uint32),
        np.empty(rows * 2 * LANES, np.float32),
        np.zeros(rows, np.int64),
        np.zeros(rows, np.int64),
        np.zeros(LANES, np.uint32),
        np.full(LANES, NONE),
        np.full(LANES, np.float32(np.inf)),
        np.zeros(LANES, np.int32),
        np.zeros(LANES, np.int64),
        np.zeros(3, np.int64),
    )


@nb.njit(cache=True, inline="always")
def _slot(w, lane, bit):
    # Take a free slot
    slot = w.free[lane]
    while w.used[slot] & bit:
        slot += np.uint32(1)
    w.free[lane] = slot + np.uint32(1)
    w.used[slot] |= bit
    w.size[0] = max(w.size[0], np.int64(slot) + 1)
    w.size[1] += 1
    return slot


@nb.njit(cache=True, inline="always")
def _settle(w, slot, lane, bit, c, target, is_open):
    # Put child c in a slot with the line through it and its target, moved by what rounding may make of it
    h = w.heights[c * LANES + lane]
    by = (w.heights[target * LANES + lane] - h) * w.inverse[target - c]
    far = by * np.float32(c)
    margin = MARGIN * (abs(far) + abs(h)) + LEAST
    if is_open:
        w.opened[slot] |= bit
    else:
        w.opened[slot] &= ~bit
        margin = -margin
    w.lines[slot * (2 * LANES) + lane] = h - far + margin
    w.lines[slot * (2 * LANES) + LANES + lane] = by
    w.samples[slot * LANES + lane] = c
    w.nodes[c * FIELDS + lane * 4 + SLOT] = slot


@nb.njit(cache=True, inline="always")
def _append(w, lane, bit, c, receiver):
    # Sample c, so far the old root's nearest child, stays in sight: the root's nearest child
    slot = _slot(w, lane, bit)
    q, end = c * FIELDS + lane * 4, w.last[lane]
    child = w.nodes[q + CHILD]
    _settle(w, slot, lane, bit, c, c + 1 if child == NONE else np.int64(child), False)
    w.nodes[q + FARTHER] = end
    if end != NONE:
        w.nodes[end * FIELDS + lane * 4 + NEARER] = c
    w.last[lane], w.top[lane] = c, w.heights[c * LANES + lane]
    w.number[lane] += 1
    w.total[lane] += c - receiver


@nb.njit(cache=True, inline="always")
def _leave(w, lane, bit, before, receiver):
    # The old root hides the root's nearest children: they, and the sample before if it says so, are its own
    here, old = np.float64(w.heights[receiver * LANES + lane]), receiver + 1
    s = np.float64(w.heights[old * LANES + lane]) - here
    c, first, low = w.last[lane], NONE, w.free[lane]
    q = c * FIELDS + lane * 4
    w.nodes[q + NEARER] = NONE
    if before:
        w.nodes[q + NEARER] = old + 1
        w.nodes[(old + 1) * FIELDS + lane * 4 + FARTHER] = c
    fewer, less, left = np.int32(0), 0, 0
    while c != NONE and not np.float64(w.heights[c * LANES + lane]) - here > s * np.float64(c - receiver):
        q = c * FIELDS + lane * 4
        slot = w.nodes[q + SLOT]
        w.used[slot] &= ~bit
        if not w.opened[slot] & bit:
            fewer += np.int32(1)
            less += c - receiver
        low = min(low, slot)
        first, c, left = c, w.nodes[q + FARTHER], left + 1
    w.nodes[old * FIELDS + lane * 4 + CHILD] = first
    w.free[lane], w.last[lane] = low, c
    w.top[lane] = np.float32(np.inf) if c == NONE else w.heights[c * LANES + lane]
    w.number[lane] -= fewer
    w.total[lane] -= less
    w.size[1] -= left
    w.size[2] += left


@nb.njit(cache=True, inline="always")
def _mend(w, slot, lane, bit, receiver):
    # Hand the root what can be seen over the child in a slot, over what that hands on, and so forth (Algorithm 1)
    here = np.float64(w.heights[receiver * LANES + lane])
    c, more, longer, checks = w.samples[slot * LANES + lane], np.int32(0), 0, 0
    stop = w.nodes[c * FIELDS + lane * 4 + FARTHER]
    if not w.opened[slot] & bit:
        more, longer = np.int32(-1), receiver - c
    while c != stop:
        q = c * FIELDS + lane * 4
        over, away = np.float64(w.heights[c * LANES + lane]) - here, np.float64(c - receiver)
        first = w.nodes[q + CHILD]
        child, last = first, first
        # Children are in order of slope from their parent: what is seen are the first ones
        while child != NONE:
            checks += 1
            if not (np.float64(w.heights[child * LANES + lane]) - here) * away > over * np.float64(child - receiver):
                break
            last, child = child, w.nodes[child * FIELDS + lane * 4 + NEARER]
        if child != first:
            # They come just before their parent
            farther = w.nodes[q + FARTHER]
            w.nodes[first * FIELDS + lane * 4 + FARTHER] = farther
            if farther != NONE:
                w.nodes[farther * FIELDS + lane * 4 + NEARER] = first
            w.nodes[q + CHILD] = child
            if child == NONE and not w.starts[c] & bit:
                # No hull goes through the parent any more
                if c == w.last[lane]:
                    w.last[lane], w.top[lane] = last, w.heights[last * LANES + lane]
                else:
                    nearer = w.nodes[q + NEARER]
                    w.nodes[last * FIELDS + lane * 4 + NEARER] = nearer
                    w.nodes[nearer * FIELDS + lane * 4 + FARTHER] = last
                c = last
                continue
            w.nodes[last * FIELDS + lane * 4 + NEARER] = c
            w.nodes[q + FARTHER] = last
        if slot == NONE:
            slot = _slot(w, lane, bit)
        target, is_open = np.int64(child), False
        if child == NONE:
            target = np.int64(c) + 1
            is_open = (np.float64(w.heights[target * LANES + lane]) - here) * away > over * (away + 1)
            checks += 1
        if not is_open:
            more, longer = more + np.int32(1), longer + (c - receiver)
        _settle(w, slot, lane, bit, c, target, is_open)
        slot, c = NONE, w.nodes[q + FARTHER]
    w.number[lane] += more
    w.total[lane] += longer
    w.size[2] += checks


@nb.njit(cache=True)
def _keep(w, seen, old_too, receiver, at, offsets, overs):
    # Write the horizons of a row before place `at`, nearest first; return the place of the first
    for lane in range(LANES - 1, -1, -1):
        if seen >> lane & 1:
            here = w.heights[receiver * LANES + lane]
            at -= w.number[lane] + (old_too >> lane & 1)
            n = at
            if old_too >> lane & 1:
                offsets[n], overs[n] = 1, w.heights[(receiver + 1) * LANES + lane] - here
                n += 1
            c = w.last[lane]
            while c != NONE:
                q = c * FIELDS + lane * 4
                if not w.opened[w.nodes[q + SLOT]] >> lane & 1:
                    offsets[n], overs[n] = c - receiver, w.heights[c * LANES + lane] - here
                    n += 1
                c = w.nodes[q + FARTHER]
    return at


@nb.njit(cache=True)
def search(heights, counts, totals, offsets, overs):
    """Find the horizons of every sample of a panel, from its far end to its start.

    Parameters
    ----------
    heights : (n + 2, LANES) float32 array
        As `lines.panel` lays them out, and two rows that are `NOWHERE`.
    counts, totals : (n, LANES) int32, int64 arrays
        Horizons of each sample and the sum of their distances in samples, written.
    offsets, overs : (m,) int32, float32 arrays
        As those of `intervisibility.search`, but at the arrays' end.

    Returns
    -------
    used : int
        Entries written, or -1 if there was no room.
    checks : int
        Convexity checks: the paper's iterations.
    """
    w, room = _plant(heights), len(offsets)
    near, convex, at = 0, 0, room
    for receiver in range(len(heights) - 3, -1, -1):
        old = receiver + 1
        on, rises, falls, hides = classify(heights, receiver, w.last, w.top)
        # A convex stretch starts at the old root if it is the first of the line, or follows a concave one (Eq. 1)
        w.starts[old] = falls & ~convex
        convex = falls | (convex & ~rises)
        # The sample before the old root, if it is a child, waits beside the slots: most often it is hidden at once
        hidden, stays = near & ~rises & on, near & rises
        hides &= ~stays
        begin(w.nodes, old, hidden)
        some = stays
        while some:
            lane = lowest_bit(np.uint32(some))
            some &= some - 1
            _append(w, lane, 1 << lane, old + 1, receiver)
        some = hides
        while some:
            lane = lowest_bit(np.uint32(some))
            some &= some - 1
            _leave(w, lane, 1 << lane, hidden >> lane & 1, receiver)
        hidden |= hides
        while w.size[0] > 0 and w.used[w.size[0] - 1] == 0:
            w.size[0] -= 1
        # Whether the old root hides the nearest child, and who of the others was passed
        w.size[2] += LANES + w.size[1]
        slot, some = crossed(w.lines, w.opened, w.used, 0, w.size[0], heights, receiver, on)
        while some:
            while some:
                lane = lowest_bit(np.uint32(some))
                some &= some - 1
                _mend(w, np.uint32(slot), lane, 1 << lane, receiver)
            slot, some = crossed(w.lines, w.opened, w.used, slot + 1, w.size[0], heights, receiver, on)
        # The old root is seen in any case, but ends no stretch if it is a leaf and the sample before is seen too
        old_too = on & (hidden | ~rises)
        if room:
            if at < w.size[1] + LANES:
                return -1, w.size[2]
            at = _keep(w, on, old_too, receiver, at, offsets, overs)
        put(w.number, w.total, old_too, counts, totals, receiver)
        near = on & (w.starts[old] | hidden)
    return room - at, w.size[2]
