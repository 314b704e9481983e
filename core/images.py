"""OpenEXR files with named layers and a header that says how they were made, and PNG previews."""

from __future__ import annotations

import io
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

import numpy as np

from .errors import InputError

# Attributes that describe the file's own layout: everything else in a header was put there by someone.
_STANDARD = frozenset(
    "channels chunkCount compression dataWindow displayWindow lineOrder name pixelAspectRatio "
    "screenWindowCenter screenWindowWidth tiles type version".split()
)
_BASE = ("", "rgb")


def write_exr(
    path: str | os.PathLike,
    layers: Mapping[str, np.ndarray],
    header: Mapping[str, str | float | int] | None = None,
) -> None:
    """Write a linear float32 OpenEXR with named layers; the file appears complete or not at all.

    Parameters
    ----------
    path : path-like
        File to write or to replace.
    layers : mapping of str to ndarray
        Arrays of shape (H, W) keep their name; arrays of shape (H, W, 3) become ``name.R``, ``name.G``,
        ``name.B``, and plain ``R``, ``G``, ``B`` for the name ``"rgb"`` or ``""``. All of one size.
    header : mapping of str to str, float or int, optional
        Attributes of the file. Integers beyond 32 bits are stored as doubles.

    Raises
    ------
    InputError
        If layers differ in size or have another shape, or the file cannot be written.
    """
    import OpenEXR

    # One array a channel, contiguous, as the format wants them.
    channels: dict[str, np.ndarray] = {}
    for name, layer in layers.items():
        pixels = np.asarray(layer, dtype=np.float32)
        if pixels.ndim == 3 and pixels.shape[2] == 3:
            prefix = "" if name in _BASE else f"{name}."
            channels |= {prefix + c: np.ascontiguousarray(pixels[:, :, i]) for i, c in enumerate("RGB")}
        elif pixels.ndim == 2 and name:
            channels[name] = np.ascontiguousarray(pixels)
        else:
            raise InputError(f"layer '{name}' needs a name and shape (H, W) or (H, W, 3), not {pixels.shape}")
    sizes = {c.shape for c in channels.values()}
    if len(sizes) != 1 or 0 in next(iter(sizes)):
        raise InputError(f"an image needs layers of one size, at least one pixel each (got {sorted(sizes)})")

    attributes = {str(k): _attribute(str(k), v) for k, v in (header or {}).items()}
    attributes |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}

    def write(temporary: str) -> None:
        with OpenEXR.File(attributes, channels) as file:
            file.write(temporary)

    _write_whole(path, write)


def read_exr(path: str | os.PathLike) -> tuple[dict[str, np.ndarray], dict[str, str | float | int]]:
    """Read an OpenEXR file's layers and header.

    Parameters
    ----------
    path : path-like
        File to read: any flat OpenEXR, of half or float channels.

    Returns
    -------
    layers : dict of str to ndarray
        Channels ``name.R``, ``name.G``, ``name.B`` together as float32 ``name`` of shape (H, W, 3), plain
        ``R``, ``G``, ``B`` as ``"rgb"``; every other channel as float32 of shape (H, W).
    header : dict
        The attributes, without those that describe the file's own layout.

    Raises
    ------
    InputError
        If the file is missing or is no flat OpenEXR.
    """
    import OpenEXR

    if not os.path.isfile(path):
        raise InputError(f"{path}: file does not exist")
    if not OpenEXR.isOpenExrFile(str(path)):
        raise InputError(f"{path}: not an OpenEXR file")
    try:
        with _silence(), OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {k: np.array(c.pixels, dtype=np.float32) for k, c in file.channels().items()}
            attributes = dict(file.header())
    except (RuntimeError, TypeError, ValueError) as error:
        what = "it is damaged or cut short" if "has 0 parts" in str(error) else error
        raise InputError(f"{path}: cannot be read as a flat OpenEXR ({what})") from error

    # Channels of one colour belong together; the file keeps them in alphabetical order.
    layers: dict[str, np.ndarray] = {}
    for name in planes:
        prefix, _, last = name.rpartition(".")
        colour = [f"{prefix}.{c}" if prefix else c for c in "RGB"]
        if last in ("R", "G", "B") and all(c in planes for c in colour):
            layers[prefix or "rgb"] = np.stack([planes[c] for c in colour], axis=2)
        else:
            layers[name] = planes[name]
    return layers, {k: _plain(v) for k, v in attributes.items() if k not in _STANDARD}


