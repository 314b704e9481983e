"""``intervis heightfield``: light a height map from the command line."""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..images import check_writable
from . import products as files
from .check import choice, number
from .field import HeightField
from .fields import FIELDS, example, make

PRODUCTS = ("irradiance", "skyview", "horizons", "shadow")


def run(options, line: str) -> int:
    """Compute what the options ask for, write it, print the report; 0, or 130 if interrupted after some of it."""
    wanted = [choice("products", w.strip(), PRODUCTS) for w in options.products.split(",")]
    number("azimuths", options.azimuths, 1, whole=True)
    number("bounces", options.bounces, 0, whole=True)
    number("albedo", options.albedo, 0, 1)
    sun, sky = _sun(options.sun), _sky(options.sky)
    if "shadow" in wanted and sun is None:
        raise InputError("'--products shadow' needs '--sun AZ,EL,W'")
    field = _field(options)
    output = _output(options, field)
    preview = None if options.preview is None else check_writable(options.preview, ".png")

    begin = time.perf_counter()
    done, phases, interrupted = {}, {}, False
    k = np.arange(options.azimuths) * (2 * np.pi / options.azimuths)
    with _Progress() as progress:
        try:
            for name in wanted:
                start = time.perf_counter()
                if name == "irradiance":
                    done[name] = field.irradiance(
                        sky, sun, options.albedo, bounces=options.bounces, azimuths=options.azimuths, progress=progress(name)
                    )
                elif name == "shadow":
                    done[name] = field.shadow(sun[0], sun[1])
                else:
                    _by_direction(field, name, k, done, progress(name))
                phases[name] = time.perf_counter() - start
        except KeyboardInterrupt:
            interrupted = True
    if not done:
        raise KeyboardInterrupt

    report = field.report
    report.wall_s, report.phases = time.perf_counter() - begin, phases
    report.memory_peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    if interrupted:
        report.notes.append("interrupted: what was finished has been written")
    header = {"command": line, "seconds": report.wall_s, "azimuths": options.azimuths}
    files.write(output, done, k, header, field.georeference)
    if preview:
        files.write_preview(preview, done)
    print(report)
    for path in filter(None, (output, preview)):
        print(f"{'written':<10}{path}")
    return 130 if interrupted else 0


def _by_direction(field, name, azimuths, done, progress):
    # A direction at a time, so that an interruption keeps those that are finished
    found = []
    try:
        for i, az in enumerate(azimuths):
            if name == "horizons":
                found.append(field.horizons([az])[0])
            else:
                found.append(field.sky_view([az]))
                found = [np.sum(found, axis=0, dtype=np.float64)]
            progress(i + 1, len(azimuths))
            done[name] = np.array(found, dtype=np.float32) if name == "horizons" else (found[0] / (i + 1)).astype(np.float32)
    finally:
        if name == "skyview" and name in done and i + 1 < len(azimuths):
            # The mean over some directions is no sky view
            del done[name]


def _field(options) -> HeightField:
    settings = {"nodata_policy": options.nodata_policy, "curvature": options.curvature, "radius": options.radius}
    if options.spacing is not None:
        try:
            settings["spacing"] = [float(x) for x in options.spacing.split(",")]
        except ValueError:
            raise InputError(f"'spacing' must be one number or two, DY,DX, in metres (got {options.spacing!r})") from None
    if options.dem in FIELDS:
        return HeightField(make(options.dem, options.size), **settings)
    if options.dem == "jacksboro":
        heights, spacing = example()
        return HeightField(heights, **{"spacing": spacing, **settings})
    if not Path(options.dem).suffix:
        raise InputError(f"'DEM' must be a file, 'jacksboro' or one of {', '.join(FIELDS)} (got {options.dem!r})")
    return HeightField.from_file(options.dem, **settings)


def _output(options, field) -> Path:
    tif = field.georeference is not None
    path = Path(options.output or f"{Path(options.dem).stem}{'.light.tif' if tif else '.exr'}")
    if path.suffix.lower() not in (".exr", ".tif", ".npz"):
        raise InputError(f"'output' must end in .exr, .tif or .npz (got {path})")
    if Path(options.dem).exists() and path.exists() and path.samefile(options.dem):
        raise InputError(f"'output' must not be the input itself (got {path})")
    return check_writable(path, path.suffix.lower())


def _sun(text):
    if text is None:
        return None
    try:
        az, el, w = (float(x) for x in text.split(","))
    except ValueError:
        raise InputError(f"'sun' must be AZ,EL,W: two angles in degrees and W/m² (got {text!r})") from None
    number("sun elevation", el, -90, 90)
    return np.radians(number("sun azimuth", az)), np.radians(el), number("sun irradiance", w, 0)


def _sky(text):
    try:
        value = float(text)
    except ValueError:
        value = None
    if value is not None:
        return number("sky", value, 0)
    from .sources import read_map

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
