"""Light of skies: `visdirect` against Mitsuba's `direct` under even skies, soft boxes and suns.

``python -m benchmarks.direct_skies`` writes ``docs/direct/skies.md``.
"""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np

import intervis  # noqa: F401  (registers the plugins)

from .direct_lights import SPP, beside_direct, options

TEXT = """# Skies, measured

{machine}. Films of {width}×{height} at {spp} samples a pixel; {repeats} repeats, warm, interleaved; medians. Balls on an open
floor (`open`), 150 posts that stand close (`crowd`), balls in a room with one window (`room`), all of one material: matt,
plastic (rough, 0.1) or metal (rough, 0.15). The sky is the same all over (`constant`), `overcast` (of the CIE, dark below),
a `studio` with three soft boxes, or clear with a small `sun`. The setting of `direct` is the one of least error × time, with
and without BSDF samples where all is matt. The gain is error × time of `direct` over that of `visdirect`, with the least and
the largest of the repeats.

{table}

Geometric means: {means}.

![direct and visdirect at 16 samples a pixel](skies.png)

`direct` (left) and `visdirect` at 16 samples a pixel: plastic under soft boxes, matt posts under a sun, and a
room whose window faces away from that sun.
"""
EYE = {"origin": [0, 1.2, 4.5], "target": [0, 0, 0], "up": [0, 1, 0]}


def skies() -> dict:
    """Return emitters by name."""
    up = np.cos((np.arange(64) + 0.5) / 64 * np.pi)
    overcast = np.where(up > 0, (1 + 2 * up) / 3, 0.08)[:, None] * np.ones(128)
    studio = np.full((128, 256), 0.02)
    studio[20:50, 30:70], studio[30:60, 120:180], studio[10:20, 200:230] = 3, 1.5, 6
    y, x = np.mgrid[:512, :1024]
    sun = np.where(y < 256, 0.3 + 0.5 * (y / 256) ** 3, 0.15)
    sun[(y - 130) ** 2 + (x - 300) ** 2 < 9] = 4000
    maps = {"overcast": overcast, "studio": studio, "sun": sun}
    rgb = {name: np.repeat(m[..., None], 3, axis=2).astype(np.float32) for name, m in maps.items()}
    return {"constant": {"type": "constant", "radiance": 0.5}} | {
        name: {"type": "envmap", "bitmap": mi.Bitmap(m)} for name, m in rgb.items()
    }


def slab(low, high) -> dict:
    """Return an upright box between two corners."""
    T, low, high = mi.ScalarTransform4f, np.array(low, float), np.array(high, float)
    return {"type": "cube", "to_world": T().translate((0.5 * (low + high)).tolist()).scale((0.5 * (high - low)).tolist())}


def balls() -> dict:
    """Return three balls on the ground."""
    places = ([-1.1, -0.4, 0], [0.2, -0.2, -0.5], [1.2, -0.6, 0.6])
    return {f"ball{i}": {"type": "sphere", "center": p, "radius": 1 + p[1]} for i, p in enumerate(places)}


def open_floor() -> dict:
    """Return balls on a wide floor."""
    return {"floor": slab([-10, -1.2, -10], [10, -1, 10]), **balls()}


def crowd() -> dict:
    """Return posts that stand close."""
    rng, shapes = np.random.default_rng(3), {"floor": slab([-10, -1.2, -10], [10, -1, 10])}
    for i in range(150):
        (x, z), height = rng.uniform(-4, 4, 2), rng.uniform(0.2, 1.5)
        shapes[f"post{i}"] = slab([x - 0.12, -1, z - 0.12], [x + 0.12, height - 1, z + 0.12])
    return shapes


def room() -> dict:
    """Return balls in a closed room with a window at the left."""
    walls = {
        "floor": slab([-3, -1.2, -3], [3, -1, 5]),
        "ceiling": slab([-3, 2, -3], [3, 2.2, 5]),
        "back": slab([-3, -1, -3.2], [3, 2, -3]),
        "front": slab([-3, -1, 5], [3, 2, 5.2]),
        "right": slab([3, -1, -3], [3.2, 2, 5]),
        "below": slab([-3.2, -1, -3], [-3, 0.2, 5]),
        "above": slab([-3.2, 1.4, -3], [-3, 2, 5]),
        "beside": slab([-3.2, 0.2, -3], [-3, 1.4, -1]),
    }
    return {**walls, **balls()}


PLACES = {"open": open_floor, "crowd": crowd, "room": room}
MATERIALS = {
    "matt": {"type": "diffuse"},
    "plastic": {"type": "roughplastic", "alpha": 0.1},
    "metal": {"type": "roughconductor", "alpha": 0.15},
}


def lit(place: str, emitter: dict, bsdf: dict) -> dict:
    """Return a scene of one material under a sky."""
    return {"type": "scene", "sky": emitter, **{k: {**s, "bsdf": bsdf} for k, s in PLACES[place]().items()}}


def picture(path: Path) -> None:
    """Draw what both integrators make of 16 samples a pixel."""
    film = {"type": "hdrfilm", "width": 320, "height": 180, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    camera = {"type": "perspective", "fov": 40, "to_world": mi.ScalarTransform4f().look_at(**EYE), "film": film}
    rows, emitters = [], skies()
    for place, sky, material in (("open", "studio", "plastic"), ("crowd", "sun", "matt"), ("room", "sun", "matt")):
        scene = mi.load_dict({**lit(place, emitters[sky], MATERIALS[material]), "camera": camera})
        pair = [np.array(mi.render(scene, integrator=mi.load_dict({"type": k}), spp=16)) for k in ("direct", "visdirect")]
        rows.append(np.concatenate(pair, axis=1) / np.percentile(pair[1], 97))
    pixels = np.clip(np.concatenate(rows), 0, 1) ** (1 / 2.2)
    mi.Bitmap((255 * pixels[..., :1]).astype(np.uint8)).write(str(path))


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark, print the table and write it."""
    a = options("benchmarks.direct_skies", __doc__, repeats=5, reference=2048, width=256).parse_args(arguments)
    mi.set_variant("llvm_ad_rgb")
    from .direct_tables import machine

    camera = {"type": "perspective", "fov": 40, "to_world": mi.ScalarTransform4f().look_at(**EYE)}
    rows, gains = [], {m: [] for m in MATERIALS}
    for place in PLACES:
        for sky, emitter in skies().items():
            for material, bsdf in MATERIALS.items():
                scene, name, matt = lit(place, emitter, bsdf), f"{place}-{sky}-{material}", material == "matt"
                more = ({"bsdf_samples": 1},) if matt else ()
                row, gain = beside_direct(name, scene, camera, a.width, a.repeats, a.cache, a.reference, matt, more)
                gains[material].append(np.median(gain))
                rows.append("| " + " | ".join([place, sky, material, *map(str, row)]) + " |")
                print(rows[-1], flush=True)
    head = "| place | sky | material | best `direct` | its time | ours | time ratio | error ratio | gain |"
    means = ", ".join(f"{m} {np.exp(np.mean(np.log(g))):.2f}× (least {min(g):.2f}×)" for m, g in gains.items())
    about = {"machine": machine(), "width": a.width, "height": a.width * 9 // 16, "spp": SPP, "repeats": a.repeats}
    table = "\n".join([head, "|---" * 9 + "|", *rows])
    a.output.mkdir(parents=True, exist_ok=True)
    picture(a.output / "skies.png")
    (a.output / "skies.md").write_text(TEXT.format(**about, table=table, means=means), encoding="utf-8")


if __name__ == "__main__":
    main()
