"""The visibility configurations that everything else speaks about (§1, Fig. 1), their names and colours."""

from __future__ import annotations

from enum import IntEnum


class VisibilityClass(IntEnum):
    """How a point sees a light or an object (Fig. 1); the values are what class maps store.

    "Solid" occluders and openings are larger than a cluster, "see-through" ones are as small or
    smaller: grating, fence, foliage. "Full" and "partial" say whether some part of the object is
    seen without any occluder.
    """

    FULLY_VISIBLE = 0
    INVISIBLE = 1
    PARTIAL_SOLID = 2
    FULL_SEE_THROUGH = 3
    PARTIAL_SEE_THROUGH = 4
    FULL_SOLID_SEE_THROUGH = 5
    PARTIAL_SOLID_SEE_THROUGH = 6


NAMES = (
    "fully visible",
    "invisible",
    "partial solid",
    "full see-through",
    "partial see-through",
    "full solid + see-through",
    "partial solid + see-through",
)
"""Readable names, by class value."""

COLORS = (
    (0.96, 0.93, 0.78),
    (0.10, 0.10, 0.14),
    (0.13, 0.47, 0.71),
    (0.84, 0.15, 0.16),
    (1.00, 0.60, 0.33),
    (0.48, 0.25, 0.60),
    (0.17, 0.63, 0.37),
)
"""sRGB colours in [0, 1] for class maps, by class value."""

GROUPS = (0, 1, 2, 3, 3, 3, 3)
"""What an integrator acts on: 0 fully visible, 1 invisible, 2 solid edge, 3 anything see-through."""
