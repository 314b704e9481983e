"""``intervis render``: a scene to an OpenEXR with named layers, its PNG previews, and the report."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError, finishing, mitsuba_errors
from .images import check_writable, write_exr, write_png
from .inputs import check_scene, load_integrator, load_scene, parse_settings, set_variant
from .maps import class_colours, heat
from .report import Report, peak_memory

PREVIEWS = ".png", ".class.png", ".rays.png"


def command(options: argparse.Namespace, line: str) -> int:
    """Render what the options say, write the files, print the report and return 0; 130 if interrupted meanwhile.

    Raises
    ------
    InputError
        If anything in the options or in the scene is wrong; no file has been written then.
    """
    # Everything that can be refused without rendering is refused first.
    if options.spp is not None and not 1 <= options.spp < 2**32:
        raise InputError(f"'spp' must be >= 1 and below 2**32 (got {options.spp})")
    if not 0 <= options.seed < 2**32:
        raise InputError(f"'seed' must be >= 0 and below 2**32 (got {options.seed})")
    if options.threshold is not None and not 0 <= options.threshold < float("inf"):
        raise InputError(f"'threshold' must be >= 0 and finite (got {options.threshold})")
    check_scene(options.scene)
    default = f"{Path(options.scene).stem}.exr"
    output = check_writable(default if options.output is None else options.output, ".exr")
    parameters, scene_parameters = parse_settings(options.settings)
    if options.aovs:
        parameters["aovs"] = True
    if options.threshold is not None:
        parameters["threshold"] = options.threshold
    set_variant(options.variant, options.integrator)
    integrator = load_integrator(options.integrator, parameters)
    if options.png:
        # Maps are drawn of layers only
        for suffix in PREVIEWS if integrator.aov_names() else PREVIEWS[:1]:
            check_writable(output.with_suffix(suffix), ".png")
    scene = load_scene(options.scene, scene_parameters)

    with _status(f"rendering {options.scene}"), mitsuba_errors("cannot render: "):
        layers, report = render_layers(scene, integrator, options.spp or 0, options.seed)

    header = _header(report, line, options, scene)
    with finishing() as interrupted:
        write_exr(output, layers, header)
        if options.png:
            write_previews(output, layers)
    print(report)
    print(f"{'written':<10}{output}")
    return 130 if interrupted else 0


def render_layers(
    scene: Any, integrator: Any, spp: int = 0, seed: int = 0
) -> tuple[dict[str, np.ndarray], Report]:
    """Render a scene with an integrator, and return its layers by name.

    Parameters
    ----------
    scene : mitsuba.Scene
        Its first sensor is used, with that sensor's film size, crop and channels.
    integrator : mitsuba.Integrator
        Any; one of this package's brings its own report.
    spp : int
        Samples a pixel; 0 takes the sampler's count.
    seed : int
        Seed of the sampler.

    Returns
    -------
    layers : dict of str to ndarray of float32
        ``rgb`` of shape (H, W, 3), or the film's own channels of shape (H, W), and the integrator's layers.
    report : Report
        What was spent.
    """
    import drjit as dr
    import mitsuba as mi

    # Dr.Jit's history tells compilation from rendering, which would otherwise be one number.
    jit = not mi.variant().startswith("scalar")
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, jit):
        if jit:
            dr.kernel_history_clear()
        begin = time.perf_counter()
        image = np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed), dtype=np.float32)
        seconds = time.perf_counter() - begin
        history = dr.kernel_history() if jit else []

    layers = _named(image, scene.sensors()[0].film(), integrator)
    report = getattr(integrator, "report", None)
    if report is None:
        # Mitsuba's integrators count nothing: camera rays are what is known.
        pixels = image.shape[0] * image.shape[1]
        report = Report(rays={"camera": pixels * scene.sensors()[0].sampler().sample_count()})
    report.wall_s = report.wall_s or seconds
    if jit and "compilation" not in report.phases:
        compiling = sum(k.get("codegen_time", 0.0) + k.get("backend_time", 0.0) for k in history)
        report.phases["compilation"] = compiling / 1e3
    report.memory_peak_bytes = report.memory_peak_bytes or peak_memory()
    return layers, report


def write_previews(output: Path, layers: dict[str, np.ndarray]) -> None:
    """Write a PNG of the picture beside `output`, and of the visibility and ray maps if they are there."""
    picture = layers.get("rgb", layers.get("Y"))
    if picture is None:
        raise InputError("'--png' needs a film of colours or luminance (this film has other channels)")
    whole, classes, spent = (output.with_suffix(suffix) for suffix in PREVIEWS)
    write_png(whole, picture)
    if "visibility.class" in layers:
        write_png(classes, class_colours(layers["visibility.class"]))
    if "rays.shadow" in layers:
        rays = layers["rays.shadow"]
        # Budgets span orders of magnitude, so the scale is logarithmic, up to the pixel that got most.
        scale = max(float(np.log1p(rays.max())), 1e-9)
        write_png(spent, heat(np.log1p(rays) / scale))


def _named(image: np.ndarray, film: Any, integrator: Any) -> dict[str, np.ndarray]:
    """Return the channels of a rendered image by name, colours of three channels together."""
    image = image if image.ndim == 3 else image[:, :, None]
    extra = list(integrator.aov_names())
    count = image.shape[2] - len(extra)
    # Films of this many base channels have one meaning each; others (spectral bands) know their names.
    base = {1: ["Y"], 2: ["Y", "A"], 3: list("RGB"), 4: list("RGBA")}.get(count)
    if base is None or "specfilm" in type(film).__name__.lower():
        base = [field.name for field in film.bitmap().struct_()][:count]
    names = base + extra

    layers: dict[str, np.ndarray] = {}
    for index, name in enumerate(names):
        prefix, _, last = name.rpartition(".")
        colour = [f"{prefix}.{c}" if prefix else c for c in "RGB"]
        if last == "R" and names[index : index + 3] == colour:
            layers[prefix or "rgb"] = image[:, :, index : index + 3]
        elif not (last in ("G", "B") and (prefix or "rgb") in layers):
            layers[name] = image[:, :, index]
    return layers


def _header(report: Report, line: str, options: argparse.Namespace, scene: Any) -> dict[str, Any]:
    """Return what the file should remember of the run."""
    header: dict[str, Any] = {"command": line}
    header |= {package: version(package) for package in ("intervis", "mitsuba", "drjit")}
    header |= {
        "variant": options.variant,
        "integrator": options.integrator,
        "seed": options.seed,
        "spp": scene.sensors()[0].sampler().sample_count() if options.spp is None else options.spp,
        "seconds": report.wall_s,
    }
    for kind in ("rays", "skipped", "classes"):
        header |= {f"{kind}.{name}": count for name, count in getattr(report, kind).items()}
    if report.error is not None:
        header["error"] = report.error
    return header


@contextmanager
def _status(text: str):
    """Show that something is going on, where someone is watching."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{text} …"):
        yield
