"""Equal-error comparisons with bootstrap intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .direct_runs import Run

DRAWS = 1000


@dataclass
class Ratio:
    """A time ratio, how it was found, and its bootstrap draws."""

    value: float
    mark: str  # "": interpolated; "≥": the smallest budget beats the target; "~": extrapolated
    draws: np.ndarray
    target: str = ""

    def __str__(self) -> str:
        low, high = np.percentile(self.draws, [2.5, 97.5])
        return f"{self.mark}{self.value:.2f}× [{low:.2f}, {high:.2f}]"


def crossing(times, errors, target: float) -> tuple[float, str]:
    """Return the time at which a ladder of (time, error) reaches an error, by log-log interpolation.

    Returns
    -------
    seconds : float
    mark : str
        Empty if interpolated, "≥" if the first rung is already below, "~" if extrapolated (∝ 1 / error) beyond the last.
    """
    t, e, goal = np.log(times), np.log(np.maximum(errors, 1e-30)), np.log(target)
    if e[0] <= goal:
        return float(np.exp(t[0])), "≥"
    below = np.flatnonzero(e <= goal)
    if not len(below):
        # Beyond the ladder: as fast as plain Monte Carlo from its best rung, time × error constant
        k = int(np.argmin(e))
        return float(np.exp(t[k] + e[k] - goal)), "~"
    i = int(below[0])
    slope = (t[i] - t[i - 1]) / (e[i] - e[i - 1])
    return float(np.exp(t[i - 1] + slope * (goal - e[i - 1]))), ""


def select(runs: list[Run], family: str, budget: int | None = None) -> list[Run]:
    """Return the runs of a family, of one budget if given, cheapest first."""
    found = [r for r in runs if r.family == family and budget in (None, r.budget)]
    return sorted(found, key=lambda r: r.budget)


def best(runs: list[Run], budget: int) -> Run:
    """Mitsuba's setting of least error × time at a budget."""
    return min(select(runs, "mitsuba", budget), key=lambda r: np.median(r.times) * np.mean(r.errors))


def ratio(runs: list[Run], opponent: Run, mode: str) -> Ratio:
    """Time of the opponent over our time at the opponent's error, resampling whole repeats."""
    ours = select(runs, mode)
    n = len(opponent.times)

    def once(index):
        time = lambda r: np.median(np.array(r.times)[index])  # noqa: E731
        error = lambda r: np.mean(np.array(r.errors)[index])  # noqa: E731
        seconds, mark = crossing([time(r) for r in ours], [error(r) for r in ours], error(opponent))
        return time(opponent) / seconds, mark

    value, mark = once(np.arange(n))
    rng = np.random.default_rng(0)
    draws = np.array([once(rng.integers(0, n, n))[0] for _ in range(DRAWS)])
    return Ratio(value, mark, draws, opponent.setting)


def together(ratios: list[Ratio]) -> Ratio:
    """Geometric mean over scenes."""
    mean = lambda values: np.exp(np.mean(np.log(values), axis=0))  # noqa: E731
    marks = {r.mark for r in ratios}
    mark = "~" if "~" in marks else "≥" if "≥" in marks else ""
    return Ratio(float(mean([r.value for r in ratios])), mark, mean([r.draws for r in ratios]))


def worst(ratios: dict[str, Ratio]) -> tuple[str, Ratio]:
    """Return the scene with the least ratio."""
    name = min(ratios, key=lambda k: ratios[k].value)
    return name, ratios[name]
