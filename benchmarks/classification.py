"""How well visibility configurations are told apart: ``python -m benchmarks.classification``.

Writes tables (Markdown, CSV) and plots to ``docs/classification/``: held-out patterns, the paper's
Table 2, accuracy against gray levels, clusters and rays, 3D scenes against dense visibility, and
what a classification costs.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np

import intervis  # noqa: F401  (chooses the LLVM before Dr.Jit loads one)
from intervis.visibility import GROUPS, NAMES, features, grid_positions, patterns, weights
from intervis.visibility.mlp import MLP
from intervis.visibility.train import COUNT as TRAINING
from intervis.visibility.train import samples

from . import classification_plots as plots
from . import classification_scenes as scenes

HELD_OUT = 10_001  # training seeds are 0 and 1
COUNT = 12_000
KINDS = tuple(weights.KINDS)
MEASURED = (4, 8)


def confusion(truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Return the 7×7 counts: rows are the truth, columns what was found."""
    return np.bincount(truth * 7 + found, minlength=49).reshape(7, 7)


def accuracies(truth: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """Return the accuracy over seven classes and over the integrator's four groups."""
    group = np.array(GROUPS)
    return float(np.mean(truth == found)), float(np.mean(group[truth] == group[found]))


def held_out(rays, n: int = 4, region: float = patterns.REGION, levels: int = 4, seed: int = HELD_OUT):
    """Return features and labels of patterns that no training has seen."""
    fractions, labels = patterns.generate(COUNT // 2, seed, n, rays, region)
    return features(fractions, grid_positions(n), levels), labels


class Writer:
    """Collects tables: each one a CSV file and a section of the page."""

    def __init__(self, folder: Path):
        self.folder, self.page = folder, ["# Classification of visibility configurations: results\n"]
        folder.mkdir(parents=True, exist_ok=True)

    def table(self, name: str, title: str, head: list, rows: list, note: str = "") -> None:
        """Write one table; floats below 2 are shares and shown as percentages on the page."""
        with open(self.folder / f"{name}.csv", "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])
        shown = [[f"{100 * v:.1f} %" if isinstance(v, float) and v < 2 else str(v) for v in row] for row in rows]
        lines = [head, ["---"] * len(head), *shown]
        self.page.append(f"## {title}\n\n{note}\n" if note else f"## {title}\n")
        self.page.append("\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n")
        print(f"\n{title}\n" + "\n".join("  ".join(f"{str(v):>14.14}" for v in line) for line in [head, *shown]))

    def close(self) -> None:
        """Write the page."""
        (self.folder / "README.md").write_text("\n".join(self.page))


def held_out_accuracy(out: Writer) -> None:
    """Confusion and accuracy of the shipped classifiers on new patterns, exact and measured by few rays."""
    rows, matrices = [], {}
    for rays, name in ((None, "exact"), (MEASURED, "4 to 8 rays a cell")):
        x, y = held_out(rays)
        for kind in KINDS:
            found = weights.load(kind).predict(x)
            rows.append([name, kind, *accuracies(y, found)])
            matrices[name, kind] = confusion(y, found)
    out.table(
        "held_out",
        "Held-out patterns",
        ["fractions", "classifier", "7 classes", "4 groups"],
        rows,
        "4×4 cells. Four groups: fully visible, invisible, partial solid, anything see-through.",
    )
    for (name, kind), m in matrices.items():
        slug = f"confusion_{kind}_{'exact' if name == 'exact' else 'measured'}"
        body = [[NAMES[i], *(m[i] / max(m[i].sum(), 1)).tolist()] for i in range(7)]
        out.table(slug, f"Confusion, {kind}, {name} (rows: truth)", ["", *NAMES], body)
    plots.confusions(out.folder / "confusion.png", matrices)


def table_two(out: Writer) -> None:
    """Histogram only against histogram and co-occurrence: the paper's Table 2 (§5.1.3)."""
    x, y = samples(TRAINING, 0)
    small, full = MLP.train(np.ascontiguousarray(x[:, :4]), y, 0), weights.load("mlp")
    sets = {
        "patterns, exact": held_out(None),
        "patterns, 4 to 8 rays a cell": held_out(MEASURED),
        "3D scenes, 4 to 8 rays a cell": scenes.measured_features(),
    }
    rows = []
    for name, (x, y) in sets.items():
        a, b = full.predict(x), small.predict(x[:, :4])
        rows.append([name, *accuracies(y, a), *accuracies(y, b), float(np.mean(a == b))])
    head = ["data", "P₀ + P_Δ₁, 7", "4 groups", "P₀ only, 7", "4 groups", "agree"]
    out.table(
        "table2",
        "Table 2: what co-occurrence adds",
        head,
        rows,
        "MLPs of 14-14-7 and 4-4-7; share of right labels.",
    )
    m = confusion(a, b)
    out.table(
        "table2_scenes",
        "Table 2, 3D scenes (rows: class by P₀ + P_Δ₁; columns: by P₀ alone)",
        ["", *NAMES],
        [[NAMES[i], *(m[i] / max(m[i].sum(), 1)).tolist()] for i in range(7)],
    )


def sensitivity(out: Writer) -> None:
    """Accuracy against gray levels, clusters, rays a cell, and the size of the smallest region."""
    curves = {}

    def trained(n, levels):
        x, y = samples(COUNT // 2, 0, n, levels)
        classifier = MLP.train(x, y, 0)
        return [
            float(np.mean(classifier.predict(a) == b)) for a, b in (held_out(r, n, levels=levels) for r in (None, MEASURED))
        ]

    curves["levels"] = [[g, *trained(4, g)] for g in range(2, 9)]
    curves["cells"] = [[n, *trained(n, 4)] for n in range(2, 9)]
    out.table(
        "levels",
        "Accuracy against gray levels G",
        ["G", "exact", "4 to 8 rays"],
        curves["levels"],
        "4×4 cells, MLP.",
    )
    out.table(
        "cells",
        "Accuracy against clusters",
        ["n (n×n)", "exact", "4 to 8 rays"],
        curves["cells"],
        "G = 4, MLP.",
    )

    def shipped(**how):
        x, y = held_out(**how)
        return [accuracies(y, weights.load(k).predict(x))[i] for i in (0, 1) for k in KINDS]

    head = [f"{k}, {g}" for g in ("7 classes", "4 groups") for k in KINDS]
    curves["rays"] = [[k, *shipped(rays=(k, k))] for k in (2, 3, 4, 5, 6, 7, 8, 12, 16, 32, 64)]
    curves["region"] = [[r, *shipped(rays=None, region=r)] for r in (0.1, 0.15, 0.2, 0.25, 0.3, 0.33)]
    out.table("rays", "Accuracy against rays a cell", ["rays", *head], curves["rays"])
    out.table(
        "region",
        "Accuracy against the smallest see-through, visible or blocked region",
        ["share of the light", *head],
        curves["region"],
        "Exact fractions. Training regions cover at least 0.3: smaller ones are beyond what was trained.",
    )
    plots.curves(out.folder / "sensitivity.png", curves)


def main(argv: list[str] | None = None) -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/classification"))
    arguments = parser.parse_args(argv)
    begin = time.perf_counter()
    out = Writer(arguments.output)
    held_out_accuracy(out)
    table_two(out)
    sensitivity(out)
    scenes.against_truth(out, confusion, accuracies)
    scenes.cost(out)
    out.close()
    print(f"\n{time.perf_counter() - begin:.0f} s, tables and plots in {arguments.output}")


if __name__ == "__main__":
    main()
