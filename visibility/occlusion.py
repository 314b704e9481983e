"""Self-occlusion of an object's clusters, so that only occlusion by other objects is classified (§4.2)."""

from __future__ import annotations

import numpy as np

from ..errors import InputError


def disc_overlap(distance, radius: float) -> np.ndarray:
    """Return the common area of two discs of equal radius, in units of one disc's area.

    Parameters
    ----------
    distance : array_like
        Distance of the centres, in the unit of ``radius``.
    radius : float
        Radius of both discs, > 0.

    Returns
    -------
    ndarray
        In [0, 1], in the shape of ``distance``.
    """
    t = np.clip(np.asarray(distance, np.float64) / (2 * radius), 0, 1)
    return 2 / np.pi * (np.arccos(t) - t * np.sqrt(1 - t * t))


def self_visibility(positions, depths, radius: float, iterations: int = 2) -> np.ndarray:
    """Estimate the share of each cluster that the object's other clusters leave visible (§4.2, Eq. 3).

    Every cluster counts as a disc on the image plane. Each iteration subtracts from a disc what
    nearer discs cover, weighted by how visible these are themselves, so that what lies behind two
    others is not subtracted twice.

    Parameters
    ----------
    positions : array_like, shape (N, 2)
        Cluster centres on the image plane.
    depths : array_like, shape (N,)
        Distance of each cluster to the viewer; only the order matters.
    radius : float
        Disc radius in the unit of ``positions``; half of `neighbor_distance` fits the paper's
        clusters.
    iterations : int
        Number m of iterations; the paper uses 1 or 2, 3 to 4 for very concave objects.

    Returns
    -------
    ndarray, shape (N,), float64
        V_i in [0, 1].

    Raises
    ------
    InputError
        If shapes do not match, or the radius is not positive.

    Notes
    -----
    The printed Eq. 3 subtracts from V^(m-1) in every iteration, which for two overlapping discs
    would subtract the same overlap again and again. Here the sum is subtracted from V⁰ = 1, as in
    the ambient occlusion that the paper names as its model; one iteration gives the same as the
    printed form.
    """
    p, d = np.asarray(positions, np.float64), np.asarray(depths, np.float64)
    if p.ndim != 2 or p.shape[1] != 2 or d.shape != p.shape[:1]:
        raise InputError(f"'positions' must have shape (N, 2), 'depths' (N,), one a cluster (got {p.shape} and {d.shape})")
    if not radius > 0:
        raise InputError(f"'radius' must be > 0 (got {radius}): half the distance of neighbouring clusters fits")
    overlap = disc_overlap(np.linalg.norm(p[:, None] - p[None], axis=-1), radius)
    nearer = d[None, :] < d[:, None]
    visible = np.ones(len(p))
    for _ in range(iterations):
        visible = np.clip(1 - (nearer * overlap) @ visible, 0, 1)
    return visible


def correct_self_occlusion(fractions, positions, depths, radius: float, iterations: int = 2) -> np.ndarray:
    """Return cluster visibilities with the object's own occlusion taken out: v' = min(1, v / V) (§4.2).

    Parameters
    ----------
    fractions : array_like, shape (N,)
        Measured fractional visibility of each cluster.
    positions, depths, radius, iterations
        As in `self_visibility`.

    Returns
    -------
    ndarray, shape (N,), float64
        In [0, 1]; NaN, "no information", where the object hides a cluster entirely.
    """
    own = self_visibility(positions, depths, radius, iterations)
    v = np.asarray(fractions, np.float64)
    if v.shape != own.shape:
        raise InputError(f"'fractions' must have shape {own.shape}, one for each position (got {v.shape})")
    return np.where(own > 0, np.minimum(1, v / np.maximum(own, 1e-12)), np.nan)
