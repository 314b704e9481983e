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

import numba as nb
import numpy as np

from .lanes import LANES, lowest_bit
from .lanes_tree import begin, classify, crossed, put

NONE = np.int32(-1)
CHILD, FARTHER, NEARER, SLOT = range(4)  # of a node: first child, neighbours among its parent's children, place in `lines`
FIELDS = 4 * LANES  # of the nodes of a row
MARGIN = 4e-7  # of a line, wider than its rounding
LEAST = 1e-30  # of the same


@nb.njit(cache=True, inline="always")
def _draw(slot, lane, c, target, is_open, flat, lines):
    # Put the line through child c and its target in a slot, moved by what rounding may make of it
    h, ht = np.float64(flat[c * LANES + lane]), np.float64(flat[target * LANES + lane])
    at, by = np.inf, 0.0
    if ht != -np.inf:
        by = (ht - h) / np.float64(target - c)
        far = by * c
        margin = MARGIN * (abs(far) + abs(h)) + LEAST
        at = h - far + (margin if is_open else -margin)
    lines[slot * 2 * LANES + lane], lines[(slot * 2 + 1) * LANES + lane] = at, by


@nb.njit(cache=True)
def _keep(flat, nodes, opened, last, number, seen, old_too, receiver, at, offsets, overs):
    # Write the horizons of a row before place `at`, nearest first; return the place of the first
    for lane in range(LANES - 1, -1, -1):
        if seen >> lane & 1:
            here = flat[receiver * LANES + lane]
            at -= number[lane] + (old_too >> lane & 1)
            n = at
            if old_too >> lane & 1:
                offsets[n], overs[n] = 1, flat[(receiver + 1) * LANES + lane] - here
                n += 1
            c = last[lane]
            while c != NONE:
                q = c * FIELDS + lane * 4
                if not opened[nodes[q + SLOT]] >> lane & 1:
                    offsets[n], overs[n] = c - receiver, flat[c * LANES + lane] - here
                    n += 1
                c = nodes[q + FARTHER]
    return at


@nb.njit(cache=True)
def work(columns):
    """Make the work space of `search` for panels of up to so many samples: nodes, children and lines of slots, three sets."""
    n = columns + 2
    sets = np.empty((3, n), np.int64)
    return np.empty(n * FIELDS, np.int32), np.empty(n * LANES, np.int32), np.empty(n * 2 * LANES, np.float32), sets


