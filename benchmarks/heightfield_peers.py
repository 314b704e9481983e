"""Global horizons against two peers, each in its own Python, in turns with ours."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from intervis.heightfield import HeightField, make

from .heightfield_tables import KEEP, Part, Row, grid, interleave, keep_memory, ratio, spread, threads

SPACING = 30.0
TURNS = 72  # azimuths of the figure
WORKER = Path(__file__).with_name("heightfield_worker.py")


class Peer:
    """A worker process that holds one field and answers with seconds."""

    def __init__(self, python: str, name: str, heights: np.ndarray, folder: str, count: int):
        # As many cores as threads: the peers' own thread pools take all that they may run on
        cores = sorted(os.sched_getaffinity(0))[:count]
        self.process = subprocess.Popen(
            [python, str(WORKER), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": str(count), **{name: str(value) for (_, name), value in KEEP.items()}},
            preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )
        path = os.path.join(folder, f"{name}.npy")
        np.save(path, heights)
        self._ask(do="load", heights=path, spacing=SPACING)

    def _ask(self, **job):
        self.process.stdin.write(json.dumps(job) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        answer = json.loads(line) if line else {"error": "the process ended"}
        if "error" in answer:
            raise RuntimeError(answer["error"])
        return answer["seconds"]

    def run(self, save: str | None = None, **options) -> float:
        """Run once; return the seconds that it took there."""
        return self._ask(do="run", save=save, **{"with": options})

    def close(self) -> None:
        """End the process."""
        self.process.stdin.close()
        self.process.wait(timeout=60)


def measure(options, note) -> Part:
    """Measure both peers; one that is not there is left out, with a sentence."""
    part = Part("Horizons against peers")
    keep_memory()
    part.text.append(
        f"Fractal field, samples {SPACING:g} m apart. Times are a horizon's: of all points by us, by horayzon of strips of"
        " rows spread over the field (its tree is built beforehand and not counted), by topocalc of all points in the"
        " azimuths given. Difference: median, where the horizon is above the horizontal. Both sides keep the memory that they"
        " free: a virtual machine gives it back to its host while the other side runs, and getting it again may take longer"
        " than the work."
    )
    table = []
    for name, python, job in (
        ("horayzon-extpar", options.horayzon_python, _horayzon),
        ("topocalc", options.topocalc_python, _topocalc),
    ):
        if not python:
            part.text.append(f"Not measured: {name} (no Python that has it was given).")
            continue
        try:
            job(python, options, note, part, table)
        except (RuntimeError, OSError) as e:
            part.text.append(f"Not measured: {name} ({e}).")
    threads(options.threads)
    if table:
        part.text.append(grid(["peer", "points", "threads", "theirs, M horizons/s", "ours", "ratio", "difference, °"], table))
    return part


def _horayzon(python, options, note, part, table):
    size, count = (192 if options.quick else 1024), options.threads
    note(f"horayzon-extpar, {size}²")
    threads(count)
    heights = make("fractal", size) * SPACING
    ours = HeightField(heights, SPACING)
    step = size // 8
    strips = [[k * step, k * step + min(4, step)] for k in range(8)]
    points = sum(b - a for a, b in strips) * size
    with tempfile.TemporaryDirectory() as folder:
        peer = Peer(python, "horayzon", heights, folder, count)
        job = {"azimuths": TURNS, "strips": strips, "accuracy": 0.25}
        times = interleave(
            {"horayzon": lambda: peer.run(**job) / points, "intervis": lambda: _each(ours, TURNS)}, options.repeats
        )
        path = os.path.join(folder, "out.npy")
        peer.run(save=path, **job)
        theirs = np.load(path)
        peer.close()
    mine = np.degrees(ours.horizons(TURNS))
    mine = np.concatenate([mine[:, a:b].reshape(TURNS, -1).T for a, b in strips])
    _add(part, table, "horayzon-extpar at 0.25°", size, count, times, theirs, mine, (50, 200), TURNS)


def _topocalc(python, options, note, part, table):
    for size, steps, limits in ((1024, range(3, TURNS, 13), (15, 40)), (2048, (5,), (40, 120))):
        size = size // 8 if options.quick else size
        note(f"topocalc, {size}²")
        threads(1)
        heights = make("fractal", size) * SPACING
        ours = HeightField(heights, SPACING)
        azimuths = np.array(steps) * (360 / TURNS)
        south = ((180 - azimuths + 180) % 360 - 180).tolist()
        with tempfile.TemporaryDirectory() as folder:
            peer = Peer(python, "topocalc", heights, folder, 1)
            points = size * size
            times = interleave(
                {
                    "topocalc": lambda p=peer, n=points, a=south: p.run(azimuths=a) / n,
                    "intervis": lambda o=ours, a=azimuths: _each(o, np.radians(a)),
                },
                options.repeats,
            )
            path = os.path.join(folder, "out.npy")
            peer.run(save=path, azimuths=south)
            theirs = np.degrees(np.arcsin(np.clip(np.load(path), -1, 1)))
            peer.close()
        mine = np.degrees(ours.horizons(np.radians(azimuths)))
        _add(part, table, "topocalc", size, 1, times, theirs, mine, limits, len(azimuths))


def _each(field, azimuths):
    # Our own seconds a point, for all azimuths together
    field.horizons(azimuths)
    return field.report.wall_s / field.heights.size


def _add(part, table, name, size, count, times, theirs, mine, limits, azimuths):
    times = {k: [t / azimuths for t in v] for k, v in times.items()}
    part.timed(f"{name}, {size}²", times)
    peer, ours = times.values()
    value = ratio(peer, ours)
    above = mine > 0.5
    difference = float(np.median(np.abs(theirs - mine)[above]))
    part.rows.append(Row(f"horizons against {name}, {size}², {count} thread{'s' * (count > 1)}", *limits, *value))
    rates = [f"{1e-6 / np.median(t):.3g}" for t in (peer, ours)]
    table.append([name, f"{size}²", count, *rates, spread(value), f"{difference:.3g}"])
    part.found(f"{name}, {size}²", "median difference", difference, "°")
