"""The features of `features` for millions of lanes at once: Dr.Jit code that fits inside a larger kernel.

Nothing here evaluates or loops at run time. Gray levels are counted by adding one to small counters
packed in 64-bit words; a 4×4 grid with four levels needs a single word for all its 24 neighbour
pairs.
"""

from __future__ import annotations

from itertools import combinations

import drjit as dr
import numpy as np

from .features import TOLERANCE, neighbors, thresholds


def grid_pairs(n: int) -> list[tuple[int, int]]:
    """Return the index pairs of edge-sharing cells of an ``n × n`` grid, row-major."""
    right = [(r * n + c, r * n + c + 1) for r in range(n) for c in range(n - 1)]
    down = [(r * n + c, (r + 1) * n + c) for r in range(n - 1) for c in range(n)]
    return right + down


def grid_features(fractions: list, levels: int = 4) -> list:
    """Return the features of light cells on a regular grid (§3.1, §5.2).

    Parameters
    ----------
    fractions : list of n² Dr.Jit floats
        Fractional visibility of each cell in [0, 1], row by row; each array has one entry a lane.
    levels : int
        Gray levels G.

    Returns
    -------
    list of G + (G² + G)/2 Dr.Jit floats
        As `features.features` gives for the cells' centres, bit for bit.
    """
    return _fixed_pairs(fractions, grid_pairs(round(len(fractions) ** 0.5)), levels)


