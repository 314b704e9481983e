"""Histogram and co-occurrence features of fractional visibility, as a NumPy reference (§3.1, §4.3).

Everything here is float32 and built from comparisons and integer counts, so that the Dr.Jit
versions in `batch` give the same bits.
"""

from __future__ import annotations

import numpy as np

TOLERANCE = 0.2
"""Two clusters are neighbours when their distance is within this share of Δ₁ of Δ₁ (§4.3)."""


def feature_count(levels: int = 4) -> int:
    """Return G + (G² + G)/2, the number of features for ``levels`` = G gray levels."""
    return levels + (levels * levels + levels) // 2


def thresholds(levels: int = 4) -> np.ndarray:
    """Return the ``levels - 1`` fractions at which the next gray level begins.

    They are spread evenly from 1/(2G) to 1 - 1/(2G): black and white are the narrow levels, as they
    claim that a cluster is decided. Ties go towards the middle (a hair of 1e-4 makes that certain
    in float32), because with few rays they are common: one blocked ray in eight makes a cluster
    gray, as does one seen.

    Returns
    -------
    ndarray, shape (levels - 1,), float32
    """
    t = np.linspace(1 / (2 * levels), 1 - 1 / (2 * levels), levels - 1) if levels > 2 else np.array([0.5])
    return np.where(t < 0.5, t * (1 - 1e-4), np.where(t > 0.5, 1 - (1 - t) * (1 - 1e-4), t)).astype(np.float32)


def quantize(fractions, levels: int = 4) -> np.ndarray:
    """Quantise fractional visibility to gray levels (§4.2).

    Parameters
    ----------
    fractions : array_like
        Fractions in [0, 1]; NaN gives level 0, callers mask it.
    levels : int
        Number of gray levels G >= 2.

    Returns
    -------
    ndarray of int64
        Levels 0 (occluded) … levels - 1 (visible), in the shape of ``fractions``.
    """
    f = np.asarray(fractions, np.float32)
    return sum((f >= t).astype(np.int64) for t in thresholds(levels))


def neighbor_distance(positions, valid=None) -> np.ndarray:
    """Return Δ₁, the mean distance of a cluster to its nearest other cluster (§4.3, Eq. 4).

    Parameters
    ----------
    positions : array_like, shape (..., N, 2)
        Cluster centres in a plane, any unit.
    valid : array_like of bool, shape (..., N), optional
        False for culled clusters, which take no part.

    Returns
    -------
    ndarray, shape (...), float32
        Zero where fewer than two clusters are valid.
    """
    distance = _distances(positions)
    n = distance.shape[-1]
    valid = np.ones(distance.shape[:-1], bool) if valid is None else np.asarray(valid, bool)
    usable = valid[..., :, None] & valid[..., None, :] & ~np.eye(n, dtype=bool)
    nearest = np.where(usable, distance, np.float32(np.inf)).min(-1)

    # The sum runs in index order in float32, as the batch version does
    usable, nearest = np.broadcast_arrays(np.isfinite(nearest), nearest)
    total = np.zeros(nearest.shape[:-1], np.float32)
    for i in range(n):
        total = total + np.where(usable[..., i], nearest[..., i], np.float32(0))
    return total / np.maximum(usable.sum(-1), 1).astype(np.float32)


def neighbors(positions, valid=None) -> np.ndarray:
    """Return which pairs of clusters are neighbours: | ‖x - y‖ - Δ₁ | < 0.2 Δ₁ (§4.3).

    The paper's ε is "20 percent of the cluster image space diameter", and Δ₁ is "roughly equal to
    the mean cluster diameter", hence ε = 0.2 Δ₁.

    Returns
    -------
    ndarray of bool, shape (..., N, N)
        Symmetric, false on the diagonal and wherever a culled cluster takes part.
    """
    distance = _distances(positions)
    n = distance.shape[-1]
    delta = neighbor_distance(positions, valid)[..., None, None]
    near = (np.abs(distance - delta) < np.float32(TOLERANCE) * delta) & ~np.eye(n, dtype=bool)
    if valid is not None:
        valid = np.asarray(valid, bool)
        near = near & valid[..., :, None] & valid[..., None, :]
    return near


