"""Labelled visibility patterns: light grids behind generated solid and see-through blockers (§3.2, Fig. 5).

A pattern is the unit square cut into visible (V), blocked (B) and see-through (S) regions; which of
them are there *is* the label. Regions are half-planes, corners, discs, rectangles and bands at any
angle, rasterised with antialiasing, so solid edges leave partly covered cells. Patterns near the
border between two labels are not made:

- fully visible, invisible: the other region covers at most `TRACE` (a quarter of a cell of a 4×4
  grid);
- partial solid: V and B cover at least `SOLID` (one such cell); a region smaller than `REGION`
  enters from the
  square's border, because an island of that size would be as small as a cell, thus see-through;
- the others: each region that is there covers at least `REGION`, the rest nothing;
- see-through blockers are a random mid-gray a cell, or bars or leaves no larger than a cell.
"""

from __future__ import annotations

import numpy as np

from .classes import VisibilityClass as C

TRACE = 1 / 64
SOLID = 1 / 16
REGION = 0.3
SUBSAMPLES = 8  # samples a cell and axis, for antialiasing


def generate(
    count: int, seed: int, n: int = 4, rays: tuple[int, int] | None = None, region: float = REGION
) -> tuple[np.ndarray, np.ndarray]:
    """Generate labelled patterns, equally many of each class up to one.

    Parameters
    ----------
    count : int
        Number of patterns.
    seed : int
        Patterns of different seeds are independent.
    n : int
        Cells an axis.
    rays : (int, int), optional
        Estimate each cell's fraction from this many binary samples (drawn uniformly from the closed
        range), as few shadow rays do; exact fractions by default.
    region : float
        Smallest area of a region in the four see-through labels, at most 1/3.

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
    for start in range(0, count, 1024):
        part = slice(start, start + 1024)
        visible, see_through = _regions(rng, labels[part], n, region)
        fractions[part] = _cells(visible + see_through * _textures(rng, len(visible), n), n)
    if rays is not None:
        fractions = measure(fractions, rays, rng)
    return fractions.astype(np.float32), labels


def measure(fractions: np.ndarray, rays: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Estimate fractions from ``rays[0]`` to ``rays[1]`` random binary samples each."""
    k = rng.integers(rays[0], rays[1] + 1, fractions.shape)
    return rng.binomial(k, np.clip(fractions, 0, 1)) / k


def _grid(n: int) -> np.ndarray:
    """Return the sample points of the unit square, shape (2, (n SUBSAMPLES)²)."""
    c = (np.arange(n * SUBSAMPLES) + 0.5) / (n * SUBSAMPLES)
    y, x = np.meshgrid(c, c, indexing="ij")
    return np.stack([x.ravel(), y.ravel()])


def _cells(values: np.ndarray, n: int) -> np.ndarray:
    """Average samples over each cell."""
    s = SUBSAMPLES
    return values.reshape(-1, n, s, n, s).mean((2, 4)).reshape(len(values), n * n)


