"""What a job spent, what it skipped and why: every render returns one of these."""

from __future__ import annotations

import re
import resource
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path


def peak_memory() -> int:
    """Return the most bytes of memory that this process has held at once.

    Linux's ``getrusage`` counts in what the process that started this one held then; ``/proc`` does not.
    """
    try:
        return 1024 * int(re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())[1])
    except (OSError, TypeError):
        # Bytes on macOS, KiB elsewhere
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


@dataclass
class Report:
    """Account of one job.

    Attributes
    ----------
    wall_s : float
        Wall-clock seconds, kernel compilation included.
    phases : dict of str to float
        Seconds of each phase (``pilot``, ``classification``, ``refinement``, ``compilation``, …).
    rays : dict of str to int
        Rays traced, by kind (``camera``, ``pilot``, ``refinement``, ``bsdf``, …).
    skipped : dict of str to int
        Rays that were *not* traced, by reason.
    classes : dict of str to int
        Pixels of each visibility configuration.
    memory_peak_bytes : int
        Peak resident memory of the process.
    error : float or None
        Estimated root of the mean relative squared error of the image.
    notes : list of str
        What the user should know (a mode that was refused, a budget that ran out).
    """

    wall_s: float = 0.0
    phases: dict[str, float] = field(default_factory=dict)
    rays: dict[str, int] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    classes: dict[str, int] = field(default_factory=dict)
    memory_peak_bytes: int = 0
    error: float | None = None
    notes: list[str] = field(default_factory=list)

    def to_dict(self) -> dict:
        """Return the report as plain Python types, ready for a header or JSON."""
        return asdict(self)

    def __str__(self) -> str:
        def line(name: str, items: dict, unit: str = "") -> str:
            texts = {k: f"{v:,.3f}" if isinstance(v, float) else f"{v:,}" for k, v in items.items()}
            parts = (f"{k} {v}{unit}" for k, v in texts.items())
            return f"{name:<10}" + ", ".join(parts)

        rows = [f"{'time':<10}{self.wall_s:.3f} s"]
        if self.phases:
            rows.append(line("phases", self.phases, " s"))
        if self.rays:
            rows.append(line("rays", {**self.rays, "total": sum(self.rays.values())}))
        if self.skipped:
            rows.append(line("skipped", self.skipped))
        if self.classes:
            rows.append(line("classes", self.classes))
        if self.error is not None:
            rows.append(f"{'error':<10}{self.error:.4g} (relative, estimated)")
        rows.append(f"{'memory':<10}{self.memory_peak_bytes / 2**20:,.0f} MiB peak")
        rows += [f"{'note':<10}{n}" for n in self.notes]
        return "\n".join(rows)
