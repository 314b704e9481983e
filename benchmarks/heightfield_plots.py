"""Plots of the height-field benchmark."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator  # noqa: E402


def growth(path: Path, times: dict[str, dict[int, list[float]]]) -> None:
    """Draw time a direction against points, with their spread, beside linear growth."""
    figure, axis = plt.subplots(figsize=(5, 3.4))
    for k, (what, by_size) in enumerate(times.items()):
        x = np.array(list(by_size), dtype=float) ** 2
        t = 1e3 * np.array(list(by_size.values()))
        m = np.median(t, axis=1)
        axis.errorbar(x, m, [m - t.min(1), t.max(1) - m], fmt="o-", ms=3, lw=1.3, capsize=2, color=f"C{k}", label=what)
        axis.plot(x, m[-1] * x / x[-1], ":", color=f"C{k}", lw=0.9, label="linear" if k == 0 else None)
    axis.set(xscale="log", yscale="log", xlabel="points", ylabel="ms a direction")
    axis.xaxis.set_major_locator(FixedLocator(x))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.set_xticklabels([f"{s}²" for s in by_size], fontsize=8)
    axis.legend(fontsize=8)
    _save(figure, path)


def errors(path: Path, found: dict[str, np.ndarray]) -> None:
    """Draw how many horizons err by more than an angle."""
    figure, axis = plt.subplots(figsize=(5, 3.4))
    for k, (name, e) in enumerate(found.items()):
        axis.plot(np.maximum(np.sort(e)[::-1], 1e-7), (np.arange(len(e)) + 1) / len(e), lw=1.4, color=f"C{k}", label=name)
    axis.axvline(0.01, color="k", lw=0.8, ls=":")
    axis.axhline(0.01, color="k", lw=0.8, ls=":")
    axis.set(xscale="log", yscale="log", xlabel="error of the horizon, degrees", ylabel="share of rays that err more")
    axis.legend(fontsize=8)
    _save(figure, path)


def ladders(path: Path, found: dict[str, tuple]) -> None:
    """Draw relative RMSE against time: the path tracer's ladder and ours for some S, one panel a field."""
    columns = min(3, len(found))
    rows = -(-len(found) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(2.9 * columns, 2.4 * rows), squeeze=False, sharey=True)
    for axis in axes.flat[len(found) :]:
        axis.axis("off")
    for axis, (name, (t, e, ours)) in zip(axes.flat, found.items(), strict=False):
        axis.plot(t, np.multiply(100, e), ".-", color="C0", lw=1, label="path tracer")
        for k, (label, rungs) in enumerate(ours.items()):
            seconds, error = np.transpose(rungs)
            axis.plot(seconds, 100 * error, ".-", lw=1, color=f"C{3 - 2 * k}", label=f"intervis, {label}")
        axis.set(xscale="log", yscale="log")
        axis.set_title(name, fontsize=9)
        axis.tick_params(labelsize=7)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.grid(alpha=0.25)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative RMSE, %", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("seconds", fontsize=8)
    axes[0, 0].legend(fontsize=7)
    _save(figure, path)


def shape(path: Path, data) -> None:
    """Draw error against K and S, and where it lies for some K (white 0 %, black 10 %, as the paper's Figure 14)."""
    by_k, by_s, images, truth = data
    shown = [k for k in (4, 16, 64) if k in images] or list(images)[-1:]
    panels, widths = 2 + len(shown), [1.8] + [1] * (1 + len(shown))
    figure, axes = plt.subplots(1, panels, figsize=(1.5 + 1.9 * panels, 2.7), width_ratios=widths)
    for k, (label, by) in enumerate((("K, azimuths", by_k), ("S, samples a cell", by_s))):
        axes[0].plot(list(by), [100 * e for e in by.values()], "o-", ms=3, lw=1.3, color=f"C{3 - 3 * k}", label=label)
    axes[0].set(xscale="log", yscale="log", xlabel="K or S", ylabel="mean error of indirect light, %")
    axes[0].xaxis.set_major_locator(FixedLocator([1, *by_k]))
    axes[0].xaxis.set_minor_locator(NullLocator())
    axes[0].set_xticklabels([str(k) for k in (1, *by_k)], fontsize=7)
    axes[0].tick_params(axis="y", labelsize=7)
    axes[0].yaxis.set_major_formatter("{x:g}")
    axes[0].legend(fontsize=7)
    axes[0].grid(alpha=0.25)
    axes[1].imshow(truth, cmap="gray", vmin=0, vmax=np.percentile(truth, 99))
    axes[1].set_title("indirect light", fontsize=8)
    for axis, k in zip(axes[2:], shown, strict=True):
        axis.imshow(np.abs(images[k] - truth) / np.maximum(truth, 1e-3 * truth.mean()), cmap="gray_r", vmin=0, vmax=0.1)
        axis.set_title(f"error, K = {k}", fontsize=8)
    for axis in axes[1:]:
        axis.set(xticks=[], yticks=[])
    _save(figure, path)


def _save(figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)
