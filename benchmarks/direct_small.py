"""What is smaller than a pixel: `visdirect` against Mitsuba's `direct` where small lamps and highlights are in view.

``python -m benchmarks.direct_small`` writes ``docs/direct/small.md``.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

import intervis  # noqa: F401  (registers the plugins)

from .direct_lights import SPP, beside_direct, options

TEXT = """# Lamps and highlights below a pixel, measured

{machine}. Films of {width}×{height} at {spp} samples a pixel; {repeats} repeats, warm, interleaved; medians. Over a
floor before a wall, under a lamp out of view: twenty small lamps a fifth of a pixel wide (squares, balls, tubes), also with
a lens that is focused before them; or forty shiny balls some pixels wide; or twenty ball lamps over a floor that is a mirror,
glass, or metal with a normal map of waves. The setting of `direct` is the one of least error × time. The gain is error × time
of `direct` over that of `visdirect`, with the least and the largest of the repeats.

{table}
"""
EYE, FOV = np.array([0.0, 2, 8]), 40.0


def lamps(kind: str, width: int) -> dict:
    """Return twenty lamps, each as wide as a fifth of the pixel that it is in."""
    T, rng, shapes = mi.ScalarTransform4f, np.random.default_rng(1), {}
    for i in range(20):
        at = rng.uniform([-4, 0.6, -10], [4, 3, 0])
        side = float(0.2 * 2 * np.tan(np.radians(FOV / 2)) * np.linalg.norm(at - EYE) / width)
        shape = {"type": "rectangle", "to_world": T().translate(at.tolist()).scale(side / 2)}
        if kind == "balls":
            shape = {"type": "sphere", "center": at.tolist(), "radius": side / 2}
        if kind == "tubes":
            shape = {"type": "cylinder", "p0": at.tolist(), "p1": (at + [1, 0.3, 0]).tolist(), "radius": side / 2}
        shapes[f"small{i}"] = {**shape, "emitter": {"type": "area", "radiance": 50.0}}
    return shapes


def floored(name: str, floor: dict, width: int) -> dict:
    """Return the ball lamps and a floor that mirrors them."""
    bsdf = FLOORS[name]
    if name == "waves":
        y, x = np.mgrid[:128, :128] * (2 * np.pi / 32)
        tilt = np.stack([0.5 + 0.02 * np.sin(x + np.sin(y)), 0.5 + 0.02 * np.cos(y + x), np.ones_like(x)], axis=-1)
        image = {"type": "bitmap", "raw": True, "bitmap": mi.Bitmap(tilt.astype(np.float32))}
        bsdf = {"type": "normalmap", "normalmap": image, "bsdf": bsdf}
    return {**lamps("balls", width), "floor": {**floor, "bsdf": bsdf}}


def balls(bsdf: dict) -> dict:
    """Return forty balls of one material."""
    rng = np.random.default_rng(1)
    places = rng.uniform([-3, 0.2, -3], [3, 2.5, 2], (40, 3))
    return {f"ball{i}": {"type": "sphere", "center": p.tolist(), "radius": 0.05, "bsdf": bsdf} for i, p in enumerate(places)}


SHINY = {
    "metal": {"type": "roughconductor", "alpha": 0.05},
    "mirror": {"type": "conductor"},
    "plastic": {"type": "plastic"},
    "glass": {"type": "dielectric"},
}
FLOORS = {"mirror floor": SHINY["mirror"], "glass floor": SHINY["glass"], "waves": SHINY["metal"]}
LAMPS = {"square lamps": "squares", "ball lamps": "balls", "tubes": "tubes", "out of focus": "squares"}


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark, print the table and write it."""
    note = "; for highlights 4 times that"
    a = options("benchmarks.direct_small", __doc__, repeats=10, reference=8192, width=320, note=note).parse_args(arguments)
    mi.set_variant("llvm_ad_rgb")
    from .direct_tables import machine

    T = mi.ScalarTransform4f
    room = {
        "type": "scene",
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(30)},
        "wall": {"type": "rectangle", "to_world": T().translate([0, 5, -12]).scale(20)},
        "lamp": {
            "type": "rectangle",
            "to_world": T().translate([0, 7, 4]).rotate([1, 0, 0], 90),
            "emitter": {"type": "area", "radiance": 20.0},
        },
    }
    view = {"to_world": T().look_at(EYE.tolist(), [0, 1.4, 0], [0, 1, 0]), "fov": FOV}
    lens = {"type": "thinlens", "aperture_radius": 0.1, "focus_distance": 5.0}
    things = {name: lamps(kind, a.width) for name, kind in LAMPS.items()} | {n: balls(b) for n, b in SHINY.items()}
    things |= {name: floored(name, room["floor"], a.width) for name in FLOORS}
    rows = []
    for name, shapes in things.items():
        camera = {**view, **(lens if name == "out of focus" else {"type": "perspective"})}
        # Highlights of which a sliver is in a pixel are rare and bright: references need many samples
        matt = name in LAMPS
        reference = a.reference * (1 if matt else 4)
        row, _ = beside_direct(f"small-{name}", {**room, **shapes}, camera, a.width, a.repeats, a.cache, reference, matt)
        rows.append("| " + " | ".join([name, *row]) + " |")
        print(rows[-1], flush=True)
    head = "| in view | best `direct` | its time | ours | time ratio | error ratio | gain |"
    table = "\n".join([head, "|---" * 7 + "|", *rows])
    about = {"machine": machine(), "width": a.width, "height": a.width * 9 // 16, "spp": SPP, "repeats": a.repeats}
    a.output.mkdir(parents=True, exist_ok=True)
    (a.output / "small.md").write_text(TEXT.format(**about, table=table), encoding="utf-8")


if __name__ == "__main__":
    main()
