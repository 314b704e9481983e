"""Local horizons against the marcher, the default against the better method, iterations, and growth with size."""

from __future__ import annotations

import gc

import numpy as np

from intervis.heightfield import HeightField, make
from intervis.heightfield.intervisibility import EVERY, EVERY_FLOAT32, TREE, totals
from intervis.heightfield.sweep import direction

from .heightfield_plots import growth as draw_growth
from .heightfield_tables import Part, Row, grid, interleave, keep_memory, ratio, spread, threads

# Floor and goal of the speed-up, and the paper's Table 2: iterations as a share of the naive method's, in %
PAPER = {"fractal": (1, 2.4, 2.4), "brick": (1.5, 4.2, 0.99), "sine": (5, 13, 0.62), "blocks": (4, 41, 0.78)}
WAYS = {"tree": TREE, "auto": None, "march, float64": EVERY, "march, float32": EVERY_FLOAT32}
SHORT = 3  # rounds of jobs of milliseconds, for one of the others


def directions(count: int) -> np.ndarray:
    """Azimuths all around, none along the grid."""
    return (np.arange(count) + 0.37) * (2 * np.pi / count)


def sweep(heights: np.ndarray, azimuths: np.ndarray, how: int | None) -> int:
    """Find all local horizons in some azimuths, keep none; return how much was looked at."""
    return sum(totals(direction(a, (1.0, 1.0)), heights, 0.0, how)[2] for a in azimuths)


def centred(name: str, size: int) -> np.ndarray:
    """Return a field's heights as sweeps take them."""
    h = make(name, size)
    return (h - h.mean()).astype(np.float32)


def measure(options, note) -> Part:
    """Measure the paper's four fields at 1024², and the fractal at 4096²."""
    threads(options.threads)
    part = Part("Local horizons against the marcher")
    part.text.append(
        "All local horizons of all points, used in place and not kept; at 1024² three times the repeats. The baseline marches"
        " sixteen lines at once in float32 on the same threads. Iterations, a point and direction: convexity checks of the"
        " tree, one of each child of the root in every step and one of each that is hidden or handed on. The fractal is"
        " spectral noise; the paper's is midpoint displacement. Lines here have one sample a column: the naive count;"
        " the paper's have 484 ahead of a point at 1024², of which its shares are: it counts 11.7, 4.80, 3.02 and 3.76"
        " iterations (fractal, brick, sine, blocks)."
    )
    table, size = [], 256 if options.quick else 1024
    cases = [(name, size, directions(8), WAYS) for name in PAPER]
    ways = {k: v for k, v in WAYS.items() if v != EVERY}
    cases.append(("fractal", 512 if options.quick else 4096, directions(1), ways))
    for n, (name, side, azimuths, ways) in enumerate(cases):
        note(f"local horizons: {name}, {side}²")
        heights = centred(name, side)
        looked = {}

        def job(way, h=heights, a=azimuths, found=looked):
            found[way] = sweep(h, a, WAYS[way])

        last = n == len(cases) - 1
        rounds = options.repeats if last else SHORT * options.repeats
        times = interleave({way: lambda w=way: job(w) for way in ways}, rounds, ways if n else ())
        part.timed(f"local horizons, {name}, {side}²", times)
        scale = len(azimuths) * heights.size
        naive = looked["march, float32"] / scale
        for way, count in looked.items():
            part.found(f"local horizons, {name}, {side}²", f"iterations, {way}", count / scale, "a point and direction")
        against = {way: ratio(times["march, float32"], times[way]) for way in ("auto", "tree")}
        floor, goal, share = (1.5, 5, None) if last else PAPER[name]
        part.rows.append(Row(f"local horizons against SIMD marcher, {name} {side}²", floor, goal, *against["auto"]))
        if not last:
            part.rows.append(
                Row(f"tree iterations, share of the marcher's, {name}", share, share, 100 * looked["tree"] / scale / naive,
                    unit=" %", less=True)
            )  # fmt: skip
        _default(part, f"local horizons, {name} {side}²", times)
        table.append(
            [name, f"{side}²"]
            + [f"{1e3 * np.median(times[w]) / len(azimuths):.3g}" if w in times else "" for w in WAYS]
            + [spread(against[w]) for w in ("auto", "tree")]
            + [f"{looked[w] / scale:.3g}" for w in ("tree", "auto")]
            + [f"{naive:.3g}"]
        )
    head = ["field", "points", *(f"{w}, ms" for w in WAYS), "auto's gain", "tree's gain"]
    part.text.append(grid([*head, "iterations, tree", "auto", "naive"], table))
    _horizon_methods(part, options, note, size)
    return part


