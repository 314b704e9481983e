"""The convex hull tree of a line (§4, §5): all local horizons by visiting what is seen, and little else.

Every stretch of the line that is convex starts a path of the tree; each path is the upper convex hull from there to the
root, which is the receiver. The root's children are then the ends of its sight lines. A new receiver becomes the root and
the tree is mended from the top: a child that no longer is convex with its own first child hands that child to the root.

Departures from the paper. Nodes are the samples themselves, and the leaf that §5 duplicates is a mark on its sample: it
stays when its last child has left, but not otherwise. Algorithm 1's two recursions become one walk along the root's children,
because a child moved to the root stands just before its former parent, where the walk goes on. And a child whose outer
neighbour is seen too ends no visible stretch, so it is no local horizon here (about half of the root's children).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .lanes import LANES
from .lines import NOWHERE

NONE = -1


@nb.njit(cache=True, inline="always")
def _exceeds(h, k, other, m, here, receiver):
    # Whether sample k rises more steeply from the receiver than sample m; exact for float32 heights of like magnitude
    return (h - here) * (m - receiver) > (other - here) * (k - receiver)


@nb.njit(cache=True)
def line(h, keep, at, counts, totals, offsets, overs, fresh, children, siblings):
    """Find the horizons of every sample of one line looking along rising indices, from its far end to its start.

    Parameters
    ----------
    h : (n,) float64 array
        Heights.
    keep : bool
        Write `offsets` and `overs` from place `at` on; farthest first, sample by sample from the far end.
    counts, totals : (n,) int64 arrays
        Horizons of each sample and the sum of their distances, written.
    fresh, children, siblings : (n,) bool, int64, int64 arrays
        Work space.

    Returns
    -------
    at : int
        Place after the last entry; -1 if there was no room.
    checks : int
        Convexity checks: the paper's iterations.
    """
    n, checks, convex = len(h), 0, True
    counts[n - 1], totals[n - 1] = 0, 0
    children[n - 1], siblings[n - 1], fresh[n - 1] = NONE, NONE, True
    for root in range(n - 2, -1, -1):
        here, old = h[root], root + 1
        # A convex stretch starts at the old root if it is the first of the line, or follows a concave one (Eq. 1)
        if old < n - 1:
            bend = 2 * h[old] - h[old + 1] - h[root]
            starts = bend > 0 and not convex
            convex = bend > 0 or (convex and bend == 0)
            fresh[old] = starts
        children[root] = old
        siblings[old], before, ahead, node = NONE, NONE, NONE, old
        while node != NONE:
            child = children[node]
            checks += 1
            if child != NONE and _exceeds(h[child], child, h[node], node, here, root):
                # The child sees over its parent: it becomes the root's, just before the parent (Algorithm 1)
                children[node] = siblings[child]
                siblings[child] = node
                if before == NONE:
                    children[root] = child
                else:
                    siblings[before] = child
                node = child
            elif child == NONE and not fresh[node] and node != old:
                # No hull goes through it any more
                after = siblings[node]
                if before == NONE:
                    children[root] = after
                else:
                    siblings[before] = after
                node = after
            else:
                if node == old:
                    ahead = before
                before, node = node, siblings[node]
        # The old root may have lost all its hulls too, but the nearest sample is always seen
        count, total, node = 0, 0, children[root]
        if keep and at + n > len(offsets):
            return -1, checks
        while node != NONE:
            if node == n - 1 or not _exceeds(h[node + 1], node + 1, h[node], node, here, root):
                if keep:
                    offsets[at], overs[at] = node - root, np.float32(h[node]) - np.float32(here)
                    at += 1
                count, total = count + 1, total + node - root
            node = siblings[node]
        counts[root], totals[root] = count, total
        if not fresh[old] and children[old] == NONE:
            if ahead == NONE:
                children[root] = NONE
            else:
                siblings[ahead] = NONE
    return at, checks


@nb.njit(cache=True)
def search(heights, room, counts, totals, offsets, overs):
    """Find the horizons of every sample of a panel; as `intervisibility.search`, whose parameters these are."""
    n = len(heights)
    keep, at, checks = len(offsets) > 0, 0, 0
    h, fresh = np.empty(n), np.empty(n, np.bool_)
    children, siblings = np.empty(n, np.int64), np.empty(n, np.int64)
    c, t = np.empty(n, np.int64), np.empty(n, np.int64)
    raw_offsets, raw_overs = np.empty(len(offsets), np.int32), np.empty(len(offsets), np.float32)
    ends = np.zeros((n, LANES), np.int64)
    counts[:], totals[:] = 0, 0
    for lane in range(LANES):
        # A line's samples on the field are one stretch
        a, b = 0, n
        while a < b and heights[a, lane] == NOWHERE:
            a += 1
        while b > a and heights[b - 1, lane] == NOWHERE:
            b -= 1
        if b == a:
            continue
        for k in range(a, b):
            h[k] = heights[k, lane]
        if at > room:
            return -1, checks
        start = at
        at, more = line(h[a:b], keep, at, c, t, raw_offsets, raw_overs, fresh, children, siblings)
        checks += more
        if at < 0:
            return -1, checks
        for k in range(b - a - 1, -1, -1):
            start += c[k] if keep else 0
            counts[a + k, lane], totals[a + k, lane], ends[a + k, lane] = c[k], t[k], start
    # In the order of samples and lanes, nearest first
    used = 0
    if keep:
        for k in range(n):
            for lane in range(LANES):
                for m in range(counts[k, lane]):
                    offsets[used] = raw_offsets[ends[k, lane] - 1 - m]
                    overs[used] = raw_overs[ends[k, lane] - 1 - m]
                    used += 1
    return used, checks