def co_occurrence(fractions, positions, levels: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Count gray levels and pairs of gray levels of neighbouring clusters: P₀ and P_Δ₁ (§3.1, Eq. 2).

    Parameters
    ----------
    fractions : array_like, shape (..., N)
        Fractional visibility in [0, 1]; NaN marks a culled cluster, which gives no information.
    positions : array_like, shape (N, 2) or (..., N, 2)
        Cluster centres.
    levels : int
        Gray levels G.

    Returns
    -------
    histogram : ndarray, shape (..., levels), int64
        The diagonal of P₀.
    matrix : ndarray, shape (..., levels, levels), int64
        P_Δ₁, symmetric. As Eq. 2 runs over ordered pairs, a pair of equal levels counts twice on
        the diagonal.
    """
    f = np.asarray(fractions, np.float32)
    valid = ~np.isnan(f)
    near = neighbors(positions, None if valid.all() else valid)

    # Counts as products of 0/1 matrices: exact in float32 up to 2²⁴
    onehot = ((quantize(f, levels)[..., None] == np.arange(levels)) & valid[..., None]).astype(np.float32)
    matrix = np.swapaxes(onehot, -1, -2) @ (near.astype(np.float32) @ onehot)
    return onehot.sum(-2).astype(np.int64), matrix.astype(np.int64)


def features(fractions, positions, levels: int = 4) -> np.ndarray:
    """Return the classification features: G of the histogram, then (G² + G)/2 of P_Δ₁ (§3.1, §3.2).

    Parameters
    ----------
    fractions : array_like, shape (..., N)
        Fractional visibility of N clusters in [0, 1]; NaN marks a culled cluster.
    positions : array_like, shape (N, 2) or (..., N, 2)
        Cluster centres in the plane.
    levels : int
        Gray levels G.

    Returns
    -------
    ndarray, shape (..., G + (G² + G)/2), float32
        Shares in [0, 1]: of the clusters in each level, then of the neighbour pairs in each pair of
        levels, row by row of the upper triangle: (0, 0), (0, 1), …, (G-1, G-1). Each of the two
        parts sums to one, or is all zero where there is nothing to count.

    Examples
    --------
    >>> features([0.0, 0.0, 1.0], [(0, 0), (1, 0), (2, 0)], levels=2).tolist()
    [0.6666666865348816, 0.3333333432674408, 0.5, 0.5, 0.0]
    """
    histogram, matrix = co_occurrence(fractions, positions, levels)
    rows, columns = np.triu_indices(levels)
    pairs = matrix[..., rows, columns] // np.where(rows == columns, 2, 1)
    return np.concatenate([_shares(histogram), _shares(pairs)], axis=-1)


def grid_positions(n: int = 4) -> np.ndarray:
    """Return the cell centres of an ``n × n`` grid on the unit square, row by row.

    Returns
    -------
    ndarray, shape (n², 2), float32
    """
    c = (np.arange(n, dtype=np.float32) + np.float32(0.5)) / np.float32(n)
    y, x = np.meshgrid(c, c, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], -1)


def _shares(counts: np.ndarray) -> np.ndarray:
    """Divide counts by their sum, as float32 in the order of the batch version."""
    scale = np.float32(1) / np.maximum(counts.sum(-1, keepdims=True), 1).astype(np.float32)
    return counts.astype(np.float32) * scale


def _distances(positions) -> np.ndarray:
    """Return all pairwise distances, shape (..., N, N), as float32.

    Double precision stays double until the difference is taken: positions far from the origin keep
    their pattern.
    """
    p = np.asarray(positions)
    p = p if p.dtype == np.float32 else p.astype(np.float64)
    d = p[..., :, None, :] - p[..., None, :, :]
    return np.sqrt(d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]).astype(np.float32)
