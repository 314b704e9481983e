"""What a visibility class *is*: labels of dense visibility maps, independent of features and classifiers.

The paper: features of a blocker larger than a cluster are solid, "roughly equal-sized or smaller
features […] are detected as see-through" (§5.1.1). A morphological opening says the same in pixels:
what a disc a little wider than a cluster can reach without leaving the blocked (or the visible)
part is solid; the rest is see-through structure.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from .classes import VisibilityClass as C

DIAMETER = 1.25
"""Diameter of the probing disc, in cells."""

TRACE = 1 / 32
"""A light with less than this share blocked (or visible) counts as fully visible (or invisible)."""

REGION = 0.1
"""A see-through, solid blocked or solid visible region is present from this share of the light."""


def region_areas(dense: np.ndarray, n: int = 4) -> tuple[float, float, float]:
    """Split a dense visibility map into solid visible, solid blocked and see-through shares.

    Parameters
    ----------
    dense : ndarray of bool, shape (R, R)
        True where the light is seen. Beyond the border the map continues as at the border.
    n : int
        Cells an axis that the light will be cut into.

    Returns
    -------
    visible, blocked, see_through : float
        Shares of the light; they sum to one.
    """
    size = dense.shape[0]
    radius = DIAMETER / 2 * size / n
    pad = int(np.ceil(2 * radius)) + 1
    wide = np.pad(np.asarray(dense, bool), pad, mode="edge")
    inner = np.s_[pad:-pad, pad:-pad]
    visible = _opening(wide, radius)[inner].mean()
    blocked = _opening(~wide, radius)[inner].mean()
    return float(visible), float(blocked), float(1 - visible - blocked)


def label(dense: np.ndarray, n: int = 4) -> tuple[C, bool]:
    """Name the visibility configuration of a dense visibility map.

    Parameters
    ----------
    dense : ndarray of bool, shape (R, R)
        True where the light is seen.
    n : int
        Cells an axis that the light will be cut into.

    Returns
    -------
    label : VisibilityClass
    clear : bool
        False for borderline maps: some region's share is within a factor of two of the threshold
        that decided.
    """
    seen = float(np.mean(dense))
    rest = min(seen, 1 - seen)
    if rest < TRACE:
        return (C.FULLY_VISIBLE if seen > 0.5 else C.INVISIBLE), rest < TRACE / 2
    shares = region_areas(dense, n)
    visible, blocked, see_through = (s >= REGION for s in shares)
    clear = not any(REGION / 2 <= s < REGION * 2 for s in shares)
    if not see_through:
        # Only the see-through share decided here; a solid edge may be anywhere
        return C.PARTIAL_SOLID, rest >= 2 * TRACE and shares[2] < REGION / 2
    if visible:
        return (C.PARTIAL_SOLID_SEE_THROUGH if blocked else C.PARTIAL_SEE_THROUGH), clear
    return (C.FULL_SOLID_SEE_THROUGH if blocked else C.FULL_SEE_THROUGH), clear


def _opening(mask: np.ndarray, radius: float) -> np.ndarray:
    """Return the union of all discs of the given radius that fit into the mask."""
    if mask.all() or not mask.any():
        return mask
    centers = distance_transform_edt(mask) > radius
    if not centers.any():
        return centers
    return distance_transform_edt(~centers) <= radius