def _regions(rng, labels: np.ndarray, n: int, region: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw the V and S regions of patterns with the given labels, shape (len(labels), samples), as 0 or 1."""
    m = len(labels)
    areas = np.zeros((m, 3))  # of V, B, S
    u, thirds = rng.random(m), rng.dirichlet((1, 1, 1), m)

    # Two-region labels share the square between two, the last label among three
    trace = TRACE * u * (rng.random(m) < 0.5)
    wide = region + (1 - 2 * region) * u
    solid = SOLID + (1 - 2 * SOLID) * u
    for label, (first, second), share in (
        (C.FULLY_VISIBLE, "BV", trace),
        (C.INVISIBLE, "VB", trace),
        (C.PARTIAL_SOLID, "BV", solid),
        (C.FULL_SEE_THROUGH, "VS", 0 * u),
        (C.PARTIAL_SEE_THROUGH, "VS", wide),
        (C.FULL_SOLID_SEE_THROUGH, "BS", wide),
    ):
        here = labels == label
        areas[here, "VBS".index(first)] = share[here]
        areas[here, "VBS".index(second)] = 1 - share[here]
    three = labels == C.PARTIAL_SOLID_SEE_THROUGH
    areas[three] = region + (1 - 3 * region) * thirds[three]

    # Cut the regions out of the square in random order; whatever is left is the last one
    points = _grid(n)
    order = rng.permuted(np.tile(np.arange(3), (m, 1)), axis=1)
    first, second = (np.take_along_axis(areas, order[:, i : i + 1], 1)[:, 0] for i in range(2))
    one = _cut(_shapes(rng, points, first), first)
    two = _cut(np.where(one, np.inf, _shapes(rng, points, second)), second) & ~one
    which = np.where(one, order[:, :1], np.where(two, order[:, 1:2], order[:, 2:]))
    return (which == 0).astype(np.float64), (which == 2).astype(np.float64)


def _cut(distance: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the ``area`` share of samples with the smallest distance, per pattern."""
    rank = np.rint(area * distance.shape[1]).astype(int)
    bound = np.take_along_axis(np.sort(distance, axis=1), np.maximum(rank - 1, 0)[:, None], 1)
    return (distance <= bound) & (rank > 0)[:, None]


def _shapes(rng, points: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return a random function per pattern whose sublevel sets are regions of one shape.

    Shapes 0 to 3, half-planes, corners, discs and rectangles, enter from the border; 4 is a band
    through the middle. Discs and rectangles lie around a point of the border: an island inside a
    4×4 grid would leave a frame narrower than a cell around it.
    """
    m = len(area)
    x, y = points[:, None, :]
    angle = rng.random((m, 1)) * 2 * np.pi
    cos, sin = np.cos(angle), np.sin(angle)
    aspect = np.exp(rng.uniform(-0.5, 0.5, (m, 1)))

    # Relative to a point of the border; sublevel sets of the first two would be the same for any other point
    along, side = rng.random((m, 1)), rng.integers(0, 4, (m, 1))
    cx, cy = np.choose(side, [along, 1, along, 0]), np.choose(side, [0, along, 1, along])
    u, v = (x - cx) * cos + (y - cy) * sin, (y - cy) * cos - (x - cx) * sin
    rectangle = np.maximum(np.abs(u) * aspect, np.abs(v))
    band = np.abs((x - 0.5) * cos + (y - 0.5) * sin + rng.uniform(-0.05, 0.05, (m, 1)))
    kinds = np.stack([u, np.maximum(u, v * aspect), np.hypot(u, v), rectangle, band])

    # Small regions are cut off straight; a band and what it leaves are wide
    small, wide = np.minimum(area, 1 - area) < REGION - 1e-9, np.abs(area - 0.45) < 0.1
    kind = rng.integers(0, np.where(small, 2, np.where(wide, 5, 4)))
    distance = kinds[kind, np.arange(m)]
    return np.where(rng.random((m, 1)) < 0.5, -distance, distance)


def _textures(rng, m: int, n: int) -> np.ndarray:
    """Return see-through blockers' transmission at every sample, shape (m, samples).

    Half of them are a random mid-gray a cell (§3.2), a quarter bars and a quarter leaves.
    """
    x, y = _grid(n)[:, None, :] * n
    mean, spread = rng.uniform(0.3, 0.7, (m, 1)), rng.uniform(0, 0.3, (m, 1))
    cell = (np.floor(y) * n + np.floor(x)).astype(int)[0]
    gray = np.clip(mean + spread * rng.uniform(-1, 1, (m, n * n)), 0.2, 0.8)[:, cell]

    # Bars with a period up to a cell, at any angle
    angle, shift = rng.random((m, 1)) * 2 * np.pi, rng.random((m, 2, 1))
    u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    bars = (u / rng.uniform(0.25, 1, (m, 1)) + shift[:, 0]) % 1 < mean

    # Leaves: a rotated lattice whose squares are open or closed at random
    size = rng.uniform(0.15, 0.4, (m, 1))
    lattice = rng.random((m, 64 * 64))
    row, column = (np.floor(w / size + s).astype(int) % 64 for w, s in ((u, shift[:, 0]), (v, shift[:, 1])))
    leaves = np.take_along_axis(lattice, row * 64 + column, 1) < mean

    kind = rng.integers(0, 4, (m, 1))
    return np.where(kind < 2, gray, np.where(kind == 2, bars, leaves))