def _default(part, case, times):
    # The default against the fastest of the others, which the user might have chosen
    others = [w for w in times if w != "auto"]
    best = min(others, key=lambda w: np.median(times[w]))
    part.rows.append(Row(f"`auto` against the better method ({best}): {case}", 0.9, 1.0, *ratio(times[best], times["auto"])))


def _horizon_methods(part, options, note, size):
    # Global horizons: the three methods
    table = []
    for name in PAPER:
        note(f"horizons, methods: {name}, {size}²")
        field = HeightField(make(name, size))
        azimuths = directions(8)
        times = interleave(
            {m: lambda f=field, m=m, a=azimuths: f.horizons(a, method=m) for m in ("tree", "auto", "march")},
            SHORT * options.repeats,
        )
        part.timed(f"horizons, {name}, {size}²", times)
        _default(part, f"horizons, {name} {size}²", times)
        rates = [f"{1e-6 * len(azimuths) * size * size / np.median(t):.3g}" for t in times.values()]
        table.append([name, *rates, spread(ratio(times["march"], times["auto"]))])
    part.text.append(f"Global horizons at {size}², millions a second:")
    part.text.append(grid(["field", "tree", "auto", "march", "auto's gain over march"], table))


def growth(options, note) -> Part:
    """Measure how time grows with the points of a fractal."""
    threads(options.threads)
    keep_memory()
    part = Part("Growth with size")
    part.text.append(
        "Exponents of time over points, fitted over all sizes, and in the note over single doublings of the side: the last"
        " tell most about larger fields, the first hold what a direction costs whatever its size. Times are a direction's."
        " The spectral fractal keeps the slopes of its largest features: doubling its side adds detail. Freed memory is kept,"
        " as for the peers."
    )
    sizes = (64, 128, 256, 512) if options.quick else (256, 512, 1024, 2048, 4096, 8192)
    azimuths = {"horizons": directions(3), "local horizons": directions(1)}
    times = {"horizons": {}, "local horizons": {}}
    for size in sizes:
        note(f"growth: {size}²")
        raw = make("fractal", size).astype(np.float32)
        field = HeightField(raw)
        heights = raw - np.float32(raw.mean())
        del raw
        found = interleave(
            {
                "horizons": lambda f=field: f.horizons(azimuths["horizons"]),
                "local horizons": lambda h=heights: sweep(h, azimuths["local horizons"], None),
            },
            options.repeats,
            cold=("local horizons",) if size > 2048 else (),
        )
        for what, t in found.items():
            times[what][size] = [x / len(azimuths[what]) for x in t]
        part.timed(f"growth, {size}²", {what: times[what][size] for what in times})
        del field, heights
        gc.collect()
    table = []
    for what, limits in (("horizons", (1.10, 1.05)), ("local horizons", (1.30, 1.15))):
        t = np.array([times[what][s] for s in sizes])
        x = 2 * np.log(sizes)
        value, *ends = (float(np.polyfit(x, np.log(v), 1)[0]) for v in (np.median(t, axis=1), *t.T))
        each = np.diff(np.log(np.median(t, axis=1))) / np.diff(x)
        part.rows.append(
            Row(f"exponent of time over points, {what}, fractal {sizes[0]}²–{sizes[-1]}²", *limits, value, min(ends),
                max(ends), unit="", less=True, note="by doubling: " + ", ".join(f"{e:.2f}" for e in each))
        )  # fmt: skip
        table.append([what, *(f"{1e3 * v:.3g}" for v in np.median(t, axis=1))])
    part.text.append(grid(["ms a direction", *(f"{s}²" for s in sizes)], table))
    part.plots.append(("growth.png", draw_growth, times))
    return part
