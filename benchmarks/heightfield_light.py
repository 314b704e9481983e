"""Irradiance against path tracing of the same surface, and its error against azimuths (K) and samples on lines (S)."""

from __future__ import annotations

import time

import mitsuba as mi
import numpy as np

from intervis.heightfield import HeightField, example, make

from .heightfield_path import TILE, path_irradiance, reference, scene_of
from .heightfield_plots import ladders as draw_ladders
from .heightfield_plots import shape as draw_shape
from .heightfield_tables import Part, Row, grid, interleave, threads

SKY, SUN, ALBEDO, BOUNCES, AZIMUTHS = 30.0, (np.radians(300.0), np.radians(25.0), 800.0), 0.4, 2, 64
COUNTS = (8, 16, 32, AZIMUTHS)  # of azimuths


def fields(quick: bool) -> dict[str, HeightField]:
    """Return the fields that light is compared on."""
    size = 48 if quick else 192
    heights, spacing = example()
    out = {name: HeightField(make(name, size)) for name in ("fractal", "sine", "brick", "blocks")}
    out["jacksboro"] = HeightField(heights[40 : 40 + size, 60 : 60 + size], spacing)
    return out


def gathered(field: HeightField, bounces: int = BOUNCES, azimuths=AZIMUTHS, s: int = 1) -> np.ndarray:
    """Irradiance by this package, (rows, columns) float64."""
    e = field.irradiance(SKY, (*SUN, 0.0), ALBEDO, bounces=bounces, azimuths=azimuths, supersampling=s)
    return e[..., 0].astype(np.float64)


def traced(field: HeightField, samples: int, seed: int, scene) -> np.ndarray:
    """Irradiance by Mitsuba's path tracer, (rows, columns) float64."""
    return path_irradiance(field, SKY, SUN, ALBEDO, BOUNCES, samples, seed, scene)


def measure(options, note) -> Part:
    """Measure relative RMSE and time against the path tracer."""
    threads(options.threads)
    if mi.variant() is None:
        mi.set_variant("llvm_ad_rgb")
    part = Part("Light against path tracing")
    samples = 64 if options.quick else 1024
    part.text.append(
        f"Sky {SKY:g} W/(m² sr), sun {SUN[2]:g} W/m² {np.degrees(SUN[1]):.0f}° high, albedo {ALBEDO:g}, {BOUNCES} bounces,"
        f" K = {AZIMUTHS} and fewer; relative RMSE over all points, border too. The reference is two independent traces of"
        f" {samples} paths a point: errors are means of the product of the differences from both, so that their noise drops"
        f" out (what two standard errors of what is left may hide is in brackets). It is traced in tiles of {TILE}², each"
        " with the origin in its middle, from a little above the surface: traced at once, light leaks through the feet of"
        " walls. The path tracer's error is its noise alone, from pairs of independent runs; the time at which it reaches"
        " ours, bracket included, is interpolated in its ladder, beyond it time × error² is constant (~). Its scene is built"
        " beforehand. S: `supersampling`."
    )
    own = {f"K = {k}": {"azimuths": k} for k in COUNTS}
    own |= {f"K = {k}, S = 2": {"azimuths": k, "s": 2} for k in COUNTS[1:]}
    rungs = (1, 4, 16) if options.quick else (1, 4, 16, 64)
    tables, plotted, most, gains = [], {}, {}, {}
    for name, field in fields(options.quick).items():
        note(f"light: {name}")
        scene = scene_of(field, SKY, SUN, ALBEDO)
        mean, errors = _errors(field, samples, own)
        noise = _noise(field, rungs, mean, scene)
        traces = {f"path, {n} a point": lambda n=n, f=field, s=scene: traced(f, n, 0, s) for n in rungs}
        times = interleave(
            {label: lambda f=field, how=how: gathered(f, **how) for label, how in own.items()} | traces, options.repeats
        )
        part.timed(f"light, {name}", times)
        seconds = {label: float(np.median(t)) for label, t in times.items()}
        lines = []
        for label, (error, doubt) in errors.items():
            # No error below what can be told from the reference's noise; a ratio a round, from the round's own times
            goal = error + doubt
            need, mark = reach([seconds[p] for p in traces], noise, goal)
            each = [reach([times[p][k] for p in traces], noise, goal)[0] / t for k, t in enumerate(times[label])]
            gains[name, label] = need / seconds[label], min(each), max(each), mark
            gain = f"{mark}{need / seconds[label]:.3g}× [{min(each):.3g}, {max(each):.3g}]"
            found = f"{100 * error:.3g} [+{100 * doubt:.1g}]"
            lines.append([label, found, f"{seconds[label]:.3g}", f"{mark}{need:.3g}", gain])
            part.found(f"light, {name}", f"relative RMSE, {label}", error, "")
        for p, e in zip(traces, noise, strict=True):
            lines.append([p, f"{100 * e:.3g}", f"{seconds[p]:.3g}", "", ""])
            part.found(f"light, {name}", f"relative RMSE, {p}", e, "")
        tables.append(f"{name.capitalize()}:\n\n" + grid(["", "RMSE, %", "s", "path tracer's s to it", "ratio"], lines))
        most[name] = errors[f"K = {AZIMUTHS}"][0]
        ours = {f"S = {s}": [(seconds[k], sum(errors[k])) for k in own if ("S" in k) == (s == 2)] for s in (1, 2)}
        plotted[name] = [seconds[p] for p in traces], noise, ours
    worst = max(most, key=most.get)
    part.rows.append(Row(f"irradiance, 2 bounces, K = {AZIMUTHS}, relative RMSE, worst field ({worst})", 2, 0.5,
                         100 * most[worst], unit=" %", less=True,
                         note="; ".join(f"{name} {100 * e:.3g}" for name, e in most.items())))  # fmt: skip
    for name in most:
        value, low, high, mark = gains[name, f"K = {AZIMUTHS}"]
        part.rows.append(Row(f"time of the path tracer to the same error, {name}", 10, 50, value, low, high, mark=mark))
        label = max(own, key=lambda label: gains[name, label][0])
        value, low, high, mark = gains[name, label]
        part.rows.append(Row("the same with the K and S that gain most", None, None, value, low, high, mark=mark, note=label))
    part.text += tables
    part.plots.append(("time-light.png", draw_ladders, plotted))
    return part


