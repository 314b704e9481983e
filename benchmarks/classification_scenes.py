"""Classification in 3D scenes: against dense visibility of the light, as class maps, and its cost."""

from __future__ import annotations

import time
from functools import cache

import numpy as np

from intervis import scenes
from intervis.visibility import NAMES, classify, classify_grid, features, grid_positions, weights
from intervis.visibility.labels import label
from intervis.visibility.patterns import measure

from . import classification_plots as plots

SCENES = ("penumbra", "grating", "fence", "foliage", "wires")
DENSE = 64
POINTS = 400
KINDS = tuple(weights.KINDS)


def load(name: str, width: int, height: int):
    """Load a built-in scene as Mitsuba scene."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    return mi.load_dict(scenes.load(name, width=width, height=height))


def camera_hits(scene, u, v):
    """Return the surface points behind film positions (u, v), and which of them may see the light at all."""
    import drjit as dr
    import mitsuba as mi

    ray, _ = scene.sensors()[0].sample_ray(0, 0.5, mi.Point2f(u, v), mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    light = scene.emitters()[0].get_shape()
    center = light.sample_position(0, mi.Point2f(0.5))
    to_light = center.p - si.p
    facing = (dr.dot(to_light, center.n) < 0) & (dr.dot(to_light, si.n) * dr.dot(-ray.d, si.n) > 0)
    return si, si.is_valid() & facing & (si.shape != mi.ShapePtr(light))


def seen(scene, si, u, v):
    """Return whether surface points see the light's points (u, v)."""
    import mitsuba as mi

    target = scene.emitters()[0].get_shape().sample_position(0, mi.Point2f(u, v))
    return ~scene.ray_test(si.spawn_ray_to(target.p))


