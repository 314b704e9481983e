"""Differences between two images, each as one number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .errors import InputError
from .images import srgb


def relmse(image: np.ndarray, reference: np.ndarray) -> float:
    """Return the relative mean squared error, mean((x − ref)² / (ref² + 0.01)) over pixels and channels.

    Parameters
    ----------
    image, reference : ndarray, shape (H, W) or (H, W, C)
        Linear radiance.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If the shapes differ, or either image holds NaN or infinity.
    """
    x, ref = _pair(image, reference)
    return float(np.mean((x - ref) ** 2 / (ref**2 + 0.01)))


def mse(image: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean squared error over pixels and channels; arguments and errors as in `relmse`."""
    x, ref = _pair(image, reference)
    return float(np.mean((x - ref) ** 2))


def mae(image: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean absolute error over pixels and channels; arguments and errors as in `relmse`."""
    x, ref = _pair(image, reference)
    return float(np.mean(np.abs(x - ref)))


def psnr(image: np.ndarray, reference: np.ndarray) -> float:
    """Return the peak signal-to-noise ratio in dB for a peak of 1, infinite for equal images.

    It is 10 log10(1 / mse) of the linear values as given: nothing is clipped or scaled. Arguments and
    errors as in `relmse`.
    """
    error = mse(image, reference)
    return float("inf") if error == 0.0 else float(-10.0 * np.log10(error))


def flip(image: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean LDR-FLIP difference, in [0, 1], as an eye sees it at 67 pixels a degree.

    Both images are clipped to [0, 1] and encoded as sRGB at a fixed exposure, as `write_png` does, so the
    number is about the pictures that a viewer shows; it does not see differences in what is beyond white.

    Parameters
    ----------
    image, reference : ndarray, shape (H, W) or (H, W, 3)
        Linear radiance, 1 is white.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If the shapes differ or have another number of channels, or either holds NaN or infinity.

    References
    ----------
    Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020.
    """
    return float(flip_map(image, reference).mean())


def flip_map(image: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the LDR-FLIP difference of every pixel, shape (H, W), in [0, 1]; arguments as in `flip`."""
    import flip_evaluator

    x, ref = (a if a.ndim == 3 else np.repeat(a[..., None], 3, axis=2) for a in _pair(image, reference))
    if x.shape[2] != 3:
        raise InputError(f"'image' must have 1 or 3 channels for FLIP (got {x.shape[2]})")
    error, _, _ = flip_evaluator.evaluate(srgb(ref), srgb(x), "LDR", inputsRGB=True, applyMagma=False)
    return np.asarray(error).reshape(x.shape[:2])


METRICS: dict[str, Callable[[np.ndarray, np.ndarray], float]] = {
    f.__name__: f for f in (relmse, mse, mae, psnr, flip)
}


def _pair(image: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both images in float64, or raise `InputError` if they cannot be compared."""
    pair = []
    for name, array in (("image", image), ("reference", reference)):
        pixels = np.asarray(array, dtype=np.float64)
        if pixels.ndim not in (2, 3) or pixels.size == 0:
            raise InputError(f"'{name}' must have shape (H, W) or (H, W, C) (got {pixels.shape})")
        bad = np.argwhere(~np.isfinite(pixels))
        if len(bad):
            raise InputError(
                f"'{name}' must be finite (got {len(bad)} NaN or infinite values, "
                f"the first at row {bad[0][0]}, column {bad[0][1]})"
            )
        pair.append(pixels)
    if pair[0].shape != pair[1].shape:
        raise InputError(
            f"'image' and 'reference' must have the same size and channels "
            f"(got {pair[0].shape} and {pair[1].shape})"
        )
    return pair[0], pair[1]
