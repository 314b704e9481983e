"""Train the shipped classifiers: ``python -m intervis.visibility.train --seed 0`` writes the weights."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from . import patterns, weights
from .features import features, grid_positions

COUNT = 42_000


def train(seed: int = 0, sizes=weights.SIZES, count: int = COUNT) -> dict[str, np.ndarray]:
    """Train every classifier for every grid size on generated patterns (§3.2).

    Parameters
    ----------
    seed : int
        Seed of patterns and initial weights; the same seed gives the same weights.
    sizes : iterable of int
        Cells an axis.
    count : int
        Patterns for each size; half are exact, half as measured by 4 to 8 rays a cell.

    Returns
    -------
    dict of ndarray
        Keys ``classifier/size/name``.
    """
    out = {}
    for n in sizes:
        x, y = samples(count, seed, n)
        for kind, cls in weights.KINDS.items():
            for name, value in cls.train(x, y, seed).weights.items():
                out[f"{kind}/{n}/{name}"] = value
    return out


def samples(count: int, seed: int, n: int = 4, levels: int = weights.LEVELS) -> tuple[np.ndarray, np.ndarray]:
    """Return features and labels of ``count`` training patterns: half exact, half measured by few rays."""
    exact, first = patterns.generate(count // 2, 2 * seed, n)
    noisy, second = patterns.generate(count - count // 2, 2 * seed + 1, n, rays=(4, 8))
    return features(np.concatenate([exact, noisy]), grid_positions(n), levels), np.concatenate([first, second])


def main(argv: list[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m intervis.visibility.train", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=weights.PATH)
    arguments = parser.parse_args(argv)
    trained = train(arguments.seed, weights.SIZES, COUNT)

    # Write beside, then rename: an interrupted run leaves the old weights
    beside = arguments.output.with_name(arguments.output.stem + ".part.npz")
    np.savez_compressed(beside, **trained)
    beside.replace(arguments.output)
    print(f"{arguments.output}: {sum(v.size for v in trained.values())} numbers")


if __name__ == "__main__":
    main()
