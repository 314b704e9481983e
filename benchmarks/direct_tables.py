"""Tables of the direct-light benchmark, as Markdown and CSV."""

from __future__ import annotations

import csv
import os
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np

from .direct_runs import Run
from .direct_stats import Ratio, best, together, worst


def machine() -> str:
    """Name the machine and the versions that were measured."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        found = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        model = found[0] if found else model
    packages = ", ".join(f"{p} {version(p)}" for p in ("mitsuba", "drjit", "numpy"))
    return f"{len(os.sched_getaffinity(0))} cores ({model}), Python {platform.python_version()}, {packages}"


def grid(head: list[str], rows: list[list]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def write_csv(path: Path, results: dict[str, list[Run]]) -> None:
    """Write every configuration: median and quartiles of its time, mean and spread of its error, rays."""
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(
            "scene integrator setting spp seconds seconds_q1 seconds_q3 relmse relmse_std rays_a_pixel repeats".split()
        )
        for name, runs in results.items():
            for r in runs:
                q1, median, q3 = np.percentile(r.times, [25, 50, 75])
                numbers = (median, q1, q3, np.mean(r.errors), np.std(r.errors), r.rays)
                kind = "direct" if r.family == "mitsuba" else "visdirect"
                out.writerow([name, kind, r.setting, r.budget, *(f"{x:.4g}" for x in numbers), len(r.times)])


def _met(value: float, floor: float, goal: float, less: bool = False) -> str:
    if less:
        value, floor, goal = -value, -floor, -goal
    return "goal" if value >= goal else "floor" if value >= floor else "**no**"


def figures(ratios: dict[str, dict[str, Ratio]], overhead: dict[str, float], light: dict, memory: dict, bias: dict) -> str:
    """Return the table of what was to be reached, and what was."""
    rows = []

    def add(what, floor, goal, ratio, note=""):
        wanted = [f"{x:g}×" for x in (floor, goal)]
        rows.append([what, *wanted, f"{ratio}{note}", _met(ratio.value, floor, goal)])

    if ratios["best64"]:
        add("best `direct`, its 64 spp error, geometric mean", 1.8, 4, together([*ratios["best64"].values()]))
        add("best `direct`, its 256 spp error, geometric mean", 2.2, 6, together([*ratios["best256"].values()]))
        for budget in (64, 256):
            name, ratio = worst(ratios[f"best{budget}"])
            add(f"worst scene, {budget} spp error", 0.9, 1, ratio, f" ({name})")
        add("independent sampling, its 256 spp error, geometric mean", 20, 40, together([*ratios["independent"].values()]))
    if ratios["consistent"]:
        name = ", ".join(ratios["consistent"])
        add(f"`consistent` on {name}, 64 spp error, geometric mean", 3, 6, together([*ratios["consistent"].values()]))
        name, ratio = worst(ratios["consistent"])
        add("the same, worst of them", 3, 6, ratio, f" ({name})")
    if light:
        exact = light["noise"] < 1e-5
        met = "goal" if exact and light["shadow_rays"] == 0 else "floor" if exact else "**no**"
        text = f"{light['noise']:.1e} relative, {light['shadow_rays']:.1f} shadow rays a pixel"
        rows.append(["fully visible rectangle, Lambertian floor: light noise", "rounding", "and no shadow rays", text, met])
    if overhead:
        name = max(overhead, key=overhead.get)
        text = f"{100 * np.mean([*overhead.values()]):.1f} % (most {100 * overhead[name]:.1f} %, {name})"
        rows.append(
            ["pilot + classification, share of time at 64 spp", "15 %", "5 %", text, _met(overhead[name], 0.15, 0.05, True)]
        )
    if memory:
        name = max(memory, key=memory.get)
        size = memory[name] / 2**30
        text = f"{size:.2f} GiB ({name})"
        failed = ", ".join(n for n, b in memory.items() if not np.isfinite(b))
        if failed:
            text = f"the render failed ({failed})"
        rows.append(["1280×720 at 64 spp, peak memory", "2 GiB", "1 GiB", text, _met(size, 2, 1, True)])
    text = (
        f"largest |z| {bias['z']:.2f} ({bias['where']}) of {bias['tests']} tests, limit {bias['limit']:.2f}; "
        f"largest difference of a scene's mean {bias['bias']:.0e}"
    )
    met = _met(bias["bias"], 1e-3, 1e-4, True) if bias["z"] < bias["limit"] else "**no**"
    rows.append(["bias of `unbiased`", "< 1e-3 of the mean, not significant", "< 1e-4", text, met])
    rows.append(["classification accuracy, held-out patterns", "98 %", "99.5 %", "see `benchmarks.classification`", ""])
    return grid(["figure", "floor", "goal", "measured", "met"], rows)


def scenes(results: dict[str, list[Run]], ratios: dict[str, dict[str, Ratio]], shares: dict[str, float]) -> str:
    """Return the table of ratios by scene."""
    rows = []
    for name, runs in results.items():
        cells = [ratios[k].get(name, "") for k in ("best64", "best256", "independent", "consistent64", "consistent256")]
        setting = " / ".join(dict.fromkeys([best(runs, 64).setting, best(runs, 256).setting]))
        rows.append([name, f"{100 * shares[name]:.0f} %", setting, *cells])
    head = [
        "scene",
        "penumbra",
        "best `direct` (64 / 256 spp)",
        "64 spp error",
        "256 spp error",
        "independent, 256 spp error",
    ]
    return grid([*head, "`consistent`, 64 spp error", "`consistent`, 256 spp error"], rows)


def errors(results: dict[str, list[Run]], references: dict[str, float]) -> str:
    """Return errors and times at 64 samples a pixel, and the references' own error."""
    rows = []
    for name, runs in results.items():
        for r in [best(runs, 64), *(r for r in runs if r.family != "mitsuba" and r.budget == 64)]:
            q1, median, q3 = np.percentile(r.times, [25, 50, 75])
            text = f"{median:.3f} ({q1:.3f} to {q3:.3f})"
            kinds = ", ".join(f"{k} {v / 1e6:.1f} M" for k, v in r.kinds.items() if v)
            rows.append([name, r.label, text, f"{np.mean(r.errors):.2e}", f"{r.rays:.0f}", kinds, f"{references[name]:.1e}"])
    head = ["scene", "integrator", "seconds (quartiles)", "relMSE", "rays a pixel", "rays by kind", "reference's relMSE"]
    return grid(head, rows)


