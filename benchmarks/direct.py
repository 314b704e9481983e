"""Direct light: `visdirect` against Mitsuba's `direct`, at equal error.

``python -m benchmarks.direct`` writes ``docs/direct/table.md``, ``table.csv`` and plots.
"""

from __future__ import annotations

import argparse
import pickle
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

import intervis
import intervis.scenes

OUT = Path(__file__).resolve().parent.parent / "docs" / "direct"
CONSISTENT = ("grating", "fence", "foliage")
MEMORY = ("penumbra", "foliage", "manylights")

TEXT = """# Direct light, measured

{machine}. Films of {width}×{height}; {repeats} repeats, warm, interleaved over all configurations of a scene.
relMSE is mean((x − ref)² / (ref² + 0.01)), averaged over the repeats' seeds, the reference's own error taken off;
times are medians. A ratio is the time of the setting of `direct` over that of `visdirect` at the same error
(log-log interpolation in its budget), with a 95 % bootstrap interval over repeats. `≥`: the smallest budget is
already better; `~`: extrapolated beyond the largest (time × error constant). The best setting of `direct` is the
one of least error × time at that budget.

## Figures
{figures}

## By scene
{scenes}

![error against time](time.png)
![error against rays](rays.png)
![time ratios](speedup.png)
![gain against penumbra](penumbra.png)

## At 64 samples a pixel
{errors}
"""

BIAS = """
## Bias and the error layer
The mean of {seeds} seeds at {spp} samples a pixel against as many renders of `direct` with multijitter at 64, by the class
of the pixel: difference ± standard error, relative to the mean over the class, in parts per million (z). The last column is
the rms of the `error` layer over the rms error measured between seeds.

{bias}
"""

