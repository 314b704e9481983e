"""Irradiance against path tracing of the same surface, and its error against azimuths (K) and samples on lines (S)."""

from __future__ import annotations

import time

import mitsuba as mi
import numpy as np

from intervis.heightfield import HeightField, example, make

from .heightfield_path import path_irradiance, scene_of
from .heightfield_plots import ladders as draw_ladders
from .heightfield_plots import shape as draw_shape
from .heightfield_tables import Part, Row, grid, interleave, threads

SKY, SUN, ALBEDO, BOUNCES, AZIMUTHS = 30.0, (np.radians(300.0), np.radians(25.0), 800.0), 0.4, 2, 64


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
    samples = 64 if options.quick else 256
    part.text.append(
        f"Sky {SKY:g} W/(m² sr), sun {SUN[2]:g} W/m² {np.degrees(SUN[1]):.0f}° high, albedo {ALBEDO:g}, {BOUNCES} bounces,"
        f" K = {AZIMUTHS}; relative RMSE over all points, border too. The reference is two independent traces of {samples}"
        " paths a point: errors are means of the product of the differences from both, so that their noise drops out (what"
        " two standard errors of what is left may hide is in brackets). The path tracer's error is its noise, from pairs of"
        " independent runs; the time at which it reaches ours, bracket included, is interpolated in its ladder, beyond it"
        " time × error² is constant (~). Its scene is built beforehand. Most of our error comes from the bounces: what the"
        " surface sends is straight over a triangle, where the tracer looks at the point that it hits. S = 2: with"
        " `supersampling=2`."
    )
    table, plotted, worst, gains = [], {}, (0.0, ""), {}
    for name, field in fields(options.quick).items():
        note(f"light: {name}")
        scene = scene_of(field, SKY, SUN, ALBEDO)
        mean, (error, doubt), (finer, finer_doubt) = _errors(field, samples, scene)
        worst = max(worst, (error, name))
        rungs = (1, 4, 16) if options.quick else (1, 4, 16, 64)
        jobs = {f"path, {n}": lambda n=n, f=field, s=scene: traced(f, n, 0, s) for n in rungs}
        own = {"intervis": lambda f=field: gathered(f), "intervis, S = 2": lambda f=field: gathered(f, s=2)}
        times = interleave({**own, **jobs}, options.repeats)
        part.timed(f"light, {name}", times)
        noise = _noise(field, rungs, mean, scene)
        rows = [(n, np.median(times[f"path, {n}"]), noise[n]) for n in rungs]
        ours = float(np.median(times["intervis"]))
        # A ratio a round, from the round's own times
        each = []
        # No error below what can be told from the reference's noise
        goal = error + doubt
        for k in range(options.repeats):
            t = [times[f"path, {n}"][k] for n in rungs]
            each.append(reach(t, list(noise.values()), goal)[0] / times["intervis"][k])
        seconds, mark = reach([r[1] for r in rows], [r[2] for r in rows], goal)
        gains[name] = (seconds / ours, min(each), max(each), mark)
        plotted[name] = ([r[1] for r in rows], [r[2] for r in rows], ours, goal)
        for n, _, e in rows:
            part.found(f"light, {name}", f"relative RMSE, path, {n}", e, "")
        part.found(f"light, {name}", "relative RMSE", error, "")
        part.found(f"light, {name}", "relative RMSE, S = 2", finer, "")
        table.append(
            [name, f"{100 * error:.3g} [+{100 * doubt:.1g}]", f"{ours:.3g}", f"{mark}{seconds:.3g}",
             f"{mark}{seconds / ours:.3g}× [{min(each):.3g}, {max(each):.3g}]",
             f"{np.median(times['intervis, S = 2']):.3g} s: {100 * finer:.3g} [+{100 * finer_doubt:.1g}]",
             *(f"{t:.2g} s: {100 * e:.3g}" for _, t, e in rows)]
        )  # fmt: skip
    part.rows.append(Row(f"irradiance, 2 bounces, K = {AZIMUTHS}, relative RMSE, worst field ({worst[1]})", 2, 0.5,
                         100 * worst[0], unit=" %", less=True,
                         note="; ".join(f"{r[0]} {r[1].split()[0]}" for r in table)))  # fmt: skip
    for name, (value, low, high, mark) in gains.items():
        part.rows.append(Row(f"time of the path tracer to the same error, {name}", 10, 50, value, low, high, mark=mark))
    head = [
        "field",
        "our RMSE, %",
        "our s",
        "path tracer's s",
        "ratio",
        "S = 2",
        *(f"path, {n} a point: RMSE, %" for n in rungs),
    ]
    part.text.append(grid(head, table))
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


def _errors(field, samples, scene):
    # Mean of the reference; for S = 1 and 2 our relative RMSE without the reference's noise, and the doubt that it leaves
    a, b = (traced(field, samples, seed, scene) for seed in (11, 12))
    mean = float((a + b).mean() / 2)
    out = []
    for s in (1, 2):
        ours = gathered(field, s=s)
        product = (ours - a) * (ours - b)
        mse = max(float(product.mean()), 0.0)
        most = np.sqrt(mse + 2 * float(product.std()) / np.sqrt(product.size))
        out.append((np.sqrt(mse) / mean, (most - np.sqrt(mse)) / mean))
    return mean, *out


def _noise(field, rungs, mean, scene):
    # Relative RMS noise of a run, from two with other seeds
    out = {}
    for n in rungs:
        a, b = (traced(field, n, seed, scene) for seed in (21, 22))
        out[n] = float(np.sqrt(np.mean((a - b) ** 2) / 2) / mean)
    return out


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