@nb.njit(cache=True, error_model="numpy")
def search(heights, nodes, C, lines, sets, counts, totals, offsets, overs):
    """Find the horizons of every sample of a panel, from its far end to its start.

    Parameters
    ----------
    heights : (n + 2, LANES) float32 array
        As `lines.panel` lays them out, and two rows that are `NOWHERE`.
    nodes, C, lines, sets : arrays
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
    n = len(heights) - 2
    # Flat rows of sixteen. A slot holds a child C of each lane's root, its line, and whether it is open; hint: lowest slot
    # that may be free. Of each lane: last, toph: nearest child and its height; number, total: closed children, distances
    flat = heights.reshape(-1)
    sets[:] = 0
    fresh, opened, used = sets[0], sets[1], sets[2]
    hint = np.zeros(LANES, np.int64)
    last = np.full(LANES, NONE)
    toph = np.full(LANES, np.float32(np.inf))
    number = np.zeros(LANES, np.int32)
    total = np.zeros(LANES, np.int32)
    room = len(offsets)
    at = room
    near = 0
    convex = 0
    levels = 0
    checks = 0
    elems = 0
    for r in range(n - 1, -1, -1):
        old = r + 1
        p = r + 2
        on, gt, lt, hid = classify(heights, r, last, toph)
        starts = lt & ~convex
        convex = lt | (convex & ~gt)
        fresh[old] = starts
        hidden = near & ~gt & on
        stays = near & gt & on
        hid &= ~stays
        begin(nodes, old, hidden)
        todo = hid | stays
        while todo:
            lane = lowest_bit(np.uint32(todo))
            todo &= todo - 1
            bit = 1 << lane
            end = last[lane]
            if stays & bit:
                e = hint[lane]
                while used[e] & bit:
                    e += 1
                hint[lane] = e + 1
                if e >= levels:
                    levels = e + 1
                q = p * FIELDS + lane * 4
                g = nodes[q + CHILD]
                _draw(e, lane, p, p + 1 if g == NONE else g, False, flat, lines)
                C[e * LANES + lane] = p
                used[e] |= bit
                opened[e] &= ~bit
                nodes[q + SLOT] = e
                nodes[q + FARTHER] = end
                if end != NONE:
                    nodes[end * FIELDS + lane * 4 + NEARER] = p
                end = np.int32(p)
                number[lane] += 1
                total[lane] += np.int32(2)
                elems += 1
            else:
                hr = np.float64(flat[r * LANES + lane])
                s = np.float64(flat[old * LANES + lane]) - hr
                c = end
                f = c
                if hidden & bit:
                    nodes[c * FIELDS + lane * 4 + NEARER] = p
                    nodes[p * FIELDS + lane * 4 + FARTHER] = c
                else:
                    nodes[c * FIELDS + lane * 4 + NEARER] = NONE
                low = hint[lane]
                nn = np.int32(0)
                tt = 0
                while c != NONE and not (np.float64(flat[c * LANES + lane]) - hr > s * np.float64(c - r)):
                    e = nodes[c * FIELDS + lane * 4 + SLOT]
                    used[e] &= ~bit
                    if not opened[e] & bit:
                        nn += np.int32(1)
                        tt += c - r
                    low = min(low, e)
                    f = c
                    c = nodes[c * FIELDS + lane * 4 + FARTHER]
                    elems -= 1
                    checks += 1
                hint[lane] = low
                number[lane] -= nn
                total[lane] -= np.int32(tt)
                nodes[old * FIELDS + lane * 4 + CHILD] = f
                end = c
            last[lane] = end
            toph[lane] = np.float32(np.inf) if end == NONE else flat[end * LANES + lane]
        hidden |= hid
        while levels > 0 and used[levels - 1] == 0:
            levels -= 1
        checks += elems + LANES
        e = 0
        while True:
            e, bits = crossed(lines, opened, used, e, levels, heights, r, on)
            if e >= levels:
                break
            while bits:
                lane = lowest_bit(np.uint32(bits))
                bits &= bits - 1
                bit = 1 << lane
                hr = np.float64(flat[r * LANES + lane])
                slot = e
                c = C[e * LANES + lane]
                far = nodes[c * FIELDS + lane * 4 + FARTHER]
                nn = np.int32(0)
                tt = 0
                if not opened[e] & bit:
                    nn -= np.int32(1)
                    tt -= c - r
                # The child itself is among those that a step has counted
                checks -= 1
                while c != far:
                    checks += 1
                    q = c * FIELDS + lane * 4
                    hc = np.float64(flat[c * LANES + lane]) - hr
                    dc = np.float64(c - r)
                    g = nodes[q + CHILD]
                    x = g
                    b = g
                    while x != NONE and (np.float64(flat[x * LANES + lane]) - hr) * dc > hc * np.float64(x - r):
                        b = x
                        x = nodes[x * FIELDS + lane * 4 + NEARER]
                        checks += 1
                    if x != g:
                        # g to b come before c
                        pv = nodes[q + FARTHER]
                        nodes[g * FIELDS + lane * 4 + FARTHER] = pv
                        if pv != NONE:
                            nodes[pv * FIELDS + lane * 4 + NEARER] = g
                        nodes[q + CHILD] = x
                        if x == NONE and not fresh[c] & bit:
                            if c == last[lane]:
                                last[lane] = b
                                toph[lane] = flat[b * LANES + lane]
                            else:
                                nx = nodes[q + NEARER]
                                nodes[b * FIELDS + lane * 4 + NEARER] = nx
                                nodes[nx * FIELDS + lane * 4 + FARTHER] = b
                            c = b
                            continue
                        nodes[b * FIELDS + lane * 4 + NEARER] = c
                        nodes[q + FARTHER] = b
                    # settle
                    if slot < 0:
                        slot = hint[lane]
                        while used[slot] & bit:
                            slot += 1
                        hint[lane] = slot + 1
                        used[slot] |= bit
                        if slot >= levels:
                            levels = slot + 1
                        elems += 1
                    t = np.int64(x)
                    isopen = False
                    if x == NONE:
                        t = np.int64(c) + 1
                        isopen = (np.float64(flat[t * LANES + lane]) - hr) * dc > hc * (dc + 1.0)
                    if isopen:
                        opened[slot] |= bit
                    else:
                        opened[slot] &= ~bit
                        nn += np.int32(1)
                        tt += c - r
                    C[slot * LANES + lane] = c
                    nodes[q + SLOT] = slot
                    _draw(slot, lane, c, t, isopen, flat, lines)
                    slot = -1
                    c = nodes[q + FARTHER]
                if slot >= 0:
                    used[slot] &= ~bit
                    hint[lane] = min(hint[lane], slot)
                    elems -= 1
                number[lane] += nn
                total[lane] += np.int32(tt)
            e += 1
        if room:
            if at < elems + LANES:
                return -1, checks
            at = _keep(flat, nodes, opened, last, number, on, on & (hidden | ~gt), r, at, offsets, overs)
        put(number, total, on & (hidden | ~gt), counts, totals, r)
        near = (starts | hidden) & on
    return room - at, checks
