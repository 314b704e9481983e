"""What the height-field benchmark's parts share: interleaved timing, ratios with their spread, Markdown and CSV."""

from __future__ import annotations

import csv
import ctypes
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np

# glibc's allocator: no separate mappings, and nothing back to the system (mallopt's numbers and the environment's names)
KEEP = {(-4, "MALLOC_MMAP_MAX_"): 0, (-1, "MALLOC_TRIM_THRESHOLD_"): 2**31 - 1}


@dataclass
class Row:
    """A figure that was to be reached, and what was measured."""

    figure: str
    floor: float | None
    goal: float | None
    value: float
    low: float | None = None
    high: float | None = None
    unit: str = "×"
    less: bool = False  # smaller is better
    mark: str = ""  # "~": extrapolated
    note: str = ""

    def verdict(self) -> str:
        """Say what was reached: goal, floor or neither."""
        if self.floor is None:
            return ""
        sign = -1 if self.less else 1
        met = [limit is not None and sign * self.value >= sign * limit for limit in (self.floor, self.goal)]
        return "goal" if met[1] else "floor" if met[0] else "**no**"

    def cells(self) -> list[str]:
        """Return the cells of the Markdown table."""
        limits = ["" if x is None else f"{x:g}{self.unit}" for x in (self.floor, self.goal)]
        spread = "" if self.low is None else f" [{self.low:.3g}, {self.high:.3g}]"
        return [self.figure, *limits, f"{self.mark}{self.value:.3g}{self.unit}{spread}", self.verdict(), self.note]


@dataclass
class Part:
    """What one part of the benchmark found: rows of the main table, tables of its own, plots, raw records."""

    title: str
    rows: list[Row] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    plots: list[tuple[str, Callable, object]] = field(default_factory=list)  # file, drawing function, data
    records: list[dict] = field(default_factory=list)

    def timed(self, case: str, times: dict[str, list[float]]) -> None:
        """Keep the times of one interleaved comparison, in seconds."""
        for name, seconds in times.items():
            self.records += [{"part": self.title, "case": case, "what": name, "repeat": k, "value": s, "unit": "s"}
                             for k, s in enumerate(seconds)]  # fmt: skip

    def found(self, case: str, what: str, value: float, unit: str) -> None:
        """Keep one number."""
        self.records.append({"part": self.title, "case": case, "what": what, "repeat": 0, "value": value, "unit": unit})


def keep_memory() -> None:
    """Have this process keep the memory that it frees: first touches cost a virtual machine more than the work does."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    for (number, _), value in KEEP.items():
        if mallopt is not None:
            mallopt(number, value)


def interleave(jobs: dict[str, Callable], repeats: int, cold=()) -> dict[str, list[float]]:
    """Time jobs in turns, after one warm-up each; every round starts with another job.

    Parameters
    ----------
    jobs : dict of callables
        A job that returns a float measured itself (another process does); of others the wall time is taken.
    repeats : int
    cold : collection of str
        Jobs that need no warm-up: long ones, their code compiled.

    Returns
    -------
    dict
        Seconds of every repeat.
    """
    names = list(jobs)
    times = {name: [] for name in names}
    for turn in range(-1, repeats):
        for name in names[max(turn, 0) % len(names) :] + names[: max(turn, 0) % len(names)]:
            if turn < 0 and name in cold:
                continue
            begin = time.perf_counter()
            own = jobs[name]()
            seconds = own if isinstance(own, float) else time.perf_counter() - begin
            if turn >= 0:
                times[name].append(seconds)
    return times


def ratio(theirs: list[float], ours: list[float]) -> tuple[float, float, float]:
    """Return the ratio of medians, and the least and greatest ratio within a round."""
    each = np.array(theirs) / np.array(ours)
    return float(np.median(theirs) / np.median(ours)), float(each.min()), float(each.max())


def spread(value: tuple[float, float, float]) -> str:
    """Write a ratio with its spread."""
    return f"{value[0]:.3g}× [{value[1]:.3g}, {value[2]:.3g}]"


def threads(count: int) -> None:
    """Let numba and Dr.Jit use so many threads."""
    import drjit as dr
    import numba

    numba.set_num_threads(count)
    # Dr.Jit counts its workers; the thread that waits does no work
    dr.set_thread_count(count)


def grid(head: list[str], rows: list[list]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def machine() -> str:
    """Name the machine and the versions that were measured."""
    model, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.exists():
        found = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        model = found[0] if found else model
    packages = ", ".join(f"{p} {version(p)}" for p in ("mitsuba", "drjit", "numba", "numpy"))
    return f"{len(os.sched_getaffinity(0))} cores ({model}), Python {platform.python_version()}, {packages}"


def write_csv(path: Path, parts: list[Part]) -> None:
    """Write every number that was measured, repeats one by one."""
    with path.open("w", newline="") as file:
        out = csv.DictWriter(file, ["part", "case", "what", "repeat", "value", "unit"])
        out.writeheader()
        for part in parts:
            out.writerows({**r, "value": f"{r['value']:.5g}"} for r in part.records)
