"""Checks of parameters: one sentence that says what is wrong with the value and what would be right."""

from __future__ import annotations

import numpy as np

from ..errors import InputError

UNKNOWN = 1e15  # m; what is beyond is no height


def choice(name: str, value, allowed):
    """Return ``value`` if it is one of ``allowed``."""
    if value not in allowed:
        raise InputError(f"'{name}' must be one of {', '.join(allowed)} (got {value!r})")
    return value


def number(name: str, value, low=-np.inf, high=np.inf, *, open_low=False, whole=False) -> float:
    """Return ``value`` as a float if it is a finite number in [low, high]."""
    try:
        v = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"'{name}' must be a number (got {value!r})") from None
    if not np.isfinite(v) or v < low or v > high or (open_low and v <= low) or (whole and v != int(v)):
        kind = "a whole number" if whole else "a finite number"
        bound = "" if low == -np.inf else f" {'>' if open_low else '>='} {low:g}"
        bound += "" if high == np.inf else f"{' and' if bound else ''} <= {high:g}"
        raise InputError(f"'{name}' must be {kind}{bound} (got {value!r})")
    return v


def spacing_of(spacing) -> tuple[float, float]:
    """Return (dy, dx) from a number or a pair."""
    try:
        values = np.ravel(spacing).tolist()
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise InputError(f"'spacing' must be one number or two, (dy, dx), in metres (got {spacing!r})")
    pair = [number("spacing", v, 1e-12, 1e12) for v in values]
    return pair[0], pair[-1]


def reals(name: str, values) -> np.ndarray:
    """Return numbers as a float64 array of any shape."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"'{name}' must hold real numbers (got {values!r:.60})") from None


def grid(name: str, values) -> np.ndarray:
    """Return a real two-dimensional array, not empty, as float64 in native order; masked points become NaN.

    So does what is beyond ±1e15: no height, but how many rasters write "unknown".
    """
    masked = isinstance(values, np.ma.MaskedArray)
    try:
        array = np.ma.filled(values.astype(np.float64), np.nan) if masked else np.asarray(values)
    except ValueError:
        raise InputError(f"'{name}' must have rows of equal length (got {type(values).__name__} of unequal ones)") from None
    if array.ndim != 2 or 0 in array.shape:
        raise InputError(f"'{name}' must be a two-dimensional array of rows and columns (got shape {array.shape})")
    if array.dtype.kind not in "fiub":
        raise InputError(f"'{name}' must hold real numbers (got dtype {array.dtype})")
    out = np.array(array, dtype=np.float64, order="C")
    with np.errstate(invalid="ignore"):
        out[~(np.abs(out) <= UNKNOWN)] = np.nan
    return out
