"""Results written where people look for them: OpenEXR layers, GeoTIFF bands, NumPy archives, a preview."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..images import _write_whole, write_exr, write_png


def layers_of(products: dict[str, np.ndarray], azimuths: np.ndarray) -> dict[str, np.ndarray]:
    """Return products as named two- or three-channel layers; horizons become one layer an azimuth."""
    out = {}
    for name, values in products.items():
        if name == "horizons":
            out |= {f"horizons.{a}": h for a, h in zip(_labels(azimuths), values, strict=False)}
        elif values.ndim == 3 and values.shape[2] == 1:
            out[name] = values[..., 0]
        elif values.ndim == 3 and values.shape[2] != 3:
            out |= {f"{name}.{c}": values[..., c] for c in range(values.shape[2])}
        else:
            out[name] = values
    return out


def _labels(azimuths):
    # Degrees, with as many places as it takes to tell all azimuths apart
    degrees = np.degrees(azimuths)
    for places in range(1, 7):
        names = [f"{a:0{places + 4}.{places}f}" for a in degrees]
        if len(set(names)) == len(names):
            break
    return names


def write(path: Path, products: dict, azimuths: np.ndarray, header: dict, spacing, georeference=None) -> None:
    """Write products to ``path``: .exr, .tif (bands of the same names) or .npz.

    Parameters
    ----------
    path : Path
    products : dict of str to array
        ``irradiance`` (rows, columns, channels), ``skyview`` and ``shadow`` (rows, columns), ``horizons`` (K, rows, columns).
    azimuths : (≥ K,) array
        Of the horizons, in radians.
    header : dict
        What made the products; in the header of an EXR, the tags of a GeoTIFF.
    spacing : (float, float)
        Metres between rows and columns; in the header as ``spacing.y`` and ``spacing.x``, in an archive as ``spacing``.
    georeference : dict, optional
        As `sources.read` returns it; without, a GeoTIFF has its north-west sample at the origin.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix == ".exr":
        dy, dx = spacing
        write_exr(path, layers_of(products, azimuths), {**header, "spacing.y": dy, "spacing.x": dx})
    elif suffix == ".npz":
        arrays = {**products, "spacing": np.asarray(spacing)}
        if "horizons" in products:
            arrays["azimuths"] = np.asarray(azimuths)[: len(products["horizons"])]
        _write_whole(path, lambda temporary: _archive(temporary, arrays))
    else:
        _write_whole(
            path, lambda temporary: _geotiff(temporary, layers_of(products, azimuths), header, spacing, georeference)
        )


def _archive(path: str, arrays: dict[str, np.ndarray]) -> None:
    # NumPy adds .npz to a name that ends in .NPZ, but not to a file
    with open(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def _geotiff(path: str, layers: dict[str, np.ndarray], header: dict, spacing, georeference) -> None:
    try:
        import rasterio
    except ImportError:
        raise InputError("'output' .tif needs rasterio: install it with `pip install intervis[geo]`") from None

    bands = []
    for name, values in layers.items():
        if values.ndim == 3:
            bands += [(f"{name}.{c}", values[..., i]) for i, c in enumerate("RGB")]
        else:
            bands.append((name, values))
    rows, columns = bands[0][1].shape
    # Samples are the pixels' centres
    dy, dx = spacing
    plain = {"crs": None, "transform": rasterio.Affine(dx, 0, -dx / 2, 0, -dy, dy / 2), "turned": (1, 1)}
    where = dict(georeference or plain)
    flip = where.pop("turned")
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": len(bands), "dtype": "float32"}
    # A file that came without a place goes without one
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(path, "w", **profile, **where, nodata=np.nan, compress="deflate", bigtiff="if_safer") as file:
            file.update_tags(**{k: str(v) for k, v in header.items()})
            for i, (name, values) in enumerate(bands, start=1):
                file.write(np.ascontiguousarray(values[:: flip[0], :: flip[1]], dtype=np.float32), i)
                file.set_band_description(i, name)


def write_preview(path: Path, products: dict[str, np.ndarray]) -> None:
    """Write the first of irradiance, sky view, shadow and horizons as an sRGB picture; unknown points are black.

    Contrast is stretched: 1 % of the points of a sky view come out near black (if less than 0.9 is seen there), 1 % of the
    mean horizons and of the irradiance near white. Shadow is shown as it is.
    """
    name = next(n for n in ("irradiance", "skyview", "shadow", "horizons") if n in products)
    values = np.asarray(products[name], dtype=np.float64)
    if name == "horizons":
        values = np.maximum(values.mean(0), 0)
    if values.ndim == 2:
        values = values[..., None]
    known = values[np.isfinite(values)]
    if name == "skyview" and known.size:
        low = min(np.percentile(known, 1), 0.9)
        values = np.clip((values - low) / (1 - low), 0.02, 1) ** 2.2
    elif name != "shadow" and known.size:
        values = 0.8 * values / max(np.percentile(known, 99), 1e-30)
    values = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    write_png(path, np.nan_to_num(values))
