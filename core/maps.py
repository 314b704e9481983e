"""Colours for what is measured at every pixel: a visibility class, or a number."""

from __future__ import annotations

import numpy as np

# One colour a visibility configuration, in the classes' order, told apart by colour-blind eyes too (after
# Okabe and Ito); linear RGB from sRGB bytes. Decided classes are light and dark grey, undecided ones colours.
_CLASSES = (
    (235, 235, 235),  # fully visible
    (40, 40, 40),  # invisible
    (0, 114, 178),  # partial solid
    (240, 228, 66),  # full see-through
    (230, 159, 0),  # partial see-through
    (0, 158, 115),  # full solid + see-through
    (204, 51, 90),  # partial solid + see-through
)

# Black over purple and orange to white: brightness grows all along.
_HEAT = ((0, 0, 0), (60, 10, 100), (170, 40, 90), (240, 120, 30), (250, 210, 90), (255, 255, 230))


def class_colours(classes: np.ndarray) -> np.ndarray:
    """Return a picture of visibility classes.

    Parameters
    ----------
    classes : ndarray, shape (H, W)
        Class numbers 0 … 6; fractions (from a reconstruction filter) are rounded, others are black.

    Returns
    -------
    ndarray, shape (H, W, 3)
        Linear RGB.
    """
    palette = np.vstack([_linear(_CLASSES), np.zeros((1, 3))])
    number = np.rint(np.nan_to_num(np.asarray(classes, dtype=np.float64), nan=-1.0))
    valid = (number >= 0) & (number < len(_CLASSES))
    return palette[np.where(valid, number, len(_CLASSES)).astype(int)]


def heat(values: np.ndarray) -> np.ndarray:
    """Return a picture of numbers in [0, 1], from black to white.

    Parameters
    ----------
    values : ndarray, shape (H, W)
        Clipped to [0, 1]; NaN is black.

    Returns
    -------
    ndarray, shape (H, W, 3)
        Linear RGB.
    """
    t = np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.0), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_HEAT))
    # Interpolated in sRGB, where equal steps look equal.
    return _linear(np.stack([np.interp(t, stops, [c[i] for c in _HEAT]) for i in range(3)], axis=-1))


def _linear(srgb_bytes: object) -> np.ndarray:
    """Return sRGB values of 0 … 255 as linear RGB."""
    s = np.asarray(srgb_bytes, dtype=np.float64) / 255.0
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)
