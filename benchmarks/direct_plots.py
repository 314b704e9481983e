"""Plots of the direct-light benchmark."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

from .direct_runs import Run
from .direct_stats import Ratio

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.ticker import NullFormatter  # noqa: E402

COLORS = {"independent": "C7", "multijitter": "C0", "ldsampler": "C2", "unbiased": "C3", "consistent": "C1"}


def convergence(path: Path, results: dict[str, list[Run]], axis_name: str) -> None:
    """Draw error against time (``axis_name`` "time") or against rays a pixel ("rays"), one panel a scene."""
    columns = min(4, len(results))
    rows = -(-len(results) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(3.1 * columns, 2.5 * rows + 0.5), squeeze=False)
    for axis in axes.flat[len(results) :]:
        axis.axis("off")
    for axis, (name, runs) in zip(axes.flat, results.items(), strict=False):
        for label in dict.fromkeys(r.label for r in runs):
            series = sorted((r for r in runs if r.label == label), key=lambda r: r.budget)
            ours = series[0].family != "mitsuba"
            color = COLORS[series[0].setting.split()[0]]
            style = "o-" if ours else "-." if label.endswith("4") else ".-"
            x = [np.median(r.times) if axis_name == "time" else r.rays for r in series]
            axis.plot(x, [np.mean(r.errors) for r in series], style, color=color, lw=1.6 if ours else 0.9, ms=3, label=label)
        axis.set(xscale="log", yscale="log")
        axis.set_title(name, fontsize=9)
        axis.tick_params(labelsize=6)
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.grid(alpha=0.25)
    for axis in axes[:, 0]:
        axis.set_ylabel("relMSE", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("seconds" if axis_name == "time" else "rays a pixel", fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncol=4, fontsize=7, loc="lower center", frameon=False)
    figure.tight_layout(rect=(0, 0.9 / (2.5 * rows + 0.5) * 0.5, 1, 1))
    _save(figure, path)


def speedups(path: Path, groups: dict[str, dict[str, Ratio]]) -> None:
    """Draw a bar for each scene and comparison, with its bootstrap interval."""
    names = list(next(iter(groups.values())))
    figure, axis = plt.subplots(figsize=(max(5, 0.8 * len(names) + 2), 3))
    width = 0.8 / len(groups)
    for k, (label, ratios) in enumerate(groups.items()):
        x = np.arange(len(names)) + (k - (len(groups) - 1) / 2) * width
        value = np.array([ratios[n].value for n in names])
        low, high = np.array([np.percentile(ratios[n].draws, [2.5, 97.5]) for n in names]).T
        error = np.maximum([value - low, high - value], 0)
        axis.bar(x, value, width, yerr=error, label=label, color=f"C{k}", error_kw={"lw": 0.7})
    axis.axhline(1, color="k", lw=0.7)
    axis.set_yscale("log")
    axis.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=8)
    axis.set_ylabel("time ratio at equal error", fontsize=8)
    axis.legend(fontsize=7)
    figure.tight_layout()
    _save(figure, path)


def penumbra(path: Path, shares: dict[str, float], ratios: dict[str, Ratio]) -> None:
    """Draw the gain against the share of penumbra pixels, one point a scene."""
    figure, axis = plt.subplots(figsize=(5, 3.2))
    for name, share in shares.items():
        axis.plot(100 * share, ratios[name].value, "o", color="C3", ms=4)
        axis.annotate(name, (100 * share, ratios[name].value), fontsize=7, xytext=(4, 2), textcoords="offset points")
    axis.axhline(1, color="k", lw=0.7)
    axis.set_yscale("log")
    axis.set_xlabel("penumbra pixels, %", fontsize=8)
    axis.set_ylabel("time ratio, best `direct`, 64 spp error", fontsize=8)
    axis.grid(alpha=0.25)
    figure.tight_layout()
    _save(figure, path)


def _save(figure, path: Path) -> None:
    figure.savefig(path, dpi=90)
    plt.close(figure)
