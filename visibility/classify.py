"""Visibility configurations from fractional visibilities: the functions other parts of the project call."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from . import weights
from .batch import cluster_features, grid_features
from .features import features, grid_positions


def classify(fractions, positions=None, classifier: str = "mlp") -> np.ndarray:
    """Classify how a point sees an object (or light, or patch) cut into clusters (§3, §4).

    Parameters
    ----------
    fractions : array_like, shape (..., N)
        Fractional visibility of N clusters in [0, 1]. NaN marks a culled cluster: it gives no
        information.
    positions : array_like, shape (N, 2) or (..., N, 2), optional
        Cluster centres on the image plane, any unit. Without them the clusters are the cells of a
        square grid, row by row.
    classifier : {'mlp', 'svm', 'threshold'}
        How to classify.

    Returns
    -------
    ndarray, shape (...), int64
        `VisibilityClass` values.

    Raises
    ------
    InputError
        If shapes do not match, a fraction is outside [0, 1], a position is not finite, all clusters
        are culled, or there is no such classifier.

    Examples
    --------
    >>> from intervis.visibility import VisibilityClass, classify
    >>> VisibilityClass(int(classify([1, 1, 0, 0] * 4))).name
    'PARTIAL_SOLID'
    """
    f = _floats(fractions, "fractions")
    if f.ndim < 1 or f.shape[-1] < 1:
        raise InputError(f"'fractions' must have shape (..., N) with N >= 1 (got shape {f.shape})")
    n = f.shape[-1]
    side = round(n**0.5)
    if positions is None:
        if side * side != n:
            raise InputError(f"'positions' must be given unless the clusters are a square grid (got {n} clusters)")
        p = grid_positions(side)
    else:
        p = _floats(positions, "positions", np.float64)
        if p.ndim < 2 or p.shape[-1] != 2 or p.shape[-2] != n or (p.ndim > 2 and p.shape[:-2] != f.shape[:-1]):
            raise InputError(f"'positions' must have shape ({n}, 2) or {(*f.shape, 2)} (got {p.shape})")
        if not np.isfinite(p).all():
            raise InputError("'positions' must be finite; mark culled clusters by NaN in 'fractions' instead")
    culled = np.isnan(f)
    wrong = ~culled & ~((f >= 0) & (f <= 1))
    if wrong.any():
        raise InputError(f"'fractions' must be in [0, 1], or NaN for culled clusters (got {f[wrong][0]:g})")
    if culled.all(-1).any():
        raise InputError("'fractions' must have at least one cluster that is not culled (got NaN for all of them)")
    return weights.load(classifier, side).predict(features(f, p, weights.LEVELS))


def classify_grid(cells: list, classifier: str = "mlp"):
    """Classify a light cut into n×n cells, for all lanes at once; may be traced into a larger kernel (§5.2).

    Parameters
    ----------
    cells : list of n² Dr.Jit floats
        Fraction of each cell that is visible, in [0, 1], row by row. Not checked: that would need
        an evaluation.
    classifier : {'mlp', 'svm', 'threshold'}
        How to classify.

    Returns
    -------
    Dr.Jit UInt32
        `VisibilityClass` values.

    Raises
    ------
    InputError
        If the number of cells is not a square above 1, or there is no such classifier.
    """
    side = round(len(cells) ** 0.5)
    if side * side != len(cells) or side < 2:
        raise InputError(f"'cells' must hold n×n fractions with n >= 2 (got {len(cells)})")
    return weights.load(classifier, side).classify(grid_features(cells, weights.LEVELS))


def classify_clusters(fractions: list, positions: list, classifier: str = "mlp", valid: list | None = None):
    """Classify clusters at any positions, for all lanes at once (§4.3).

    Parameters
    ----------
    fractions : list of N Dr.Jit floats
        Fractional visibility of each cluster in [0, 1].
    positions : list of N pairs (x, y)
        Cluster centres: Python floats where all lanes share them, Dr.Jit floats where each lane has
        its own.
    classifier : {'mlp', 'svm', 'threshold'}
        How to classify.
    valid : list of N Dr.Jit masks, optional
        False for culled clusters.

    Returns
    -------
    Dr.Jit UInt32
        `VisibilityClass` values.

    Raises
    ------
    InputError
        If the lengths differ, there are no clusters, or there is no such classifier.
    """
    if not fractions or len(positions) != len(fractions) or (valid is not None and len(valid) != len(fractions)):
        raise InputError(f"'positions' must hold one (x, y) for each of {len(fractions)} clusters (got {len(positions)})")
    side = round(len(fractions) ** 0.5)
    return weights.load(classifier, side).classify(cluster_features(fractions, positions, weights.LEVELS, valid))


def _floats(values, name: str, dtype=np.float32) -> np.ndarray:
    """Return ``values`` as an array of floats, or say that they are not numbers."""
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError) as error:
        raise InputError(f"'{name}' must be an array of numbers (got {type(values).__name__})") from error