def reach(times, errors, target: float) -> tuple[float, str]:
    """Return when a ladder of (time, RMSE) reaches an RMSE, and "~" where that lies beyond it.

    Between rungs by log-log interpolation; before the first rung its own time; beyond the last error² falls as 1 / time.
    """
    t, e, goal = np.log(times), np.log(errors), np.log(target)
    if e[0] <= goal:
        return float(times[0]), "≤"
    below = np.flatnonzero(e <= goal)
    if not len(below):
        return float(np.exp(t[-1] + 2 * (e[-1] - goal))), "~"
    i = int(below[0])
    return float(np.exp(np.interp(goal, [e[i], e[i - 1]], [t[i], t[i - 1]]))), ""


def _errors(field, samples, own):
    # Mean of the reference; our relative RMSE each way, without the reference's noise, and the doubt that it leaves
    a, b = (reference(field, SKY, SUN, ALBEDO, BOUNCES, samples=samples, seed=seed) for seed in (11, 12))
    mean, out = float((a + b).mean() / 2), {}
    for label, how in own.items():
        ours = gathered(field, **how)
        product = (ours - a) * (ours - b)
        mse = max(float(product.mean()), 0.0)
        most = np.sqrt(mse + 2 * float(product.std()) / np.sqrt(product.size))
        out[label] = np.sqrt(mse) / mean, (most - np.sqrt(mse)) / mean
    return mean, out


def _noise(field, rungs, mean, scene):
    # Relative RMS noise of a run of each length, from two with other seeds
    runs = ([traced(field, n, seed, scene) for seed in (21, 22)] for n in rungs)
    return [float(np.sqrt(np.mean((a - b) ** 2) / 2) / mean) for a, b in runs]


def converge(options, note) -> Part:
    """Measure the error of indirect light against K and against S (Figures 14 and 15)."""
    threads(options.threads)
    part = Part("Error against K and S")
    size = 48 if options.quick else 192
    counts = (2, 4, 8, 16, 32) if options.quick else (2, 4, 8, 16, 32, 64, 128, 256)
    field = HeightField(make("fractal", size))
    # Truth from azimuths that no count shares: halves of steps
    many = 90 if options.quick else 600
    truth_azimuths = (np.arange(many) + 0.5) * (2 * np.pi / many)
    note(f"K: truth from {many} azimuths")

    def indirect(azimuths):
        return gathered(field, 1, azimuths) - gathered(field, 0, azimuths)

    truth = indirect(truth_azimuths)
    by_k, images = {}, {}
    for k in counts:
        note(f"K = {k}")
        begin = time.perf_counter()
        images[k] = indirect(k)
        by_k[k] = float(np.mean(np.abs(images[k] - truth)) / truth.mean())
        part.found("indirect light, fractal", f"error, K = {k}", by_k[k], "")
        part.found("indirect light, fractal", f"time of two runs, K = {k}", time.perf_counter() - begin, "s")
    by_s, truth_s = _cut(HeightField(make("fractal", size // 2)), options.quick, note)
    for s, e in by_s.items():
        part.found("indirect light, fractal", f"error, S = {s}", e, "")
    half = np.log(list(by_k.values()))
    slope = float(np.polyfit(np.log(counts), half, 1)[0])
    part.text.append(
        f"Fractal of {size}² under sun and sky, one bounce: mean of |difference| over the mean of the indirect light. K is"
        f" held against {many} azimuths halfway between others; the error falls as K^{slope:.2f}."
        " S: the march is exact on the triangulated surface, it has no step length; what is sampled is the light that the"
        " surface sends, at the triangles' corners. S = s cuts each cell into s² of the same surface; it is held against"
        f" S = {truth_s}, K = 16, on {size // 2}². So S = 1 here is not the paper's S = 1, whose visibility is sampled too."
    )
    part.text.append(grid(["K", *by_k], [["error, %", *(f"{100 * e:.3g}" for e in by_k.values())]]))
    part.text.append(grid(["S", *by_s], [["error, %", *(f"{100 * e:.3g}" for e in by_s.values())]]))
    part.rows.append(Row("mean error of indirect light at K = 16", None, None, 100 * by_k[16], unit=" %"))
    part.rows.append(Row("mean error of indirect light at S = 1", None, None, 100 * by_s[1], unit=" %"))
    part.plots.append(("error-k-s.png", draw_shape, (by_k, by_s, images, truth)))
    return part


def _cut(field, quick, note):
    # Indirect light with cells cut ever finer; what the finest says is taken for true
    shares = (1, 2, 4) if quick else (1, 2, 4, 8)
    found = {}
    for s in shares:
        note(f"S = {s}")
        found[s] = gathered(field, 1, 16, s) - gathered(field, 0, 16)
    truth = found[shares[-1]]
    return {s: float(np.mean(np.abs(found[s] - truth)) / truth.mean()) for s in shares[:-1]}, shares[-1]
