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

CHILD, FARTHER, NEARER, SLOT = (np.uint64(k) for k in range(4))  # of a node: first child, neighbours, place in `lines`
FIELDS = 4 * LANES  # of the nodes of a row
MOST = (1 << 16) - 3  # samples of a line: nodes are pairs of bytes
MARGIN = 4e-7  # of a line, wider than its rounding
LEAST = 1e-30  # of the same

# The trees of sixteen lines, in flat rows of sixteen. Of samples: their heights, nodes, and whether a path starts there
# (fresh, a bit a lane). Of slots: the child of the root that each holds, its line (two rows), whether it is open, and whether
# it is used. Of lanes: the lowest slot that may be free; the root's nearest child and its height; how many children are
# closed, and the sum of their distances. And inverse distances
Trees = namedtuple("Trees", "heights nodes fresh children lines opened used hint last top number total inverse")


@nb.njit(cache=True, inline="always")
def _spot(row, lane):
    # Of a sample or slot. Unsigned: numba asks of others whether they count from the end
    return np.uint64(row * LANES + lane)


@nb.njit(cache=True, inline="always")
def _node(row, lane):
    return np.uint64(row * FIELDS + lane * 4)


@nb.njit(cache=True, inline="always")
def _height(t, row, lane):
    return np.float64(t.heights[_spot(row, lane)])


@nb.njit(cache=True, inline="always")
def _take(t, lane):
    # The lowest free slot
    slot = t.hint[lane]
    while t.used[np.uint64(slot)] >> lane & 1:
        slot += 1
    t.hint[lane] = slot + 1
    t.used[np.uint64(slot)] |= 1 << lane
    return slot


@nb.njit(cache=True, inline="always")
def _draw(t, slot, lane, c, target, is_open):
    # Put child c and the line through it and its target in a slot, the line moved by what rounding may make of it
    h, ht = _height(t, c, lane), _height(t, target, lane)
    at, by = np.inf, 0.0
    if ht != -np.inf:
        by = (ht - h) * t.inverse[np.uint64(target - c)]
        far = by * c
        margin = MARGIN * (abs(far) + abs(h)) + LEAST
        at = h - far + (margin if is_open else -margin)
    t.lines[_spot(2 * slot, lane)], t.lines[_spot(2 * slot + 1, lane)] = at, by
    t.children[_spot(slot, lane)] = c
    t.nodes[_node(c, lane) + SLOT] = slot
    k = np.uint64(slot)
    t.opened[k] = (t.opened[k] & ~(1 << lane)) | (np.int64(is_open) << lane)


@nb.njit(cache=True, inline="always")
def _add(t, p, lane, none):
    # Make p the nearest child of the root; return its slot
    q = _node(p, lane)
    g = np.int64(t.nodes[q + CHILD])
    slot = _take(t, lane)
    _draw(t, slot, lane, p, p + 1 if g == none else g, False)
    c = np.int64(t.last[lane])
    t.nodes[q + FARTHER] = c
    t.nodes[_node(c, lane) + NEARER] = p
    t.last[lane], t.top[lane] = p, t.heights[_spot(p, lane)]
    t.number[lane] += np.int32(1)
    t.total[lane] += np.int32(2)
    return slot


@nb.njit(cache=True, inline="always")
def _hide(t, r, lane, after, none):
    # Leave the nearest children, hidden behind sample r + 1, to it, after its child r + 2 if it has that; return how many
    old, here = r + 1, _height(t, r, lane)
    s = _height(t, old, lane) - here
    c = first = np.int64(t.last[lane])
    if after:
        t.nodes[_node(c, lane) + NEARER] = old + 1
        t.nodes[_node(old + 1, lane) + FARTHER] = c
    hidden, number, total, low = 0, 0, 0, t.hint[lane]
    while not _height(t, c, lane) - here > s * np.float64(c - r):
        q = _node(c, lane)
        slot = np.int64(t.nodes[q + SLOT])
        k = np.uint64(slot)
        closed = 1 - (t.opened[k] >> lane & 1)
        t.used[k] &= ~(1 << lane)
        low = min(low, slot)
        number += closed
        total += closed * (c - r)
        hidden += 1
        first, c = c, np.int64(t.nodes[q + FARTHER])
    t.hint[lane] = low
    t.number[lane] -= np.int32(number)
    t.total[lane] -= np.int32(total)
    t.nodes[_node(old, lane) + CHILD] = first
    t.nodes[_node(c, lane) + NEARER] = none
    t.last[lane], t.top[lane] = c, t.heights[_spot(c, lane)]
    return hidden


