"""Height maps from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError

KINDS = (".tif", ".tiff", ".npz", ".npy", ".exr", ".png")


def read(path: Path):
    """Read heights, what the file says of them, and its georeference.

    Parameters
    ----------
    path : Path
        .tif (with the extra ``geo``), .npz (``heights`` or ``elevation``, and ``spacing``), .npy, .exr (first channel) or
        .png (grey, 8 or 16 bits: heights are the pixels' numbers).

    Returns
    -------
    heights : (rows, columns) array
    options : dict
        ``spacing`` and ``nodata``, where the file has them.
    georeference : dict or None
    """
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        raise InputError(f"'{path}' must end in one of {', '.join(KINDS)}")
    if not path.is_file():
        raise InputError(f"'{path}' does not exist: give the path of a height map")
    readers = {".npz": _npz, ".npy": _npy, ".exr": _exr, ".png": _png}
    try:
        return readers.get(suffix, _tif)(path)
    except InputError:
        raise
    except Exception as e:
        first = (str(e).splitlines() or [type(e).__name__])[0]
        raise InputError(f"'{path}' cannot be read as a height map: {first}") from e


def _npy(path):
    return np.load(path, allow_pickle=False), {}, None


def _npz(path):
    with np.load(path, allow_pickle=False) as data:
        name = next((n for n in ("heights", "elevation", "dem", "z") if n in data), None)
        name = name or next((n for n in data if data[n].ndim == 2), None)
        if name is None:
            raise InputError(
                f"'{path}' must hold a two-dimensional array called 'heights' (got {', '.join(data) or 'nothing'})"
            )
        found = {k: data[k].tolist() for k in ("spacing", "nodata") if k in data}
        return data[name], found, None


def _exr(path):
    from ..images import read_exr

    layers, _ = read_exr(path)
    name = next((n for n in ("heights", "Y", "Z", "rgb", *layers) if n in layers), None)
    values = layers[name]
    return (values[..., 0] if values.ndim == 3 else values), {}, None


def _png(path):
    import mitsuba as mi

    values = np.array(mi.Bitmap(str(path)))
    if values.ndim == 3 and values.shape[2] > 1 and np.ptp(values[..., :3], axis=2).any():
        raise InputError(f"'{path}' must be a grey image (got one with colours)")
    return (values[..., 0] if values.ndim == 3 else values), {}, None


def _tif(path):
    try:
        import rasterio
    except ImportError:
        raise InputError(f"'{path}' needs rasterio to be read: install it with `pip install intervis[geo]`") from None
    from .fields import metres

    with rasterio.open(path) as file:
        values = file.read(1, masked=True)
        dx, dy = abs(file.transform.a), abs(file.transform.e)
        georeference = {"crs": file.crs, "transform": file.transform}
        if file.transform.b or file.transform.d:
            raise InputError(f"'{path}' must be north up (got a rotated raster): warp it first, with gdalwarp for example")
        if file.crs is not None and file.crs.is_geographic:
            spacing = metres(dy, dx, (file.bounds.top + file.bounds.bottom) / 2)
        else:
            factor = file.crs.linear_units_factor[1] if file.crs is not None and file.crs.is_projected else 1.0
            spacing = dy * factor, dx * factor
        # A file whose rows run from south to north
        if file.transform.e > 0:
            values = values[::-1]
            georeference["flipped"] = True
    return np.ma.filled(values.astype(np.float64), np.nan), {"spacing": spacing}, georeference


def read_map(path: Path) -> np.ndarray:
    """Read an environment map from an OpenEXR: (h, w, channels), first row straight up, columns clockwise from north."""
    from ..images import read_exr

    if not path.is_file():
        raise InputError(f"'{path}' does not exist: give the path of an environment map")
    layers, _ = read_exr(path)
    values = layers.get("rgb", layers.get("Y"))
    if values is None:
        raise InputError(f"'{path}' must have channels R, G, B or Y (got {', '.join(layers)})")
    return values if values.ndim == 3 else values[..., None]