@contextmanager
def _silence() -> Iterator[None]:
    """Drop what OpenEXR prints about damaged files, from C++ and from Python, beside what it raises."""
    try:
        kept = os.dup(2)
    except OSError:
        # There is nowhere to print to
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        os.dup2(null, 2)
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


def write_png(path: str | os.PathLike, rgb: np.ndarray) -> None:
    """Write a linear image as an 8-bit sRGB PNG; values beyond [0, 1] are clipped.

    Parameters
    ----------
    path : path-like
        File to write or to replace.
    rgb : ndarray, shape (H, W) or (H, W, 3)
        Linear radiance, 1 is white. NaN becomes black.

    Raises
    ------
    InputError
        If the shape is another, or the file cannot be written.
    """
    import mitsuba as mi

    pixels = np.asarray(rgb, dtype=np.float32)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise InputError(f"'rgb' must have shape (H, W) or (H, W, 3) (got {pixels.shape})")
    bitmap = mi.Bitmap(np.round(255 * srgb(pixels)).astype(np.uint8))
    bitmap.set_srgb_gamma(True)
    _write_whole(path, lambda temporary: bitmap.write(temporary, mi.Bitmap.FileFormat.PNG))


def srgb(rgb: np.ndarray) -> np.ndarray:
    """Return linear values encoded as sRGB, clipped to [0, 1], float32 of the same shape; NaN becomes 0."""
    # Colour warns at import about optional packages that nothing here uses, and changes how NumPy prints numbers.
    with warnings.catch_warnings(), np.printoptions():
        warnings.simplefilter("ignore")
        import colour
    clipped = np.clip(np.nan_to_num(np.asarray(rgb, dtype=np.float32), nan=0.0), 0.0, 1.0)
    return np.asarray(colour.cctf_encoding(clipped, function="sRGB"), dtype=np.float32)


def check_writable(path: str | os.PathLike, suffix: str) -> Path:
    """Return `path`, or raise `InputError` if a file of this suffix cannot be written there."""
    target = Path(path)
    if target.suffix.lower() != suffix:
        raise InputError(f"'output' must end in {suffix} (got {target})")
    try:
        folder = target.is_dir()
        # Names that are too long are noticed only when they are looked for
        with suppress(FileNotFoundError, NotADirectoryError):
            target.lstat()
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror}") from error
    if folder:
        raise InputError(f"'output' must be a file (got the folder {target})")
    # Permission bits say too little (read-only mounts, the superuser): try it.
    parent = Path(os.path.realpath(target)).parent if target.is_symlink() else target.parent
    try:
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise InputError(f"cannot write into the folder {parent}: {error.strerror}") from error
    return target


def _write_whole(path: str | os.PathLike, write: Callable[[str], None]) -> None:
    """Call `write` with a temporary name beside `path`, then rename: no half-written file is ever seen."""
    # A link stays, and leads to the new file
    target = Path(os.path.realpath(path))
    # Not longer than a name may be, whatever the file's
    temporary = target.with_name(f".intervis.{os.getpid()}.{threading.get_ident()}.part{target.suffix}")
    try:
        write(str(temporary))
        os.replace(temporary, target)
    except (OSError, RuntimeError) as error:
        raise InputError(f"cannot write {target}: {error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _attribute(name: str, value: str | float | int) -> str | int | np.ndarray:
    """Return a header value as a type that OpenEXR stores without loss."""
    if name in _STANDARD:
        raise InputError(f"header key '{name}' is reserved by OpenEXR: choose another name")
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, int, np.integer)) and -(2**31) <= int(value) < 2**31:
        return int(value)
    # A plain float would be stored in 32 bits, and a larger integer silently wrapped.
    return np.array([float(value)], dtype=np.float64)


def _plain(value: object) -> object:
    """Return a header value as the plain Python type it was written from."""
    if isinstance(value, np.ndarray) and value.size == 1:
        return value.reshape(()).item()
    return value
