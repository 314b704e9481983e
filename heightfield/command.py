"""``intervis heightfield``: light a height map from the command line."""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ..errors import InputError, finishing, interrupts
from ..images import check_writable
from ..report import Report, peak_memory
from . import products as files
from .check import choice, number, spacing_of
from .field import HeightField
from .fields import FIELDS, example, make
from .light import BRIGHTEST
from .sources import opened, path_of, read, read_map
from .sweep import azimuths_of
from .tally import Tally
from .tiles import tiles

PRODUCTS = ("irradiance", "skyview", "horizons", "shadow")
MOST = 36_000  # azimuths


def run(options, line: str) -> int:
    """Compute what the options ask for, write it, print the report; 0, or 130 if interrupted after some of it."""
    wanted = dict.fromkeys(choice("products", w.strip(), PRODUCTS) for w in options.products.split(","))
    number("azimuths", options.azimuths, 1, MOST, whole=True)
    number("bounces", options.bounces, 0, 1000, whole=True)
    number("supersampling", options.supersampling, 1, 16, whole=True)
    number("albedo", options.albedo, 0, 1)
    sun, sky = _sun(options.sun), _sky(options.sky)
    if "shadow" in wanted and sun is None:
        raise InputError("'products' with a shadow need a sun: add --sun AZ,EL,W")
    heights, settings, georeference = _source(options)
    if options.tile is None:
        field = HeightField(heights, **settings)
    else:
        number("tile", options.tile, 1, whole=True)
        if options.radius is None:
            raise InputError("'tile' needs to know how far points look: add --radius M")
        # What cannot be used is found out before anything is computed
        field, _ = None, next(tiles(heights, size=options.tile, **settings))
    output = _output(options, georeference)
    preview = None if options.preview is None else _target("preview", options.preview, options, [".png"])

    # Every product by itself: an interruption keeps those before it, and the directions of horizons that are finished
    report, done, interrupted = Report(), {}, False
    begin = time.perf_counter()
    with _Progress() as progress:
        try:
            for name in wanted:
                tally = Tally()
                what = name, options, sun, sky, progress(name), report, tally
                with _counted(report, name), interrupts():
                    whole = field is not None
                    parts = _product(field, *what) if whole else _tiled(heights, settings, output.parent, *what)
                    for finished in parts:
                        done[name] = finished
                if tally.rays:
                    report.notes.append(f"{name}: {tally}")
        except KeyboardInterrupt:
            interrupted = True
    if not done:
        raise KeyboardInterrupt

    report.wall_s = time.perf_counter() - begin
    report.memory_peak_bytes = peak_memory()
    if interrupted:
        report.notes.append("interrupted: what was finished has been written")
    spacing = spacing_of(settings.get("spacing", 1.0))
    header = {"command": line, "intervis": version("intervis"), "seconds": report.wall_s, "azimuths": options.azimuths}
    with finishing() as late:
        files.write(output, done, azimuths_of(options.azimuths), header, spacing, georeference)
        if preview:
            files.write_preview(preview, done)
    print(report)
    for path in filter(None, (output, preview)):
        print(f"{'written':<10}{path}")
    return 130 if interrupted or late else 0


def _product(field, name, options, sun, sky, progress, report, tally):
    # The product; horizons also after every direction, as far as they are
    if name == "irradiance":
        light = {"albedo": options.albedo, "bounces": options.bounces, "azimuths": options.azimuths}
        light["supersampling"] = options.supersampling
        out = field.irradiance(sky, sun, **light, progress=progress)
    elif name == "skyview":
        out = field.sky_view(options.azimuths, progress=progress)
    elif name == "shadow":
        out = field.shadow(sun[0], sun[1])
    else:
        azimuths = azimuths_of(options.azimuths)
        out = np.empty((len(azimuths), *field.heights.shape), dtype=np.float32)
        for i, azimuth in enumerate(azimuths):
            out[i] = field.horizons([azimuth])[0]
            _account(report, field.report)
            tally.add(*vars(field.tally).values())
            yield out[: i + 1]
            progress(i + 1, len(azimuths))
    if name != "horizons":
        _account(report, field.report)
        tally.add(*vars(field.tally).values())
        yield out