@nb.njit(cache=True, inline="always")
def _hide_all(t, r, todo, after, none):
    fewer = 0
    while todo:
        lane = lowest_bit(np.uint32(todo))
        todo &= todo - 1
        fewer += _hide(t, r, lane, after, none)
    return fewer


@nb.njit(cache=True, inline="always")
def _mend(t, r, slot, lane, none):
    # Hand on the children of a slot's child that it hides no longer, and theirs; return the new children less the old, the
    # highest slot of a new one, and the checks made but for the first
    bit, here = 1 << lane, _height(t, r, lane)
    c = np.int64(t.children[_spot(slot, lane)])
    far = np.int64(t.nodes[_node(c, lane) + FARTHER])
    number = (t.opened[np.uint64(slot)] >> lane & 1) - 1
    total = number * (c - r)
    more, high, checks = 0, -1, -1
    while c != far:
        q = _node(c, lane)
        h, d = _height(t, c, lane) - here, np.float64(c - r)
        g = np.int64(t.nodes[q + CHILD])
        x = b = g
        checks += 1
        while (_height(t, x, lane) - here) * d > h * np.float64(x - r):
            b, x = x, np.int64(t.nodes[_node(x, lane) + NEARER])
            checks += 1
        if x != g:
            # Children g to b come before c
            before = np.int64(t.nodes[q + FARTHER])
            t.nodes[_node(g, lane) + FARTHER] = before
            t.nodes[_node(before, lane) + NEARER] = g
            t.nodes[q + CHILD] = x
            if x == none and not t.fresh[np.uint64(c)] & bit:
                # In place of c, if it starts no path
                after = np.int64(t.nodes[q + NEARER])
                t.nodes[_node(b, lane) + NEARER] = after
                t.nodes[_node(after, lane) + FARTHER] = b
                if c == t.last[lane]:
                    t.last[lane], t.top[lane] = b, t.heights[_spot(b, lane)]
                c = b
                continue
            t.nodes[_node(b, lane) + NEARER] = c
            t.nodes[q + FARTHER] = b
        if slot < 0:
            slot = _take(t, lane)
            high = max(high, slot)
            more += 1
        alone = x == none
        target = c + 1 if alone else x
        is_open = alone & ((_height(t, target, lane) - here) * d > h * (d + 1.0))
        _draw(t, slot, lane, c, target, is_open)
        number += 1 - np.int64(is_open)
        total += (1 - np.int64(is_open)) * (c - r)
        slot, c = -1, np.int64(t.nodes[q + FARTHER])
    if slot >= 0:
        t.used[np.uint64(slot)] &= ~bit
        t.hint[lane] = min(t.hint[lane], slot)
        more -= 1
    t.number[lane] += np.int32(number)
    t.total[lane] += np.int32(total)
    return more, high, checks


@nb.njit(cache=True)
def _keep(t, receiver, seen, old_too, end, at, offsets, overs):
    # Write the horizons of a row before place `at`, nearest first; return the place of the first
    for lane in range(LANES - 1, -1, -1):
        if seen >> lane & 1:
            here = t.heights[_spot(receiver, lane)]
            at -= t.number[lane] + (old_too >> lane & 1)
            n = at
            if old_too >> lane & 1:
                offsets[n], overs[n] = 1, t.heights[_spot(receiver + 1, lane)] - here
                n += 1
            c = np.int64(t.last[lane])
            while c != end:
                q = _node(c, lane)
                if not t.opened[t.nodes[q + SLOT]] >> lane & 1:
                    offsets[n], overs[n] = c - receiver, t.heights[_spot(c, lane)] - here
                    n += 1
                c = np.int64(t.nodes[q + FARTHER])
    return at


