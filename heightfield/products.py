"""Results written where people look for them: OpenEXR layers, GeoTIFF bands, NumPy archives, a preview."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..images import _write_whole, write_exr, write_png


def layers_of(products: dict[str, np.ndarray], azimuths: np.ndarray) -> dict[str, np.ndarray]:
    """Return products as named two- or three-channel layers; horizons become one layer an azimuth."""
    out = {}
    for name, values in products.items():
        if name == "horizons":
            # Tenths of a degree tell any two azimuths of a sensible count apart
            out |= {f"horizons.{np.degrees(az):05.1f}": h for az, h in zip(azimuths, values, strict=False)}
        elif values.ndim == 3 and values.shape[2] == 1:
            out[name] = values[..., 0]
        elif values.ndim == 3 and values.shape[2] != 3:
            out |= {f"{name}.{c}": values[..., c] for c in range(values.shape[2])}
        else:
            out[name] = values
    return out


def write(path: Path, products: dict, azimuths: np.ndarray, header: dict, georeference) -> None:
    """Write products to ``path``: .exr, .tif (bands of the same names) or .npz.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix == ".exr":
        write_exr(path, layers_of(products, azimuths), header)
    elif suffix == ".npz":
        arrays = {**products, **({"azimuths": azimuths[: len(products["horizons"])]} if "horizons" in products else {})}
        _write_whole(path, lambda temporary: np.savez_compressed(temporary, **arrays))
    else:
        _write_whole(path, lambda temporary: _geotiff(temporary, layers_of(products, azimuths), header, georeference or {}))


def _geotiff(path: str, layers: dict[str, np.ndarray], header: dict, georeference: dict) -> None:
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
    flip = -1 if georeference.get("flipped") else 1
    where = {k: georeference[k] for k in ("crs", "transform") if georeference.get(k) is not None}
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": len(bands), "dtype": "float32"}
    with rasterio.open(path, "w", **profile, **where, nodata=np.nan, compress="deflate") as file:
        file.update_tags(**{k: str(v) for k, v in header.items()})
        for i, (name, values) in enumerate(bands, start=1):
            file.write(np.ascontiguousarray(values[::flip], dtype=np.float32), i)
            file.set_band_description(i, name)


def write_preview(path: Path, products: dict[str, np.ndarray]) -> None:
    """Write the first of irradiance, sky view, shadow and horizons as an sRGB picture; unknown points are black."""
    name = next(n for n in ("irradiance", "skyview", "shadow", "horizons") if n in products)
    values = np.asarray(products[name], dtype=np.float64)
    if name == "horizons":
        values = values.mean(0) / (np.pi / 4)
    if values.ndim == 2:
        values = values[..., None]
    known = values[np.isfinite(values)]
    if name == "irradiance" and known.size:
        values = 0.8 * values / max(np.percentile(known, 99), 1e-30)
    values = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    write_png(path, np.nan_to_num(values))
