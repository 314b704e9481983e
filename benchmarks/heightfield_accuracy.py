"""Horizons against float64 brute force on the stated surface, local horizons line by line, furnace, memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

import numba as nb
import numpy as np

from intervis.heightfield import FIELDS, HeightField, example, make, tiles
from intervis.heightfield.intervisibility import local_horizons
from intervis.heightfield.sweep import direction

from .heightfield_plots import errors as draw_errors
from .heightfield_tables import Part, Row, grid, threads

_MEMORY = """
import sys
import numpy as np
import numba
from intervis.heightfield import HeightField
from intervis.report import peak_memory
numba.set_num_threads(int(sys.argv[3]))
field = HeightField(np.load(sys.argv[1], mmap_mode="r"))
k = int(sys.argv[2])
field.horizons(k)
field.sky_view(k)
print(peak_memory())
"""


@nb.njit(cache=True)
def _height(h, y, x):
    # The triangulated grid: every cell cut from its north-west to its south-east corner
    r, c = min(max(int(np.floor(y)), 0), h.shape[0] - 2), min(max(int(np.floor(x)), 0), h.shape[1] - 2)
    f, g = y - r, x - c
    if g >= f:
        return h[r, c] + g * (h[r, c + 1] - h[r, c]) + f * (h[r + 1, c + 1] - h[r, c + 1])
    return h[r, c] + f * (h[r + 1, c] - h[r, c]) + g * (h[r + 1, c + 1] - h[r + 1, c])


@nb.njit(cache=True)
def brute_horizon(h, i, j, azimuth, dy, dx):
    """Return the highest elevation of the surface along one ray, in float64: at every edge that it crosses.

    Parameters
    ----------
    h : (rows, columns) float64 array
    i, j : int
        The receiver.
    azimuth : float
        Radians clockwise from north.
    dy, dx : float
        Metres between samples.

    Returns
    -------
    float
        Radians; −π/2 where the ray leaves the field at once.
    """
    rows, columns = h.shape
    vx, vy = np.sin(azimuth) / dx, -np.cos(azimuth) / dy
    reach = np.inf
    for v, last, at in ((vx, columns - 1, j), (vy, rows - 1, i)):
        if abs(v) > 1e-15:
            reach = min(reach, ((last - at) if v > 0 else -at) / v)
    best = -np.inf
    # Columns, rows and diagonals are crossed where x, y and x − y are whole; the surface is straight between
    for v in (vx, vy, vx - vy):
        if abs(v) > 1e-15:
            n = 1
            while n / abs(v) <= reach * (1 + 1e-12):
                s = n / abs(v)
                y, x = min(max(i + vy * s, 0.0), rows - 1.0), min(max(j + vx * s, 0.0), columns - 1.0)
                best = max(best, (_height(h, y, x) - h[i, j]) / s)
                n += 1
    if reach > 1e-9:
        y, x = min(max(i + vy * reach, 0.0), rows - 1.0), min(max(j + vx * reach, 0.0), columns - 1.0)
        best = max(best, (_height(h, y, x) - h[i, j]) / reach)
    return np.arctan(best)


@nb.njit(cache=True)
def brute_line(h, ends):
    """List the ends of all visible stretches of a line, looking on from every sample; return how many.

    Heights are float32: float64 products of their differences and whole distances are exact, ties too.
    """
    n = 0
    for r in range(len(h)):
        over, run, before = 0.0, 0, -1
        for k in range(r + 1, len(h)):
            rise = np.float64(h[k]) - np.float64(h[r])
            if run == 0 or rise * run > over * (k - r):
                over, run = rise, k - r
                if before >= 0 and before != k - 1:
                    ends[n, 0], ends[n, 1] = r, before - r
                    n += 1
                before = k
        if before >= 0:
            ends[n, 0], ends[n, 1] = r, before - r
            n += 1
    return n


def fields(size: int) -> dict[str, tuple[np.ndarray, tuple[float, float]]]:
    """Heights and spacing of the fields on which errors are measured."""
    one = (1.0, 1.0)
    return {"fractal": (make("fractal", size), one), "jacksboro": example(), "blocks": (make("blocks", size), one)}


def measure(options, note) -> Part:
    """Measure errors of horizons and local horizons, and the white furnace."""
    threads(options.threads)
    part = Part("Accuracy")
    rng = np.random.default_rng(20)
    table, found, worst = [], {}, 0.0
    turns, each = (8, 100) if options.quick else (60, 400)
    for name, (heights, spacing) in fields(128 if options.quick else 1024).items():
        note(f"horizon error: {name}")
        field = HeightField(heights, spacing)
        error = {"auto": [], "march": []}
        # A direction at a time: nothing but differences is kept
        for azimuth in rng.uniform(0, 2 * np.pi, turns):
            i, j = (rng.integers(0, n, each) for n in heights.shape)
            exact = [brute_horizon(field.heights, a, b, azimuth, *spacing) for a, b in zip(i, j, strict=True)]
            for method, values in error.items():
                got = field.horizons([azimuth], method=method)[0, i, j]
                values.append(np.degrees(np.abs(got - np.array(exact))))
        for method, values in error.items():
            error[method] = np.concatenate(values)
            figures = np.percentile(error[method], [50, 99, 99.9, 100])
            table.append(
                [name, f"{heights.shape[0]} × {heights.shape[1]}", method, turns * each, *(f"{e:.2g}" for e in figures)]
            )
            for what, value in zip(("median", "99th percentile", "99.9th percentile", "largest"), figures, strict=True):
                part.found(f"horizon error, {name}, {method}", what, value, "°")
        found[name] = error["auto"]
        worst = max(worst, float(np.percentile(error["auto"], 99)))
    part.rows.append(Row("horizon error against float64 brute force, 99th percentile, worst field", 0.05, 0.01, worst,
                         unit="°", less=True))  # fmt: skip
    part.text.append("Horizons of random receivers in random azimuths, against all edge crossings in float64; degrees.")
    part.text.append(grid(["field", "points", "method", "rays", "median", "99th percentile", "99.9th", "largest"], table))
    part.plots.append(("error-horizons.png", draw_errors, found))
    _lines(part, options, note)
    _furnace(part, options, note)
    return part


def _lines(part, options, note):
    # Rows of a field that looks east are lines of their own
    note("local horizons against brute force")
    rng = np.random.default_rng(3)
    k = np.arange(96)
    kinds = {
        "rough": lambda: rng.normal(size=k.size),
        "smooth": lambda: np.cumsum(np.cumsum(rng.normal(size=k.size))),
        "steps": lambda: np.repeat(rng.integers(0, 3, k.size), 5)[: k.size],
        "spikes": lambda: np.where(rng.random(k.size) < 0.1, rng.uniform(0, 100, k.size), 0),
        "bowl, every other sample lower": lambda: 0.01 * (k - 48.0) ** 2 - (k % 2) * rng.uniform(0, 0.1),
        "dome": lambda: -0.01 * (k - rng.uniform(0, 96)) ** 2,
        "plane": lambda: rng.integers(-3, 4) * k,
        "equal": lambda: np.full(k.size, rng.normal()),
    }
    count = 40 if options.quick else 1500
    wrong, lines = {m: 0 for m in ("auto", "tree", "march")}, 0
    ends = np.empty((k.size * k.size, 2), np.int64)
    for make_line in kinds.values():
        h = np.array([make_line() for _ in range(count)], dtype=np.float32)
        truth = [ends[: brute_line(row, ends)].copy() for row in h]
        lines += count
        for method in wrong:
            offsets, distances, *_ = local_horizons(direction(np.pi / 2, (1.0, 1.0)), h, method=method)
            receivers = np.repeat(np.arange(h.size), np.diff(offsets))
            starts = offsets[:: k.size]
            for row, t in enumerate(truth):
                got = slice(starts[row], starts[row + 1])
                same = np.array_equal(receivers[got] - row * k.size, t[:, 0]) and np.array_equal(distances[got], t[:, 1])
                wrong[method] += not same
    for method, n in wrong.items():
        part.found("lines that differ from brute force", method, n, f"of {lines}")
    part.rows.append(Row(f"lines whose local horizons differ from float64 brute force, of {lines} (all methods)", 0, 0,
                         sum(wrong.values()), unit="", less=True))  # fmt: skip
    part.text.append(
        f"Lines of {k.size} samples compared with brute force, every receiver and horizon: {lines}, of kinds "
        + ", ".join(kinds)
        + ". Differing: "
        + ", ".join(f"{m} {n}" for m, n in wrong.items())
        + "."
    )


def _furnace(part, options, note):
    # Everything shines alike: whatever a receiver sees, it gathers π
    size, table, worst = 48 if options.quick else 128, [], 0.0
    for name in FIELDS:
        note(f"white furnace: {name}")
        e = HeightField(make(name, size)).irradiance(sky=1.0, emission=1.0, albedo=0.0, bounces=0)
        error = float(100 * np.abs(e / np.pi - 1).max())
        worst = max(worst, error)
        part.found(f"white furnace, {name}", "largest deviation", error, "%")
        table.append([name, f"{error:.2g}"])
    part.rows.append(Row("white furnace, largest deviation, worst field", 0.1, 0.01, worst, unit=" %", less=True))
    part.text.append(f"White furnace at {size}², 64 azimuths, largest deviation of any point in %.")
    part.text.append(grid(["field", "deviation, %"], table))


def memory(options, note) -> Part:
    """Measure the peak of a fresh process that finds horizons and sky view of a large field, and tiles against the whole."""
    part = Part("Memory")
    _tiles(part, options, note)
    size, k = (512 if options.quick else 8192), 8
    note(f"memory: {size}²")
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "heights.npy")
        np.save(path, make("fractal", size).astype(np.float32))
        command = [sys.executable, "-c", _MEMORY, path, str(k), str(options.threads)]
        out = subprocess.run(command, capture_output=True, text=True)
    if out.returncode:
        last = (out.stderr.strip().splitlines() or [f"status {out.returncode}"])[-1]
        part.text.append(f"The process that was to find horizons and sky view of {size}² failed: {last}")
        return part
    peak = float(out.stdout.split()[-1]) / 2**30
    part.found(f"horizons and sky view, {size}², K = {k}", "peak memory", peak, "GiB")
    kept = k * size * size * 4 / 2**30
    part.rows.append(Row(f"peak memory, horizons and sky view, {size}², K = {k}", 12, 6, peak, unit=" GiB", less=True,
                         note=f"the returned horizons alone: {kept:.2g} GiB"))  # fmt: skip
    part.text.append("Peak resident memory of a fresh process, the file of heights (float32) mapped into it included.")
    return part


def _tiles(part, options, note):
    # With a search radius, a tile and a halo as wide know all that its points see
    size, radius, k = (128, 20, 4) if options.quick else (1024, 100, 8)
    note(f"tiles, {size}²")
    threads(options.threads)
    heights = make("fractal", size)
    whole = HeightField(heights, radius=radius).horizons(k)
    worst = 0.0
    for window, field, inner in tiles(heights, radius=radius, size=size // 2):
        difference = np.abs(field.horizons(k)[(..., *inner)] - whole[(..., *window)])
        worst = max(worst, float(np.degrees(difference.max())))
    part.found(f"tiles, {size}², radius {radius}", "largest difference", worst, "°")
    what = f"tiles with a halo against the whole, {size}² in 2 × 2, radius {radius} samples, largest difference of a horizon"
    part.rows.append(Row(what, None, None, worst, unit="°"))
