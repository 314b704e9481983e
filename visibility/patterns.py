"""Labelled visibility patterns: light grids behind generated solid and see-through blockers (§3.2, Fig. 5).

A pattern is the unit square cut into visible (V), blocked (B) and see-through (S) regions; which of them are there *is*
the label. Regions are discs, rectangles, bands, corners and half-planes at any angle, rasterised with antialiasing, so
solid edges leave partly covered cells. What lies near the border between two labels is never generated:

- fully visible, invisible: the other region covers less than `TRACE` (a quarter of a cell of a 4×4 grid);
- partial solid: V and B each cover at least `SOLID` (one cell), in pieces wider than a cell or cut off by the light's
  border; no S;
- the others: each region that is there covers at least `REGION`, the rest nothing.
"""

from __future__ import annotations

import numpy as np

from .classes import VisibilityClass as C

TRACE = 1 / 64
SOLID = 1 / 16
REGION = 0.2
SUBSAMPLES = 8  # samples a cell and axis, for antialiasing


def generate(count: int, seed: int, n: int = 4, rays: tuple[int, int] | None = (4, 8)):
    """Generate labelled patterns, equally many of each class up to one.

    Parameters
    ----------
    count : int
        Number of patterns.
    seed : int
        Patterns of different seeds are independent.
    n : int
        Cells an axis.
    rays : (int, int) or None
        Each cell's fraction is estimated from this many binary samples (drawn uniformly from the closed range), as
        few shadow rays would; None gives exact fractions.

    Returns
    -------
    fractions : ndarray, shape (count, n²), float32
        Fractional visibility, row by row.
    labels : ndarray, shape (count,), int64
        `VisibilityClass` values.
    """
    rng = np.random.default_rng([seed, n])
    labels = np.arange(count) % len(C)
    rng.shuffle(labels)
    fractions = np.empty((count, n * n))
    for start in range(0, count, 2048):
        part = slice(start, start + 2048)
        visible, see_through = _regions(rng, labels[part], n)
        fractions[part] = _cells(visible + see_through * _textures(rng, len(visible), n), n)
    if rays is not None:
        k = rng.integers(rays[0], rays[1] + 1, fractions.shape)
        fractions = rng.binomial(k, np.clip(fractions, 0, 1)) / k
    return fractions.astype(np.float32), labels


def _grid(n: int) -> np.ndarray:
    """Return the sample points of the unit square, shape (2, (n SUBSAMPLES)²)."""
    c = (np.arange(n * SUBSAMPLES) + 0.5) / (n * SUBSAMPLES)
    y, x = np.meshgrid(c, c, indexing="ij")
    return np.stack([x.ravel(), y.ravel()])


def _cells(values: np.ndarray, n: int) -> np.ndarray:
    """Average samples over each cell."""
    s = SUBSAMPLES
    return values.reshape(-1, n, s, n, s).mean((2, 4)).reshape(len(values), n * n)