def bias(found: dict[str, dict[str, dict]]) -> str:
    """Return the bias of every scene and class, and the calibration of the error layer."""
    classes = list(dict.fromkeys(n for t in found.values() for n in t if n != "error layer"))
    rows = []
    for scene, table in found.items():
        parts = [table.get(n) for n in classes]
        cells = [f"{1e6 * t['bias']:.0f} ± {1e6 * t['deviation']:.0f} ({t['z']:.1f})" if t else "" for t in parts]
        rows.append([scene, *cells, f"{table['error layer']['ratio']:.2f}"])
    return grid(["scene", *(n.replace("_", " ") for n in classes), "error layer"], rows)


def ablation(parts: dict[str, dict[str, dict]]) -> str:
    """Return error, time and their product against the full integrator, for each part and scene."""
    rows = []
    for part in next(iter(parts.values())):
        cells = []
        for table in parts.values():
            x = table[part]
            product = x["error_ratio"] * x["time_ratio"] if x else 0
            cells.append(f"{x['error_ratio']:.2f} · {x['time_ratio']:.2f} = {product:.2f}" if x else "not available")
        rows.append([part, *cells])
    return grid(["part changed", *parts], rows)


def oracle(found: dict[str, dict]) -> str:
    """Return the budgets' regret against the oracle's."""
    rows = [
        [
            n,
            f"{x['error']:.2e}",
            f"{x['rays']:.0f}",
            f"{x['oracle_error']:.2e}",
            f"{x['oracle_rays']:.0f}",
            f"{100 * x['regret']:.0f} %",
        ]
        for n, x in found.items()
    ]
    return grid(["scene", "relMSE", "rays a pixel", "oracle's relMSE", "oracle's rays a pixel", "regret"], rows)
