"""Checks of parameters: one sentence that says what is wrong with the value and what would be right."""

from __future__ import annotations

import numpy as np

from ..errors import InputError

UNKNOWN = 1e15  # m; what is beyond is no height
FARTHEST = 1e30  # m; nobody looks farther


def shown(value) -> str:
    """Return a value as one line that fits into a sentence."""
    if isinstance(value, np.ndarray) and value.size > 4:
        return f"an array of shape {value.shape}"
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def listed(value) -> bool:
    """Say whether a value is a list of something."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def choice(name: str, value, allowed):
    """Return ``value`` if it is one of the words in ``allowed``."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"'{name}' must be one of {', '.join(allowed)} (got {shown(value)})")
    return value


def watcher(progress):
    """Return ``progress`` if it is a function, or None."""
    if progress is not None and (not callable(progress) or isinstance(progress, type)):
        raise InputError(f"'progress' must be a function of (done, total) (got {shown(progress)})")
    return progress


def number(name: str, value, low=-np.inf, high=np.inf, *, open_low=False, whole=False) -> float:
    """Return ``value`` as a float if it is a finite number in [low, high]."""
    try:
        # Text is no number, nor is a masked one
        if isinstance(value, (str, bytes)) or value is np.ma.masked or np.ndim(value):
            raise TypeError
        v = float(value)
    except Exception:
        raise InputError(f"'{name}' must be a number (got {shown(value)})") from None
    if not np.isfinite(v) or v < low or v > high or (open_low and v <= low) or (whole and v != int(v)):
        kind = "a whole number" if whole else "a finite number"
        bound = "" if low == -np.inf else f" {'>' if open_low else '>='} {low:g}"
        bound += "" if high == np.inf else f"{' and' if bound else ''} <= {high:g}"
        raise InputError(f"'{name}' must be {kind}{bound} (got {shown(value)})")
    return v


def spacing_of(spacing) -> tuple[float, float]:
    """Return (dy, dx) from a number or a pair."""
    values = reals("spacing", spacing)
    if values.ndim > 1 or values.size not in (1, 2):
        raise InputError(f"'spacing' must be one number or two, (dy, dx), in metres (got {shown(spacing)})")
    pair = [number("spacing", v, 1e-12, 1e9) for v in values.ravel().tolist()]
    return pair[0], pair[-1]


def reals(name: str, values) -> np.ndarray:
    """Return real numbers as a float64 array of any shape; masked ones become NaN."""
    try:
        array = np.asanyarray(values)
        if array.dtype.kind == "O" and not any(v is None for v in array.flat):
            # Fractions, decimals and whole numbers of any size
            array = array.astype(np.float64)
        if array.dtype.kind not in "fiub":
            raise TypeError
        array = array.astype(np.float64)
        return np.ma.filled(array, np.nan) if isinstance(array, np.ma.MaskedArray) else np.asarray(array)
    except Exception:
        # Whatever an object does when it is asked for its numbers
        raise InputError(f"'{name}' must hold real numbers (got {shown(values)})") from None


def grid(name: str, values) -> np.ndarray:
    """Return a real two-dimensional array, not empty, as float64 in native order; masked points become NaN.

    So does what is beyond ±1e15: no height, but how many rasters write "unknown".
    """
    masked = isinstance(values, np.ma.MaskedArray)
    try:
        array = np.ma.filled(values.astype(np.float64), np.nan) if masked else np.asarray(values)
    except ValueError:
        raise InputError(f"'{name}' must have rows of equal length (got {type(values).__name__} of unequal ones)") from None
    except Exception:
        raise InputError(f"'{name}' must hold real numbers (got {shown(values)})") from None
    if array.ndim != 2 or 0 in array.shape:
        raise InputError(f"'{name}' must be a two-dimensional array of rows and columns (got shape {array.shape})")
    if array.dtype.kind not in "fiub":
        raise InputError(f"'{name}' must hold real numbers (got dtype {array.dtype})")
    out = np.array(array, dtype=np.float64, order="C")
    with np.errstate(invalid="ignore"):
        out[~(np.abs(out) <= UNKNOWN)] = np.nan
    return out


def known(heights: np.ndarray, nodata) -> np.ndarray:
    """Say which heights, as `grid` returns them, are known: finite ones that are not ``nodata`` (a height or None)."""
    valid = np.isfinite(heights)
    if nodata is not None:
        unknown = reals("nodata", nodata)
        if unknown.ndim:
            raise InputError(f"'nodata' must be one height (got {shown(nodata)})")
        valid &= heights != unknown
    return valid
