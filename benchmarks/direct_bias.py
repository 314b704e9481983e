"""Bias of the unbiased mode by scene and visibility class, and how well the `error` layer predicts the error."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from intervis.visibility import VisibilityClass

from .direct_runs import Setup, direct, image, visdirect

SEEDS = 64
SPP = 8
LEAST = 64  # pixels: smaller groups are left out


def bias(s: Setup, spp: int = SPP, seeds: int = SEEDS) -> dict[str, dict]:
    """Compare the mean of many seeds with Mitsuba's `direct`, over the pixels of each visibility class.

    The classes come from a render that takes no part in the means. The spread between seeds of a group's mean gives the
    standard error, so noise that pixels share is counted.

    Returns
    -------
    dict of str to dict
        For each class, and for ``all`` and ``error layer``: ``pixels``; ``bias``, ``deviation`` (relative to the group's
        mean) and ``z``; for ``error layer`` only ``ratio``, the rms error predicted over the rms error measured.
    """
    tensor, integrator = visdirect(s, "unbiased", 64, aovs=True).render(77)
    names = list(integrator.aov_names())
    offset = tensor.shape[-1] - len(names)
    label = np.array(tensor)[..., offset + names.index("visibility.class")]
    groups = {c.name.lower(): label == int(c) for c in VisibilityClass}
    groups = {"all": np.ones_like(label, bool), **{n: g for n, g in groups.items() if g.sum() >= LEAST}}

    ours, theirs = visdirect(s, "unbiased", spp, aovs=True), direct(s, "multijitter", 1, 64)
    means = {n: ([], []) for n in groups}
    total = square = predicted = 0.0
    for seed in range(seeds):
        data = np.array(ours.render(40_000 + seed)[0], dtype=np.float64)
        x, y = data[..., :3], image(theirs.render(50_000 + seed)[0]).astype(np.float64)
        error = data[..., offset + names.index("error.R") :][..., :3]
        total, square, predicted = total + x, square + x * x, predicted + error**2
        for n, g in groups.items():
            means[n][0].append(x[g].mean())
            means[n][1].append(y[g].mean())

    out = {}
    for n, (a, b) in means.items():
        a, b = np.array(a), np.array(b)
        level = b.mean()
        # Relative to what light there is: a class without any has no relative bias
        if level < 1e-5 * np.mean(means["all"][1]):
            continue
        deviation = np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / seeds)
        difference = a.mean() - b.mean()
        z = difference / deviation if deviation > 0 else 0.0
        out[n] = {"pixels": int(groups[n].sum()), "bias": difference / level, "deviation": deviation / level, "z": z}
    variance = (square - total**2 / seeds) / (seeds - 1)
    scale = (total / seeds) ** 2 + 0.01
    out["error layer"] = {"ratio": float(np.sqrt(np.mean(predicted / seeds / scale) / np.mean(variance / scale)))}
    return out


def verdict(found: dict[str, dict[str, dict]], alpha: float = 0.01) -> dict:
    """Judge all scenes and classes together.

    Returns
    -------
    dict
        ``tests``, ``limit`` (Šidák-corrected bound on abs(z)), ``z`` and ``bias`` (the largest of each), and ``where``.
    """
    tests = [(abs(g["z"]), f"{s}, {n}") for s, t in found.items() for n, g in t.items() if n != "error layer"]
    p = 1 - (1 - alpha) ** (1 / len(tests))
    z, where = max(tests)
    largest = max(abs(t["all"]["bias"]) for t in found.values())
    return {"tests": len(tests), "limit": float(norm.isf(p / 2)), "z": z, "where": where, "bias": largest}
