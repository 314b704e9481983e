"""Height maps from files."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from .check import shown

KINDS = (".tif", ".tiff", ".npz", ".npy", ".exr", ".png")
FEET = {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us survey foot": 1200 / 3937, "us-ft": 1200 / 3937}


def read(path: Path):
    """Read heights, what the file says of them, and its georeference; as `opened` returns them, but all heights."""
    heights, *what = opened(path)
    return heights[:, :] if isinstance(heights, Raster) else heights, *what


def opened(path: Path):
    """Open a file of heights, what it says of them, and its georeference.

    Parameters
    ----------
    path : Path
        .tif (one band; with the extra ``geo``), .npz (``heights``, ``elevation``, ``dem`` or ``z``, or the only
        two-dimensional array; ``spacing`` and ``nodata``), .npy, .exr (channel ``heights``, ``Y`` or ``Z``, or the only one)
        or .png (grey, 8 or 16 bits: heights are the pixels' numbers).

    Returns
    -------
    heights : (rows, columns) array or Raster
        Of a .npy and a .tif on the disk still: a part is read when it is asked for.
    options : dict
        ``spacing`` and ``nodata``, where the file has them.
    georeference : dict or None
        ``crs`` and ``transform`` of a GeoTIFF, and ``turned``, the steps that turn its rows and columns north up.

    Raises
    ------
    InputError
        If the file is missing, damaged or no height map.
    """
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        raise InputError(f"'{path}' must end in one of {', '.join(KINDS)}")
    _present(path, "a height map")
    readers = {".npz": _npz, ".npy": _npy, ".exr": _exr, ".png": _png}
    try:
        return readers.get(suffix, _tif)(path)
    except InputError:
        raise
    except Exception as e:
        first = (str(e).splitlines() or [type(e).__name__])[0]
        if "Object arrays" in first or "Python objects" in first:
            first = "it holds Python objects; save it as an array of numbers"
        raise InputError(f"'{path}' cannot be read as a height map: {first}") from e


def path_of(name: str, value) -> Path:
    """Return what names a file as a path."""
    try:
        path = Path(os.fsdecode(value))
    except TypeError:
        path = Path()
    if not path.name:
        raise InputError(f"'{name}' must be the path of a file (got {shown(value)})")
    return path


def _present(path, what):
    if not path.is_file():
        problem = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"'{path}' {problem}: give the path of {what}")


def _starts(path, *magic):
    # NumPy takes what it does not know for pickles, image readers for broken images
    with path.open("rb") as file:
        begin = file.read(8)
    if not begin.startswith(magic):
        raise InputError(f"'{path}' cannot be read as a height map: it is empty or no {path.suffix[1:]} file")


def _npy(path):
    _starts(path, b"\x93NUMPY")
    # Read from the disk where and when it is needed: it may be larger than memory
    return np.load(path, allow_pickle=False, mmap_mode="r"), {}, None


def _npz(path):
    _starts(path, b"PK")
    with np.load(path, allow_pickle=False) as data:
        name = next((n for n in ("heights", "elevation", "dem", "z") if n in data), None)
        flat = [name] if name else [n for n in data if data[n].ndim == 2]
        if len(flat) != 1:
            got = ", ".join(data) or "nothing"
            raise InputError(f"'{path}' must hold a two-dimensional array called 'heights' (got {got})")
        found = {k: data[k].tolist() for k in ("spacing", "nodata") if k in data}
        return data[flat[0]], found, None


def _exr(path):
    from ..images import read_exr

    layers, header = read_exr(path)
    name = next((n for n in ("heights", "Y", "Z") if n in layers), next(iter(layers)) if len(layers) == 1 else None)
    values = None if name is None else layers[name]
    # A grey picture may come as three equal channels
    if values is not None and values.ndim == 3 and not np.ptp(values, axis=2).any():
        values = values[..., 0]
    if values is None or values.ndim != 2:
        raise InputError(f"'{path}' must have one channel, or one called 'heights' (got {', '.join(layers)})")
    spacing = [header[f"spacing.{k}"] for k in ("y", "x") if f"spacing.{k}" in header]
    return values, {"spacing": spacing} if len(spacing) == 2 else {}, None


def _png(path):
    import mitsuba as mi

    _starts(path, b"\x89PNG")
    values = np.atleast_3d(np.array(mi.Bitmap(str(path))))
    # Two or four channels: the last is opacity
    colours = values[..., : {2: 1, 4: 3}.get(values.shape[2])]
    if (colours != colours[..., :1]).any():
        raise InputError(f"'{path}' must be a grey image (got one with colours)")
    return colours[..., 0], {}, None


def _tif(path):
    try:
        import rasterio
    except ImportError:
        raise InputError(f"'{path}' needs rasterio to be read: install it with `pip install intervis[geo]`") from None
    from .fields import metres

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(path) as file:
            if file.count != 1:
                raise InputError(f"'{path}' must have one band (got {file.count}): take one, with gdal_translate -b 1")
            if np.dtype(file.dtypes[0]).kind not in "fiu":
                raise InputError(f"'{path}' must hold real numbers (got {file.dtypes[0]})")
            t = file.transform
            if t.b or t.d:
                raise InputError(f"'{path}' must be north up (got a rotated raster): warp it, with gdalwarp for example")
            # Stored numbers become metres
            numbers = file.scales[0], file.offsets[0], FEET.get((file.units[0] or "").lower(), 1.0)
            dx, dy = abs(t.a), abs(t.e)
            if file.crs is not None and file.crs.is_geographic:
                spacing = metres(dy, dx, (file.bounds.top + file.bounds.bottom) / 2)
            else:
                factor = file.crs.linear_units_factor[1] if file.crs is not None and file.crs.is_projected else 1.0
                spacing = dy * factor, dx * factor
            # Rows may run from south to north, columns from east to west
            turned = (-1 if t.e > 0 and t != rasterio.Affine.identity() else 1, -1 if t.a < 0 else 1)
            georeference = {"crs": file.crs, "transform": t, "turned": turned}
            heights = Raster(path, file.shape, turned, *numbers)
    return heights, {"spacing": spacing}, georeference


@dataclass(frozen=True)
class Raster:
    """Heights of a GeoTIFF, read when they are asked for: ``raster[10:20, 30:50]``, north up, in metres.

    Attributes
    ----------
    path : Path
    shape : (int, int)
        Rows and columns.
    turned : (int, int)
        Steps that turn its rows and columns north up.
    scale, offset, unit : float
        That make metres of the numbers stored.
    """

    path: Path
    shape: tuple[int, int]
    turned: tuple[int, int]
    scale: float
    offset: float
    unit: float

    @property
    def size(self) -> int:
        """How many heights there are."""
        return self.shape[0] * self.shape[1]

    def __getitem__(self, window):
        import rasterio

        # Rows and columns as they are stored
        stored = [range(n)[::step][w] for n, step, w in zip(self.shape, self.turned, window, strict=True)]
        window = tuple((min(r[0], r[-1]), max(r[0], r[-1]) + 1) for r in stored)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(self.path) as file:
                try:
                    values = np.ma.filled(file.read(1, masked=True, window=window).astype(np.float64), np.nan)
                except rasterio.errors.RasterioError:
                    raise InputError(f"'{self.path}' cannot be read as a height map: it is damaged or cut short") from None
        return ((values * self.scale + self.offset) * self.unit)[:: self.turned[0], :: self.turned[1]]


def read_map(path: Path) -> np.ndarray:
    """Read an environment map from an OpenEXR: (h, w, channels), first row straight up, columns clockwise from north."""
    from ..images import read_exr

    _present(path, "an environment map")
    layers, _ = read_exr(path)
    values = layers.get("rgb", layers.get("Y"))
    if values is None:
        raise InputError(f"'{path}' must have channels R, G, B or Y (got {', '.join(layers)})")
    return values if values.ndim == 3 else values[..., None]