@cache
def dense_maps(name: str, seed: int = 0) -> np.ndarray:
    """Return maps of the light, shape (points, 64, 64): up to 400 partly lit points, 50 lit, 50 hidden."""
    import drjit as dr
    import mitsuba as mi

    scene = load(name, 480, 270)
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 20_000)).astype(np.float32)

    # Look at each point with 8×8 rays first, so that enough undecided ones are among those kept
    def look(u, v, side, jitter):
        index = dr.arange(mi.UInt32, len(u) * side * side)
        point, cell = index // (side * side), index % (side * side)
        si, valid = camera_hits(scene, dr.gather(mi.Float, mi.Float(u), point), dr.gather(mi.Float, mi.Float(v), point))
        a, b = jitter.random((2, len(u) * side * side)).astype(np.float32)
        x, y = (mi.Float(cell % side) + mi.Float(a)) / side, (mi.Float(cell // side) + mi.Float(b)) / side
        lit = seen(scene, si, x, y)
        return np.array(lit).reshape(len(u), side, side), np.array(valid).reshape(len(u), -1)[:, 0]

    lit, valid = look(u, v, 8, rng)
    mean = lit.mean((1, 2))
    kept = [np.flatnonzero(valid & (mean > 0) & (mean < 1))[:POINTS]]
    kept += [np.flatnonzero(valid & (mean == k))[: POINTS // 8] for k in (0, 1)]
    kept = np.concatenate(kept)
    return look(u[kept], v[kept], DENSE, rng)[0]


def to_cells(maps: np.ndarray) -> np.ndarray:
    """Average dense maps over 4×4 cells, shape (points, 16)."""
    return maps.reshape(-1, 4, DENSE // 4, 4, DENSE // 4).mean((2, 4)).reshape(-1, 16)


def measured_features() -> tuple[np.ndarray, np.ndarray]:
    """Return features (4 to 8 rays a cell) and true labels of all scenes' points."""
    maps = np.concatenate([dense_maps(name) for name in SCENES])
    measured = measure(to_cells(maps), (4, 8), np.random.default_rng(1))
    return features(measured, grid_positions(4)), np.array([label(m)[0] for m in maps])


def against_truth(out, confusion, accuracies) -> None:
    """Compare classes from 4×4 cells × 4 to 8 rays with labels of dense 64×64 visibility."""
    rows, total = [], {k: np.zeros((7, 7), int) for k in KINDS}
    for name in SCENES:
        maps = dense_maps(name)
        truth, clear = (np.array(v) for v in zip(*(label(m) for m in maps), strict=True))
        cells = to_cells(maps)
        measured = measure(cells, (4, 8), np.random.default_rng(1))
        for kind in KINDS:
            found, ideal = classify(measured, classifier=kind), classify(cells, classifier=kind)
            total[kind] += confusion(truth, found)
            all_points, clear_points = accuracies(truth, found), accuracies(truth[clear], found[clear])
            structure = float(np.mean((truth > 2) == (found > 2), where=(truth >= 2)))
            ideal_structure = float(np.mean((truth > 2) == (ideal > 2), where=(truth >= 2)))
            rows.append([name, len(truth), float(clear.mean()), kind, *all_points, *clear_points])
            rows[-1] += [*accuracies(truth, ideal), structure, ideal_structure]
    means = []
    for kind in KINDS:
        of_kind = [r for r in rows if r[3] == kind]
        means.append(["mean", sum(r[1] for r in of_kind), *np.mean([r[2:3] for r in of_kind], 0).tolist(), kind])
        means[-1] += np.mean([r[4:] for r in of_kind], 0).tolist()
    rows += means
    out.table(
        "scenes",
        "3D scenes against 64×64 visibility",
        ["scene", "points", "clear", "classifier"]
        + [f"{w}, {g}" for w in ("all", "clear", "all, exact cells") for g in ("7", "4")]
        + ["solid or see-through", "the same, exact cells"],
        rows,
        "Points seen by the camera, of which up to 400 partly lit, 50 lit and 50 hidden. Columns 7 and 4: "
        "share of right answers among seven classes and four groups, from 4×4 cells × 4 to 8 rays. Clear: no "
        "region within a factor of two of the threshold that defines the label. Solid or see-through: the two-way "
        "question alone, on partly lit points.",
    )
    for kind in KINDS:
        m = total[kind]
        body = [[NAMES[i], int(m[i].sum()), *(m[i] / max(m[i].sum(), 1)).tolist()] for i in range(7)]
        out.table(f"scenes_confusion_{kind}", f"3D scenes, {kind} (rows: truth)", ["", "points", *NAMES], body)
    plots.confusions(out.folder / "scenes_confusion.png", {("all scenes", k): m for k, m in total.items()})
    plots.class_maps(out.folder / "class_maps.png", {name: class_map(name) for name in SCENES})


def class_map(name: str, width: int = 320, height: int = 180, rays: int = 6) -> np.ndarray:
    """Return the MLP's class in every pixel, shape (height, width); -1 where no light can be seen."""
    import drjit as dr
    import mitsuba as mi

    scene = load(name, width, height)
    index = dr.arange(mi.UInt32, width * height)
    si, valid = camera_hits(scene, (mi.Float(index % width) + 0.5) / width, (mi.Float(index // width) + 0.5) / height)
    random = mi.PCG32(size=width * height)
    cells = []
    for c in range(16):
        lit = mi.Float(0)
        for _ in range(rays):
            u, v = (c % 4 + random.next_float32()) / 4, (c // 4 + random.next_float32()) / 4
            lit += dr.select(seen(scene, si, u, v), mi.Float(1), mi.Float(0))
        dr.eval(lit)
        cells.append(lit / rays)
    classes = np.array(mi.Int32(dr.select(valid, mi.Int32(classify_grid(cells)), -1)))
    return classes.reshape(height, width)


def cost(out, lanes: int = 1_000_000, repeats: int = 7) -> None:
    """Time features and classifiers per million lanes, warm, interleaved; the best of the repeats."""
    import drjit as dr
    import mitsuba as mi

    index = dr.arange(mi.UInt32, lanes) * 2654435761
    cells = [mi.Float((index >> (c + 8)) & 7) / 7 for c in range(16)]
    dr.eval(cells)
    jobs = {"reading 16 cells": lambda: sum(cells[1:], cells[0])}
    jobs |= {k: lambda k=k: classify_grid(cells, k) for k in KINDS}
    seconds = {k: [] for k in jobs}
    for _ in range(repeats + 1):
        for name, job in jobs.items():
            dr.sync_thread()
            begin = time.perf_counter()
            dr.eval(job())
            dr.sync_thread()
            seconds[name].append(time.perf_counter() - begin)
    rows = [
        [k, f"{1e3 * s[0]:.0f}", f"{1e3 * min(s[1:]):.1f}", f"{1e3 * float(np.median(s[1:])):.1f}"]
        for k, s in seconds.items()
    ]
    note = f"Milliseconds for {lanes:,} lanes, llvm_ad_rgb, {dr.thread_count()} threads. "
    note += "The first run compiles, or finds its kernel on disk."
    out.table("cost", "Cost of a million classifications", ["job", "first", "best", "median"], rows, note)
