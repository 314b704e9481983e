"""``intervis compare``: the difference of two OpenEXR images as a number and as a picture."""

from __future__ import annotations

import argparse

import numpy as np

from .errors import InputError
from .images import check_writable, read_exr, write_png
from .maps import heat
from .metrics import METRICS, flip_map


def command(options: argparse.Namespace) -> int:
    """Print the difference of two images; return 1 if it is above ``--fail-above``, else 0.

    Raises
    ------
    InputError
        If a file cannot be read, the images cannot be compared, or the limit makes no sense.
    """
    if options.fail_above is not None and options.metric == "psnr":
        raise InputError("'--fail-above' needs a metric that grows with the difference (got psnr): use mse")
    if options.fail_above is not None and np.isnan(options.fail_above):
        raise InputError("'--fail-above' must be a number (got nan)")
    output = None if options.output is None else check_writable(options.output, ".png")
    image, reference = picture(options.image), picture(options.reference)

    # The functions speak of 'image' and 'reference': the user knows them as files.
    try:
        value = METRICS[options.metric](image, reference)
    except InputError as error:
        text = str(error).replace("'image'", options.image).replace("'reference'", options.reference)
        raise InputError(text) from error
    print(f"{options.metric} {value:.6g}")

    if output is not None:
        write_png(output, difference(image, reference, options.metric))
    return int(options.fail_above is not None and value > options.fail_above)


def picture(path: str) -> np.ndarray:
    """Return the colours of an OpenEXR, shape (H, W, 3), or its luminance, shape (H, W)."""
    layers, _ = read_exr(path)
    for name in ("rgb", "Y"):
        if name in layers:
            return layers[name]
    if len(layers) == 1:
        return next(iter(layers.values()))
    raise InputError(f"{path}: has neither R, G, B nor Y (it has {', '.join(layers)})")


def difference(image: np.ndarray, reference: np.ndarray, metric: str) -> np.ndarray:
    """Return a picture of where two images differ, linear RGB of shape (H, W, 3).

    FLIP shows its own map; the others show |x − ref|, relative for relMSE, brightest at the 99th percentile.
    """
    if metric == "flip":
        return heat(flip_map(image, reference))
    x, ref = image.astype(np.float64), reference.astype(np.float64)
    error = np.abs(x - ref) / (np.sqrt(ref**2 + 0.01) if metric == "relmse" else 1.0)
    error = error.mean(axis=2) if error.ndim == 3 else error
    scale = np.percentile(error, 99) or error.max() or 1.0
    return heat(error / scale)