@nb.njit(cache=True)
def work(columns):
    """Make the work space of `search` for panels of up to so many samples."""
    n = columns + 3
    nodes, children = np.empty(n * FIELDS, np.uint16), np.empty(n * LANES, np.uint16)
    lines, sets, marked = np.empty(2 * n * LANES, np.float32), np.empty((3, n), np.int64), np.empty(n, np.int64)
    return nodes, children, lines, sets, marked, 1 / np.maximum(np.arange(n), 1)


@nb.njit(cache=True, error_model="numpy")
def search(heights, space, counts, totals, offsets, overs):
    """Find the horizons of every sample of a panel, from its far end to its start.

    Parameters
    ----------
    heights : (n + 3, LANES) float32 array
        As `lines.panel` lays them out, then two rows that are `NOWHERE` and one that is infinite.
    space : tuple of arrays
        As `work` makes them.
    counts, totals : (n, LANES) int32 arrays
        Horizons of each sample and the sum of their distances in samples, written.
    offsets, overs : (m,) int32, float32 arrays
        As those of `intervisibility.search`, but at the arrays' end.

    Returns
    -------
    used : int
        Entries written, or -1 if there was no room.
    checks : int
        Convexity checks, the paper's iterations: in every step one of each child of the root and one of the old root, and
        one of each child that is hidden, handed on, or new to the root.
    """
    n = len(heights) - 3
    # Chains of children end in samples that no test passes: towards the root in one below all, away from it in one above
    none, end = n + 1, n + 2
    nodes, children, lines, sets, marked, inverse = space
    sets[:] = 0
    fresh, opened, used = sets[0], sets[1], sets[2]
    last, top = np.full(LANES, np.int32(end)), np.full(LANES, np.float32(np.inf))
    number, total = np.zeros(LANES, np.int32), np.zeros(LANES, np.int32)
    hint, flat = np.zeros(LANES, np.int64), heights.reshape(-1)
    t = Trees(flat, nodes, fresh, children, lines, opened, used, hint, last, top, number, total, inverse)
    at = room = len(offsets)
    near = convex = levels = checks = elements = 0
    for r in range(n - 1, -1, -1):
        old = r + 1
        on, above, below, hides = classify(heights, r, last, top)
        starts = below & ~convex
        convex = below | (convex & ~above)
        fresh[old] = starts
        hidden, stays = near & ~above & on, near & above & on
        hides &= ~stays
        begin(nodes, old, hidden, none)
        todo = stays
        while todo:
            lane = lowest_bit(np.uint32(todo))
            todo &= todo - 1
            levels = max(levels, 1 + _add(t, old + 1, lane, none))
            elements += 1
        # Told apart beforehand: which it is no branch predicts
        fewer = _hide_all(t, r, hides & hidden, True, none) + _hide_all(t, r, hides & ~hidden, False, none)
        elements -= fewer
        checks += fewer
        hidden |= hides
        while levels > 0 and used[np.uint64(levels - 1)] == 0:
            levels -= 1
        checks += elements + LANES

        # Children whose line a receiver has crossed may have to hand on theirs
        found = crossed(lines, opened, used, levels, heights, r, on, marked)
        for k in range(found):
            word = marked[np.uint64(k)]
            todo = word & 0xFFFF
            while todo:
                lane = lowest_bit(np.uint32(todo))
                todo &= todo - 1
                more, high, looked = _mend(t, r, word >> LANES, lane, none)
                elements += more
                levels = max(levels, high + 1)
                checks += looked
        too = on & (hidden | ~above)
        if room:
            if at < elements + LANES:
                return -1, checks
            at = _keep(t, r, on, too, end, at, offsets, overs)
        put(number, total, too, counts, totals, r)
        near = (starts | hidden) & on
    return room - at, checks