def _regions(rng, labels: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw the V and S regions of patterns with the given labels, shape (len(labels), samples), as 0 or 1."""
    m = len(labels)
    share = {k: np.zeros(m) for k in "VBS"}
    u, v = rng.random(m), rng.random((m, 3))

    # Areas, by label: two-region labels split the square once, the last one twice
    trace = TRACE * u * (rng.random(m) < 0.5)
    wide = REGION + (1 - 2 * REGION) * u
    share["B"] = np.select(
        [labels == C.FULLY_VISIBLE, labels == C.INVISIBLE, labels == C.PARTIAL_SOLID],
        [trace, 1 - trace, SOLID + (1 - 2 * SOLID) * u],
        0.0,
    )
    share["S"] = np.where(labels == C.FULL_SEE_THROUGH, 1.0, np.where(labels > C.FULL_SEE_THROUGH, wide, 0.0))
    three = labels == C.PARTIAL_SOLID_SEE_THROUGH
    excess = -np.log(v)
    thirds = REGION + (1 - 3 * REGION) * excess / excess.sum(1, keepdims=True)
    share["S"] = np.where(three, thirds[:, 0], share["S"])
    share["B"] = np.where(three, thirds[:, 1], share["B"])
    share["B"] = np.where(labels == C.FULL_SOLID_SEE_THROUGH, 1 - share["S"], share["B"])
    share["V"] = 1 - share["S"] - share["B"]

    # Cut the three regions out of the square in random order; whatever is left is the last one
    points = _grid(n)
    order = rng.permuted(np.tile(np.arange(3), (m, 1)), axis=1)
    areas = np.stack([share["V"], share["B"], share["S"]], 1)
    first, second = (np.take_along_axis(areas, order[:, i : i + 1], 1)[:, 0] for i in range(2))
    one = _cut(_shapes(rng, points, first), first)
    distance = np.where(one, np.inf, _shapes(rng, points, second))
    two = _cut(distance, second) & ~one
    which = np.where(one, order[:, :1], np.where(two, order[:, 1:2], order[:, 2:]))
    return (which == 0).astype(np.float64), (which == 2).astype(np.float64)


def _cut(distance: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the ``area`` share of samples with the smallest distance, per pattern."""
    samples = distance.shape[1]
    rank = np.rint(area * samples).astype(int)
    ordered = np.sort(distance, axis=1)
    bound = np.take_along_axis(ordered, np.maximum(rank - 1, 0)[:, None], 1)
    return (distance <= bound) & (rank > 0)[:, None]


def _shapes(rng, points: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return a random function per pattern whose sublevel sets are regions of one shape.

    Small regions only enter from the light's border: inside it they would be as small as a cell, thus see-through.
    """
    m = len(area)
    x, y = points[:, None, :]
    angle = rng.random((m, 1)) * 2 * np.pi
    cx, cy = rng.random((m, 1)), rng.random((m, 1))
    u = (x - cx) * np.cos(angle) + (y - cy) * np.sin(angle)
    v = (y - cy) * np.cos(angle) - (x - cx) * np.sin(angle)
    aspect = np.exp(rng.uniform(-0.6, 0.6, (m, 1)))
    far = 2 * rng.random((m, 1)) + 0.5  # the corner's tip slides along its diagonal
    disc = np.hypot(u, v)
    box = np.maximum(np.abs(u) * aspect, np.abs(v))
    corner = np.maximum(u, v * np.exp(rng.uniform(-1, 1, (m, 1)))) + 0 * far
    kinds = np.stack([u, corner, disc, box, np.abs(u)])
    kind = np.where(
        area < REGION, rng.integers(0, 2, m), np.where(area < 0.4, rng.integers(0, 4, m), rng.integers(0, 5, m))
    )
    inside_out = rng.random(m) < 0.5
    # Inside out, what is left of the square is the disc, box or band: it must not be too small either
    inside_out &= 1 - area >= np.where(kind == 4, 0.4, np.where(kind >= 2, REGION, 0))
    distance = kinds[kind, np.arange(m)]
    return np.where(inside_out[:, None], -distance, distance)


def _textures(rng, m: int, n: int) -> np.ndarray:
    """Return see-through blockers' transmission at every sample, shape (m, samples).

    Half of them are a random mid-gray a cell (§3.2), a quarter bars and a quarter leaves, both finer than 1.5 cells.
    """
    x, y = _grid(n)[:, None, :] * n
    mean, spread = rng.uniform(0.3, 0.7, (m, 1)), rng.uniform(0, 0.3, (m, 1))
    cell = (np.floor(y) * n + np.floor(x)).astype(int)[0]
    gray = np.clip(mean + spread * rng.uniform(-1, 1, (m, n * n)), 0.2, 0.8)[:, cell]

    angle, shift = rng.random((m, 1)) * 2 * np.pi, rng.random((m, 2, 1))
    u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    bars = (u / rng.uniform(0.2, 1.5, (m, 1)) + shift[:, 0]) % 1 < mean

    # Leaves: a rotated lattice whose squares are open or closed at random
    size = rng.uniform(0.2, 0.6, (m, 1))
    lattice = rng.random((m, 64 * 64))
    at = np.floor(u / size + shift[:, 0]).astype(int) % 64 * 64 + np.floor(v / size + shift[:, 1]).astype(int) % 64
    leaves = np.take_along_axis(lattice, at, 1) < mean

    kind = rng.integers(0, 4, (m, 1))
    return np.where(kind < 2, gray, np.where(kind == 2, bars, leaves))