def _tiled(heights, settings, folder, name, options, sun, sky, progress, report, tally):
    # The product, a tile at a time
    size, out, points = options.tile, None, 0
    count = int(np.prod([-(-n // size) for n in heights.shape]))
    cut = tiles(heights, size=size, bounces=options.bounces if name == "irradiance" else 0, **settings)
    for n, (window, field, inner) in enumerate(cut):
        *_, found = _product(field, name, options, sun, sky, lambda *_: None, report, tally)
        if out is None:
            shape = (len(found), *heights.shape) if name == "horizons" else (*heights.shape, *found.shape[2:])
            out = _on_disk(shape, folder)
        at, within = ((slice(None), *v) if name == "horizons" else v for v in (window, inner))
        out[at] = found[within]
        points += int(field.valid[inner].sum())
        progress(n + 1, count)
    # Tiles see points of their neighbours, and those without data not at all
    report.skipped["points without data"] = heights.size - points
    yield out


def _on_disk(shape, folder):
    # An array of NaN in a file that has no name: there is room for what is larger than memory, and nothing is left behind
    file, part = tempfile.TemporaryFile(dir=folder), np.full(shape[1:], np.nan, np.float32)
    try:
        for _ in range(shape[0]):
            file.write(part)
        file.flush()
    except OSError as error:
        need = part.nbytes * shape[0] / 2**30
        raise InputError(f"'output' needs {need:.3g} GiB for a while in the folder {folder}: {error.strerror}") from error
    return np.memmap(file, np.float32, "r+", shape=shape)


def _account(total, part):
    # Points without data are the same ones every time, everything else adds up
    for mine, its in ((total.skipped, part.skipped), (total.rays, part.rays)):
        for what, count in its.items():
            mine[what] = count if what == "points without data" else mine.get(what, 0) + count


@contextmanager
def _counted(report, name):
    # Seconds of a product, finished or not
    begin = time.perf_counter()
    try:
        yield
    finally:
        report.phases[name] = report.phases.get(name, 0.0) + time.perf_counter() - begin


def _source(options):
    # Heights, options of their field, and what a GeoTIFF says of itself
    settings = {"nodata_policy": options.nodata_policy, "curvature": options.curvature, "radius": options.radius}
    if options.nodata is not None:
        settings["nodata"] = options.nodata
    if options.spacing is not None:
        try:
            settings["spacing"] = [float(x) for x in options.spacing.split(",")]
        except ValueError:
            raise InputError(f"'spacing' must be one number or two, DY,DX, in metres (got {options.spacing!r})") from None
    if options.dem in FIELDS:
        return make(options.dem, options.size), settings, None
    if options.dem == "jacksboro":
        heights, spacing = example()
        return heights, {"spacing": spacing, **settings}, None
    if not Path(options.dem).suffix:
        raise InputError(f"'DEM' must be a file, 'jacksboro' or one of {', '.join(FIELDS)} (got {options.dem!r})")
    heights, found, georeference = (read if options.tile is None else opened)(path_of("path", options.dem))
    return heights, {**found, **settings}, georeference


def _output(options, georeference) -> Path:
    # An .exr made from an .exr must not take its place
    kind = ".light.tif" if georeference else ".light.exr" if options.dem.lower().endswith(".exr") else ".exr"
    default = f"{Path(options.dem).stem}{kind}"
    path = default if options.output is None else options.output
    return _target("output", path, options, [".exr", ".tif", ".tiff", ".npz"])


def _target(name, path, options, suffixes):
    # A file that may be written: of a known kind, and none of those that are read
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise InputError(f"'{name}' must end in {' or '.join(suffixes)} (got {path})")
    check_writable(path, suffix)
    for source in (options.dem, options.sky):
        if path.exists() and Path(source).exists() and path.samefile(source):
            raise InputError(f"'{name}' must not be a file that is read (got {path}): choose another name")
    return path


def _sun(text):
    if text is None:
        return None
    try:
        az, el, w = (float(x) for x in text.split(","))
    except ValueError:
        raise InputError(f"'sun' must be AZ,EL,W: two angles in degrees and W/m² (got {text!r})") from None
    number("sun elevation", el, -90, 90)
    return np.radians(number("sun azimuth", az)), np.radians(el), number("sun irradiance", w, 0, BRIGHTEST)


def _sky(text):
    try:
        value = float(text)
    except ValueError:
        value = None
    if value is not None:
        return number("sky", value, 0, BRIGHTEST)
    if not text.lower().endswith(".exr"):
        raise InputError(f"'sky' must be a radiance or an .exr file (got {text!r})")
    return read_map(Path(text))


class _Progress:
    # A progress bar, where someone is watching
    def __init__(self):
        from rich.console import Console
        from rich.progress import Progress

        self.bar = Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())

    def __enter__(self):
        self.bar.__enter__()
        return self._task

    def __exit__(self, *what):
        return self.bar.__exit__(*what)

    def _task(self, name):
        task = self.bar.add_task(name, total=None)
        return lambda n, total: self.bar.update(task, completed=n, total=total)