def _fixed_pairs(fractions: list, pairs: list, levels: int) -> list:
    """Return the features for neighbour pairs that are the same in every lane."""
    lowest, high = _encode(fractions, levels, len(pairs))
    histogram = _histogram(fractions, levels)

    # A pair's counter is chosen by the lower and the higher level; both encodings grow with the level
    words = _Counters(fractions[0], levels * (levels + 1) // 2, len(pairs))
    for a, b in pairs:
        words.add(dr.minimum(lowest[a], lowest[b]) + dr.maximum(high[a], high[b]))

    scale = 1 / len(pairs) if pairs else 0.0
    return histogram + [_float(fractions[0], count) * scale for count in words.read()]


def cluster_features(fractions: list, positions: list, levels: int = 4, valid: list | None = None) -> list:
    """Return the features of clusters at any positions (§4.3).

    Parameters
    ----------
    fractions : list of N Dr.Jit floats
        Fractional visibility of each cluster in [0, 1].
    positions : list of N pairs (x, y)
        Cluster centres: Python floats where all lanes share them, Dr.Jit floats where each lane has
        its own.
    levels : int
        Gray levels G.
    valid : list of N Dr.Jit masks, optional
        False for culled clusters, which give no information.

    Returns
    -------
    list of G + (G² + G)/2 Dr.Jit floats
    """
    # Positions that all lanes share fix the pairs once and for all
    shared = all(isinstance(c, (int, float)) for xy in positions for c in xy)
    if shared and valid is None:
        near = neighbors(np.array(positions, np.float64))
        return _fixed_pairs(fractions, np.argwhere(np.triu(near)).tolist(), levels)

    # Δ₁ by Eq. 4: the mean over the valid clusters of the distance to the nearest other valid one
    Float = _float_type(fractions[0])
    n = len(fractions)
    all_pairs = list(combinations(range(n), 2))
    distance, both = {}, {}
    nearest = [Float(dr.inf)] * n
    for a, b in all_pairs:
        dx, dy = (positions[a][k] - positions[b][k] for k in range(2))
        distance[a, b] = Float(dr.sqrt(dx * dx + dy * dy))
        both[a, b] = True if valid is None else valid[a] & valid[b]
        d = distance[a, b] if valid is None else dr.select(both[a, b], distance[a, b], dr.inf)
        nearest[a], nearest[b] = dr.minimum(nearest[a], d), dr.minimum(nearest[b], d)
    total, count = Float(0), Float(0)
    for d in nearest:
        total += dr.select(d < dr.inf, d, 0)
        count += dr.select(d < dr.inf, Float(1), Float(0))
    delta = total / dr.maximum(count, 1)

    # Co-occurrence of the pairs whose distance is Δ₁ up to the tolerance (§4.3)
    lowest, high = _encode(fractions, levels, len(all_pairs))
    words = _Counters(fractions[0], levels * (levels + 1) // 2, len(all_pairs))
    for a, b in all_pairs:
        near = (dr.abs(distance[a, b] - delta) < TOLERANCE * delta) & both[a, b]
        words.add(dr.minimum(lowest[a], lowest[b]) + dr.maximum(high[a], high[b]), near)
    counts = [_float(fractions[0], c) for c in words.read()]
    scale = 1 / dr.maximum(sum(counts[1:], counts[0]), 1)
    return _histogram(fractions, levels, valid) + [c * scale for c in counts]


class _Counters:
    """Counters in 64-bit words, ``bins`` of them, counting up to ``most``; addressed by bit position."""

    def __init__(self, like, bins: int, most: int):
        self.UInt64 = dr.uint64_array_t(_float_type(like))
        self.bits = max(most, 1).bit_length()
        self.per_word = 64 // self.bits
        self.bins = bins
        self.words = [self.UInt64(0) for _ in range(-(-bins // self.per_word))]

    def add(self, bit, active=True):
        """Add one to the counter at ``bit`` = bin × bits."""
        span = self.per_word * self.bits
        for i in range(len(self.words)):
            here, shift = active, bit
            if len(self.words) > 1:
                shift = bit - i * span
                here = here & (bit >= i * span) & (bit < (i + 1) * span)
            one = self.UInt64(1) << self.UInt64(dr.select(here, shift, 0))
            self.words[i] += one if here is True else dr.select(here, one, self.UInt64(0))

    def read(self) -> list:
        """Return the counts, a 64-bit integer array each."""
        mask = (1 << self.bits) - 1
        return [(self.words[k // self.per_word] >> (k % self.per_word * self.bits)) & mask for k in range(self.bins)]


def _encode(fractions: list, levels: int, most: int) -> tuple[list, list]:
    """Return, per cluster, the two addends whose sum is the bit position of a pair's counter.

    The counter of levels i <= j is number i (2G - 1 - i)/2 + j: one addend depends on the lower
    level, one on the higher.
    """
    UInt32 = dr.uint32_array_t(_float_type(fractions[0]))
    bits = max(most, 1).bit_length()
    row = [i * (2 * levels - 1 - i) // 2 * bits for i in range(levels)]
    lowest, high = [], []
    for f in fractions:
        low, up = UInt32(0), UInt32(0)
        for i, t in enumerate(thresholds(levels).tolist()):
            above = f >= t
            low = dr.select(above, UInt32(row[i + 1]), low)
            up = dr.select(above, UInt32((i + 1) * bits), up)
        lowest.append(low)
        high.append(up)
    return lowest, high


def _histogram(fractions: list, levels: int, valid: list | None = None) -> list:
    """Return the share of (valid) clusters in each gray level."""
    Float = _float_type(fractions[0])
    UInt32 = dr.uint32_array_t(Float)

    # Clusters at or above each threshold; differences of these are the histogram
    above = []
    for t in thresholds(levels).tolist():
        masks = [f >= t for f in fractions]
        if valid is not None:
            masks = [m & v for m, v in zip(masks, valid, strict=True)]
        above.append(sum((dr.select(m, UInt32(1), UInt32(0)) for m in masks), UInt32(0)))
    if valid is None:
        everything, scale = UInt32(len(fractions)), 1 / len(fractions)
    else:
        everything = sum((dr.select(v, UInt32(1), UInt32(0)) for v in valid), UInt32(0))
        scale = 1 / dr.maximum(Float(everything), 1)
    at_least = [everything, *above]
    counts = [a - b for a, b in zip(at_least, [*at_least[1:], UInt32(0)], strict=True)]
    return [Float(c) * scale for c in counts]


def _float_type(array):
    """Return the 32-bit float type of the same backend, without derivatives: classes have none."""
    return dr.float32_array_t(dr.detached_t(type(array)))


def _float(like, count):
    """Convert a 64-bit count to float."""
    Float = _float_type(like)
    return Float(dr.uint32_array_t(Float)(count))
