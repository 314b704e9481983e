"""Where in the sky light samples are worth their rays: where pilots nearby saw it.

Of a sky most points see a part: a window, a gap between trees; and a sun that is hidden takes half of all samples in vain. So
pilots' light samples are counted by tile of the film, and by cell of the unit square that their random numbers lie in. Later
samples' numbers are warped towards cells of which something was seen. Any density will do that is nought nowhere: that a
pixel's own pilot is in it too makes no bias, as the samples drawn by it are others.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

TILE = 8  # pixels along each side of a tile
SIDE = 8  # cells along each side of the unit square; a multiple of 4, as that many numbers are read at once
BESIDE = 0.5  # weight of the eight tiles around
MUCH = 0.1  # share of a cell's looks that, if seen, makes it worth as much as any
FLOOR = 0.1  # share of the mean density that is added everywhere: what no pilot saw must not stand out too far
GAIN = 0.1  # logarithm of the density that is gained in cells that are seen, mean over tiles, below which it is not worth it


@dataclass
class Counts:
    """Looks at the sky, and those that saw it, by tile and cell.

    Attributes
    ----------
    width, across, down : int
        Pixels in a row of the film, and tiles in its rows and columns.
    tried, seen : mi.Float
        Of ``across * down * SIDE**2`` entries, a tile's cells side by side.
    """

    width: int
    across: int
    down: int
    tried: object
    seen: object

    @classmethod
    def empty(cls, width: int, height: int) -> Counts:
        """Return counts of nothing for a film."""
        across, down = -(-width // TILE), -(-height // TILE)
        tried, seen = (dr.zeros(mi.Float, across * down * SIDE**2) for _ in range(2))
        dr.eval(tried, seen)
        return cls(width, across, down, tried, seen)

    def tile(self, index):
        """Which tile a pixel lies in."""
        w = dr.opaque(mi.UInt32, self.width)
        y = index // w
        return (y // TILE) * dr.opaque(mi.UInt32, self.across) + (index - y * w) // TILE

    def add(self, tile, u, tried, seen) -> None:
        """Count light samples by their random numbers where they were ``tried`` and where ``seen``."""
        cell = (tile * SIDE + mi.UInt32(u.y * SIDE)) * SIDE + mi.UInt32(u.x * SIDE)
        for total, here in ((self.tried, tried), (self.seen, seen)):
            dr.scatter_reduce(dr.ReduceOp.Add, total, mi.Float(1), cell, here)


class Guide:
    """Densities over the unit square, constant in each cell, for every tile of a film.

    Parameters
    ----------
    counts : Counts
    w : ndarray, shape (tiles, SIDE, SIDE)
        Density in each cell, > 0, up to a factor.
    share : ndarray, shape (tiles,)
        How many times as dense as without it samples lie where the sky is seen, on average.
    """

    def __init__(self, counts: Counts, w: np.ndarray, share: np.ndarray):
        self.tile = counts.tile
        columns = np.cumsum(w, 2, dtype=np.float64)
        rows = np.cumsum(columns[:, None, :, -1], 2)
        self.upto = _aligned(np.concatenate([rows, columns], 1) / np.concatenate([rows[:, :, -1:], columns[:, :, -1:]], 1))
        self.share = mi.Float(share.astype(np.float32))

    def warp(self, tile, u, active):
        """Warp points of the unit square where ``active``; return them, and their density."""
        at = tile * (SIDE + 1)
        k, y, p = self._search(at, u.y, active)
        j, x, q = self._search(at + 1 + k, u.x, active)
        v = dr.minimum(mi.Point2f(mi.Float(j) + x, mi.Float(k) + y) * (1 / SIDE), 1 - 2**-24)
        return dr.select(active, v, u), dr.select(active, p * q * SIDE**2, 1)

    def _search(self, at, u, active):
        # Which part of the unit interval a number falls into, where in it, and how wide it is
        upto = [x for i in range(SIDE // 4) for x in dr.gather(mi.Vector4f, self.upto, at * (SIDE // 4) + i, active)]
        k, low, high = mi.UInt32(0), mi.Float(0), mi.Float(upto[0])
        for i in range(SIDE - 1):
            above = u >= upto[i]
            k, low, high = dr.select(above, i + 1, k), dr.select(above, upto[i], low), dr.select(above, upto[i + 1], high)
        width = dr.maximum(high - low, 1e-9)
        return k, (u - low) / width, width


def guide(counts: Counts) -> Guide | None:
    """Return where to look for the sky; None where all of it is worth looking for nearly everywhere."""
    shape = counts.down, counts.across, SIDE, SIDE
    tried, seen = (_pool(np.array(x).reshape(shape)).reshape(-1, SIDE, SIDE) for x in (counts.tried, counts.seen))
    mean = seen.sum((1, 2), keepdims=True) / np.maximum(tried.sum((1, 2), keepdims=True), 1)
    f = (seen + mean) / (tried + 1)
    # Samples in proportion to the root of what is seen, were it known. But pixels of a tile differ: what some see, others
    # may see all of, without noise if it is sampled evenly
    w = np.sqrt(np.where(seen > 0, np.minimum(f / MUCH, 1), f))
    w[mean.ravel() <= 0] = 1
    # Cells beside those that are seen may be so in part
    w = np.maximum(w, _smooth(w))
    w += FLOOR * w.mean((1, 2), keepdims=True)
    w /= w.max((1, 2), keepdims=True)
    level = w.mean((1, 2))
    if -np.log(level).mean() < GAIN:
        return None
    return Guide(counts, w, (f * w).sum((1, 2)) / np.maximum(f.sum((1, 2)), 1e-30) / level)


def _pool(x: np.ndarray) -> np.ndarray:
    # Tiles with a share of those around
    p = np.pad(x, ((1, 1), (1, 1), (0, 0), (0, 0)))
    near = sum(p[i : i + x.shape[0], j : j + x.shape[1]] for i in range(3) for j in range(3))
    return (1 - BESIDE) * x + BESIDE * near


def _smooth(w: np.ndarray) -> np.ndarray:
    # Means over the cells around, by a tent
    p = np.pad(w, ((0, 0), (1, 1), (1, 1)), mode="edge")
    p = 0.25 * p[:, :-2] + 0.5 * p[:, 1:-1] + 0.25 * p[:, 2:]
    return 0.25 * p[:, :, :-2] + 0.5 * p[:, :, 1:-1] + 0.25 * p[:, :, 2:]


def _aligned(x: np.ndarray):
    # Dr.Jit's own memory, where four numbers can be gathered at once; it borrows NumPy's
    out = dr.empty(mi.Float, x.size)
    dr.scatter(out, mi.Float(x.ravel().astype(np.float32)), dr.arange(mi.UInt32, x.size))
    dr.eval(out)
    return out
