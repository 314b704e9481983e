"""Local horizons: where each visible stretch of the surface ends, for every point in one direction (§4).

Found by marching, in two passes: count, then write.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .march import crossings


@nb.njit(cache=True)
def _row(heights, i, j, offset, weight, distance, step, curve, start, distances, angles):
    # Going outwards: a stretch is visible while slopes rise, its end is a local horizon
    rows, columns = heights.shape
    best, at, visible, count = -np.inf, 0.0, False, 0
    for n in range(len(distance)):
        ra, rb = i + offset[n, 0], i + offset[n, 2]
        ca, cb = j + offset[n, 1], j + offset[n, 3]
        if ra >= rows or rb >= rows or ca >= columns or cb >= columns:
            break
        h = np.float64(heights[ra, ca])
        h += weight[n] * (heights[rb, cb] - h)
        x = distance[n] * step
        rise = (h - heights[i, j]) / x - curve * x
        if rise > best:
            best, at, visible = rise, x, True
        elif visible:
            # Equal slopes do not count as rising: the nearer of two ends on one line of sight is the horizon
            if start >= 0:
                distances[start + count], angles[start + count] = at, np.arctan(best)
            count += 1
            visible = False
    if visible:
        if start >= 0:
            distances[start + count], angles[start + count] = at, np.arctan(best)
        count += 1
    return count


@nb.njit(cache=True, parallel=True)
def _all(heights, order, offset, weight, distance, step, curve, offsets, distances, angles):
    rows, columns = heights.shape
    for i in nb.prange(rows):
        for j in range(columns):
            p = order[i, j]
            if len(distances):
                _row(heights, i, j, offset, weight, distance, step, curve, offsets[p], distances, angles)
            else:
                offsets[p + 1] = _row(heights, i, j, offset, weight, distance, step, curve, -1, distances, angles)


def local_horizons(d, heights, curve: float, reach: int | None):
    """Return offsets, distances and angles; see `HeightField.intervisibility`."""
    order = np.ascontiguousarray(d.turn(np.arange(heights.size).reshape(heights.shape)))
    turned = np.ascontiguousarray(d.turn(heights))
    columns = turned.shape[1] - 1 if reach is None else min(reach, turned.shape[1] - 1)
    steps = crossings(d.slope, d.diagonal, max(columns, 0))
    offsets = np.zeros(heights.size + 1, dtype=np.int64)
    none = np.empty(0, dtype=np.float32)
    _all(turned, order, *steps, d.step, curve, offsets, none, none)
    np.cumsum(offsets, out=offsets)
    distances, angles = (np.empty(offsets[-1], dtype=np.float32) for _ in range(2))
    if offsets[-1]:
        _all(turned, order, *steps, d.step, curve, offsets, distances, angles)
    return offsets, distances, angles
