"""Direct light of many lights: `visdirect` against Mitsuba's `direct` as lights grow in number.

``python -m benchmarks.direct_lights`` writes ``docs/direct/lights.md`` and ``lights.png``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import mitsuba as mi
import numpy as np

import intervis  # noqa: F401  (registers the plugins)

OUT = Path(__file__).resolve().parent.parent / "docs" / "direct"
SPP = 64
SETTINGS = (("multijitter", 1), ("multijitter", 4), ("ldsampler", 1), ("independent", 1))

TEXT = """# Direct light of many lights, measured

{machine}. Films of {width}×{height} at {spp} samples a pixel; {repeats} repeats, warm, interleaved; medians. Square lamps of
equal total power, over boxes on an open floor (`hall`), or one to four in each of the rooms of a house without a roof
(`rooms`). The setting of `direct` is the one of least error × time. The gain is error × time of `direct` over that of
`visdirect`, with the least and the largest of the repeats: the time ratio at equal error if errors fall as one over time.

{table}

![gain against the number of lights](lights.png)
"""


def lamp(place, side: float, power: float, rng) -> dict:
    """Return a square lamp that looks down."""
    T = mi.ScalarTransform4f
    to_world = T().translate(list(place)).rotate([1, 0, 0], 90).scale(0.5 * side)
    colour = (rng.uniform(0.2, 1, 3) * power).tolist()
    glow = {"type": "area", "radiance": {"type": "rgb", "value": colour}}
    return {"type": "rectangle", "to_world": to_world, "emitter": glow}


def hall(count: int) -> dict:
    """Return boxes on a floor of 20×20 under ``count`` lamps on a jittered grid."""
    T, rng, shapes = mi.ScalarTransform4f, np.random.default_rng(1), {}
    for i in range(60):
        x, z = rng.uniform(-9, 9, 2)
        place = T().translate([x, 0.5, z]).rotate([0, 1, 0], rng.uniform(0, 90)).scale([0.4, 0.5 + rng.uniform(), 0.4])
        shapes[f"box{i}"] = {"type": "cube", "to_world": place}
    side = int(np.ceil(np.sqrt(count)))
    for i in range(count):
        x, z = ((np.array([i % side, i // side]) + 0.5) / side - 0.5) * 20
        shapes[f"lamp{i}"] = lamp((x, 2.5 + rng.uniform(), z), 0.3, 1000 / count, rng)
    return shapes


def rooms(count: int) -> dict:
    """Return a house of at most 8×8 rooms with ``count`` lamps spread over them."""
    T, rng, shapes = mi.ScalarTransform4f, np.random.default_rng(2), {}
    side = min(int(np.ceil(np.sqrt(count / 2))), 8)
    for i in range(side + 1):
        at = 20 * i / side - 10
        shapes[f"along{i}"] = {"type": "cube", "to_world": T().translate([at, 1.5, 0]).scale([0.05, 1.5, 10])}
        shapes[f"across{i}"] = {"type": "cube", "to_world": T().translate([0, 1.5, at]).scale([10, 1.5, 0.05])}
    for i in range(count):
        room = np.array([i % side, i // side % side])
        x, z = (room + rng.uniform(0.15, 0.85, 2)) * 20 / side - 10
        shapes[f"lamp{i}"] = lamp((x, 2.3 + 0.4 * rng.uniform(), z), 0.2, 2000 / count, rng)
    return shapes


SCENES = {"hall": hall, "rooms": rooms}


def compare(name: str, count: int, width: int, repeats: int, cache: Path, reference: int) -> tuple[list, np.ndarray]:
    """Measure one scene: a row of the table, and the gain of every repeat."""
    T = mi.ScalarTransform4f
    floor = {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(20)}
    view = T().look_at([0, 7, 13] if name == "hall" else [0, 17, 13], [0, 0, 0], [0, 1, 0])
    scene = {"type": "scene", "floor": floor, **SCENES[name](count)}
    camera = {"type": "perspective", "fov": 50, "to_world": view}
    row, gain = beside_direct(f"{name}-{count}", scene, camera, width, repeats, cache, reference)
    return [name, count, *row], gain


def beside_direct(name, scene, camera, width, repeats, cache, reference, matt=True, more=()) -> tuple[list, np.ndarray]:
    """Measure `visdirect` beside the best setting of `direct`: columns of a table, and the gain of every repeat.

    Settings are tried with each dict of ``more`` parameters too.
    """
    from .direct_runs import SAMPLERS, Setup, add_reference, direct, measure, visdirect

    height = width * 9 // 16
    camera = {**camera, "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}}
    sensors = {s: mi.load_dict({**camera, "sampler": {"type": s}}) for s in SAMPLERS}
    s = Setup(name, mi.load_dict(scene), sensors, matt, width * height)
    add_reference(s, cache, reference)
    theirs = [direct(s, *setting, SPP, **extra) for extra in ({}, *more) for setting in SETTINGS]
    ours = visdirect(s, "unbiased", SPP)
    for r in range(-1, repeats):
        for k, run in enumerate([*theirs, ours]):
            measure(s, run, 1000 * k + r + 1, keep=r >= 0)
    best = min(theirs, key=lambda run: np.median(run.times) * np.mean(run.errors))
    time = np.median(ours.times) / np.median(best.times)
    error = np.mean(ours.errors) / np.mean(best.errors)
    gain = np.array(best.times) * np.mean(best.errors) / (np.array(ours.times) * np.mean(ours.errors))
    row = [best.setting, f"{np.median(best.times):.2f} s", f"{np.median(ours.times):.2f} s", f"{time:.2f}"]
    return [*row, f"{error:.4f}", f"{np.median(gain):.1f}× [{gain.min():.1f}, {gain.max():.1f}]"], gain


def options(module: str, about: str, repeats: int, reference: int, width: int, note: str = "") -> argparse.ArgumentParser:
    """Return a parser of what the smaller benchmarks of direct light take."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    parser.add_argument("--repeats", type=int, default=repeats)
    parser.add_argument("--reference", type=int, default=reference, help="samples a pixel of the references" + note)
    parser.add_argument("--width", type=int, default=width)
    parser.add_argument("--cache", type=Path, default=Path.home() / ".cache" / "intervis" / "benchmark")
    parser.add_argument("--output", type=Path, default=OUT)
    return parser


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark, print the table and write it."""
    parser = options("benchmarks.direct_lights", __doc__, repeats=5, reference=4096, width=320)
    parser.add_argument("--counts", default="2,8,32,128,512,1024", help="comma-separated numbers of lights")
    a = parser.parse_args(arguments)
    mi.set_variant("llvm_ad_rgb")
    from .direct_tables import machine

    rows, gains = [], {}
    for name in SCENES:
        for count in (int(c) for c in a.counts.split(",")):
            row, gain = compare(name, count, a.width, a.repeats, a.cache, a.reference)
            rows.append("| " + " | ".join(str(x) for x in row) + " |")
            gains.setdefault(name, []).append((count, np.median(gain), gain.min(), gain.max()))
            print(rows[-1], flush=True)
    head = "| scene | lights | best `direct` | its time | ours | time ratio | error ratio | gain |"
    table = "\n".join([head, "|---" * 8 + "|", *rows])
    about = {"machine": machine(), "width": a.width, "height": a.width * 9 // 16, "spp": SPP, "repeats": a.repeats}
    a.output.mkdir(parents=True, exist_ok=True)
    (a.output / "lights.md").write_text(TEXT.format(**about, table=table), encoding="utf-8")
    plot(a.output / "lights.png", gains)


def plot(path: Path, gains: dict) -> None:
    """Draw the gains against the number of lights."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(5, 3.2))
    for name, rows in gains.items():
        count, middle, low, high = np.array(rows).T
        axis.errorbar(count, middle, [middle - low, high - middle], fmt="o-", ms=3, capsize=2, label=name)
    axis.axhline(1, color="0.6", lw=0.8)
    axis.set(xscale="log", yscale="log", xlabel="lights", ylabel="error × time, direct over visdirect")
    axis.grid(alpha=0.25)
    axis.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
