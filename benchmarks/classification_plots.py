"""Plots of the classification benchmark."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

from intervis.visibility import COLORS, NAMES

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.patches import Patch  # noqa: E402

SHORT = ("visible", "invisible", "p. solid", "f. see-thr.", "p. see-thr.", "f. sol.+s.t.", "p. sol.+s.t.")


def confusions(path: Path, matrices: dict) -> None:
    """Draw confusion matrices, each row as shares of its truth."""
    columns = min(3, len(matrices))
    rows = -(-len(matrices) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(4 * columns, 3.9 * rows), squeeze=False)
    for axis, ((name, kind), m) in zip(axes.flat, matrices.items(), strict=True):
        share = m / np.maximum(m.sum(1, keepdims=True), 1)
        axis.imshow(share, cmap="Blues", vmin=0, vmax=1)
        for i, j in np.argwhere(share >= 0.005):
            axis.text(
                j,
                i,
                f"{100 * share[i, j]:.0f}",
                ha="center",
                va="center",
                fontsize=7,
                color="w" if share[i, j] > 0.5 else "k",
            )
        axis.set_title(f"{kind}, {name}: {100 * np.trace(m) / m.sum():.1f} %", fontsize=9)
        axis.set_xticks(range(7), SHORT, rotation=60, ha="right", fontsize=7)
        axis.set_yticks(range(7), SHORT, fontsize=7)
    _save(figure, path)


def curves(path: Path, data: dict) -> None:
    """Draw accuracy against gray levels, cells, rays and region size."""
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.2), sharey=True)
    titles = {
        "levels": "gray levels G",
        "cells": "n (n×n cells)",
        "rays": "rays a cell",
        "region": "smallest region",
    }
    for axis, (name, title) in zip(axes, titles.items(), strict=True):
        table = np.array(data[name], float)
        if name in ("levels", "cells"):
            labels = ("exact", "4 to 8 rays")
        else:
            labels = tuple(f"{k}, {g}" for g in ("7 classes", "4 groups") for k in ("mlp", "svm", "threshold"))
        for k, label in enumerate(labels):
            axis.plot(
                table[:, 0],
                table[:, k + 1],
                "o-" if k < 3 else "s--",
                ms=3,
                lw=1,
                color=f"C{k % 3}",
                label=label,
            )
        if name == "rays":
            axis.set_xscale("log", base=2)
        axis.set_xlabel(title)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=6)
    axes[0].set_ylabel("accuracy")
    axes[0].set_ylim(0.6, 1.005)
    _save(figure, path)


def class_maps(path: Path, maps: dict[str, np.ndarray]) -> None:
    """Draw class maps side by side, with the legend."""
    palette = np.array([*COLORS, (1, 1, 1)])
    figure, axes = plt.subplots(2, 3, figsize=(12, 5))
    for axis, (name, classes) in zip(axes.flat, maps.items(), strict=False):
        axis.imshow(palette[classes], interpolation="nearest")
        axis.set_title(name, fontsize=9)
    for axis in axes.flat:
        axis.axis("off")
    handles = [Patch(facecolor=c, edgecolor="gray", label=n) for c, n in zip(COLORS, NAMES, strict=True)]
    axes.flat[-1].legend(handles=handles, loc="center", fontsize=9, frameon=False)
    _save(figure, path)


def _save(figure, path: Path) -> None:
    """Write a small PNG: a palette of 64 colours is plenty for plots."""
    from PIL import Image

    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)
