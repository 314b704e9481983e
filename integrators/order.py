"""Which hits are traced side by side: those whose shadow rays go to the same part of the light.

A packet of rays costs less the closer its rays stay together. A pixel's light samples are a net, whose points `i` fall
into elementary intervals by digits of `i` alone: binary digit k of a point's first coordinate is bit k of `i`, that of its
second is bit k of ``_sobol_1(i)``, and scrambling only swaps intervals. So lanes are numbered by these digits instead of
by `i`: neighbouring lanes then share one small cell of the light, the same places are sampled, and nothing else changes.
"""

from __future__ import annotations

from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

LOG_RAYS = 4  # log2 of rays a hit that are told apart: 0 to 3
LOG_HITS = 10  # beyond, hits are ordered in blocks of this size


def _second(i: np.ndarray) -> np.ndarray:
    # Second Sobol' dimension, bit-reversed: `points._sobol_1` in NumPy
    for mask, shift in ((0xAAAAAAAA, 1), (0xCCCCCCCC, 2), (0xF0F0F0F0, 4), (0xFF00FF00, 8), (0xFFFF0000, 16)):
        i = i ^ ((i & mask) >> shift)
    return i


def packed(log_hits: int, log_rays: int) -> np.ndarray:
    """Order a pixel's hits so that neighbours' r-th rays go to the same cell of the light.

    Parameters
    ----------
    log_hits, log_rays : int
        Binary logarithms of hits in the pixel and of rays a hit.

    Returns
    -------
    ndarray of int, shape (2 ** log_hits,)
        Numbers of hits, in order.
    """
    s = np.arange(2**log_hits)
    i = s << log_rays
    x, y = log_rays, 0
    keys = []
    # Halve the cell along its longer side, until every hit has its own
    while x < log_rays + log_hits or y < log_rays + log_hits:
        if y < x and y < log_rays + log_hits:
            keys.append((_second(i) >> y) & 1)
            y += 1
        else:
            keys.append((i >> x) & 1)
            x += 1
    return np.lexsort(keys[::-1]) if keys else s


@lru_cache
def _table() -> np.ndarray:
    # Orders of all sizes: that of 2^h hits of 2^r rays begins at r 2^(LOG_HITS + 1) + 2^h
    table = np.zeros(LOG_RAYS << (LOG_HITS + 1), dtype=np.uint32)
    for r in range(LOG_RAYS):
        for h in range(LOG_HITS + 1):
            start = (r << (LOG_HITS + 1)) + (1 << h)
            table[start : start + (1 << h)] = packed(h, r)
    return table


class Order:
    """The orders, where kernels can read them."""

    def __init__(self):
        self.table = mi.UInt32(_table())

    def number(self, k, hits, rays):
        """Hit that is the k-th to be traced of a pixel's ``hits``, a power of two, of ``rays`` each (mi.UInt32)."""
        block = dr.minimum(hits, 1 << LOG_HITS)
        log_rays = dr.minimum(31 - dr.lzcnt(rays), LOG_RAYS - 1)
        start = (log_rays << (LOG_HITS + 1)) + block
        low = k & (block - 1)
        return k - low + dr.gather(mi.UInt32, self.table, start + low)


def turn(s, rays):
    """What to xor a ray's number with, so that the r-th rays of all hits share a squarer cell (mi.UInt32)."""
    return dr.select(rays >= 4, (dr.popcnt(s) & 1) * (rays >> 1), 0)