ABLATION = """
## What each part adds
Error · time = their product, each over that of the full integrator, at {spp} samples a pixel: above 1 means that the
part helps. Parts changed one at a time.

{ablation}

## Budgets against an oracle
The oracle knows the variance of every pixel ({seeds} renders with uniform budgets) and spends the same budget by it;
where those show none, it spends the least.

{oracle}
"""


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark, print the report and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.direct", description=__doc__)
    parser.add_argument("--scenes", help="comma-separated names (default: all built-in scenes)")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="small films, coarse references: a trial, not a measurement")
    parser.add_argument("--reference", type=int, default=4096, help="samples a pixel of the references")
    parser.add_argument("--cache", type=Path, default=Path.home() / ".cache" / "intervis" / "benchmark")
    parser.add_argument("--resume", action="store_true", help="take the scenes that an interrupted run has finished from it")
    parser.add_argument("--output", type=Path, default=OUT)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    options = parser.parse_args(arguments)
    mi.set_variant(options.variant)

    # These define kernels and patches for the active variant
    from . import direct_ablation, direct_bias, direct_checks, direct_plots, direct_runs, direct_stats, direct_tables

    names = options.scenes.split(",") if options.scenes else intervis.scenes.names()
    width, height = (240, 135) if options.quick else (480, 270)
    samples = min(options.reference, 1024) if options.quick else options.reference
    results, references, shares, parts, oracles, light, bias = {}, {}, {}, {}, {}, {}, {}
    start = time.perf_counter()

    def note(text):
        print(f"{time.perf_counter() - start:6.0f} s  {text}", file=sys.stderr, flush=True)

    def measure(name):
        s = direct_runs.setup(name, width, height)
        note(f"{name}: bias")
        bias[name] = direct_bias.bias(direct_runs.setup(name, width // 2, height // 2), seeds=8 if options.quick else 64)
        if name == "openfloor":
            note("openfloor: light noise")
            light.update(direct_checks.light_noise(s))
        note(f"{name}: reference")
        direct_runs.add_reference(s, options.cache, samples)
        references[name] = s.reference_error
        note(f"{name}: competitors")
        results[name] = direct_runs.compete(s, options.repeats)
        shares[name] = direct_checks.penumbra_share(s)
        if name in direct_ablation.SCENES:
            note(f"{name}: ablation and oracle")
            count = 2 if options.quick else 3
            parts[name] = direct_ablation.ablate(s, 64, count)
            oracles[name] = direct_ablation.regret(s, 64, count)

    # What is done is kept: interrupted, it reports those scenes, and may be resumed
    found = results, references, shares, parts, oracles, light, bias
    kept = options.cache / ("trial.pickle" if options.quick else "direct.pickle")
    if options.resume and kept.exists():
        for mine, old in zip(found, pickle.loads(kept.read_bytes()), strict=True):
            mine.update(old)
    for name in names:
        if name in shares:
            continue
        try:
            measure(name)
        except KeyboardInterrupt:
            results.pop(name, None)
            note("interrupted: reporting the scenes that are done")
            break
        for run in results[name]:
            run.render = None
        options.cache.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(pickle.dumps(found))
    names = [n for n in names if n in results and n in shares]
    results = {n: results[n] for n in names}
    memory = {n: direct_checks.peak_memory(n) for n in MEMORY if n in names and not options.quick}

    # Compare at equal error
    independent = {
        n: next(r for r in direct_stats.select(v, "mitsuba", 256) if r.setting == "independent ×1")
        for n, v in results.items()
    }
    ratios = {"independent": {n: direct_stats.ratio(results[n], r, "unbiased") for n, r in independent.items()}}
    for budget in (64, 256):
        for key, mode in (("best", "unbiased"), ("consistent", "consistent")):
            ratios[f"{key}{budget}"] = {
                n: direct_stats.ratio(runs, direct_stats.best(runs, budget), mode) for n, runs in results.items()
            }
    ratios["consistent"] = {n: r for n, r in ratios["consistent64"].items() if n in CONSISTENT}
    overhead = {
        n: float(np.median(next(r for r in runs if r.family == "unbiased" and r.budget == 64).overhead))
        for n, runs in results.items()
    }

    # Report
    options.output.mkdir(parents=True, exist_ok=True)
    text = TEXT.format(
        machine=direct_tables.machine(),
        width=width,
        height=height,
        repeats=options.repeats,
        figures=direct_tables.figures(ratios, overhead, light, memory, direct_bias.verdict(bias)),
        scenes=direct_tables.scenes(results, ratios, shares),
        errors=direct_tables.errors(results, references),
    )
    if light:
        text += (
            f"\nOpen floor: two seeds differ by at most {light['noise']:.1e} of a pixel with camera rays through pixel"
            f" centres, {light['jittered']:.1e} with jittered ones (what varies inside a pixel).\n"
        )
    if memory:
        text += (
            "\nPeak memory: "
            + ", ".join(
                f"{n} {b / 2**30:.2f} GiB" if np.isfinite(b) else f"{n}: the render failed" for n, b in memory.items()
            )
            + ".\n"
        )
    if parts:
        tables = (direct_tables.ablation(parts), direct_tables.oracle(oracles))
        text += ABLATION.format(spp=64, seeds=direct_ablation.SEEDS, ablation=tables[0], oracle=tables[1])
    text += BIAS.format(seeds=direct_bias.SEEDS, spp=direct_bias.SPP, bias=direct_tables.bias(bias))
    (options.output / "table.md").write_text(text)
    if results:
        direct_tables.write_csv(options.output / "table.csv", results)
        direct_plots.convergence(options.output / "time.png", results, "time")
        direct_plots.convergence(options.output / "rays.png", results, "rays")
        groups = {"best direct, 64 spp error": ratios["best64"], "256 spp error": ratios["best256"]}
        direct_plots.speedups(options.output / "speedup.png", {**groups, "independent, 256 spp error": ratios["independent"]})
        direct_plots.penumbra(options.output / "penumbra.png", shares, ratios["best64"])
    note("done")
    print(text)


if __name__ == "__main__":
    main()
