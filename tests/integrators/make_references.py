"""Render the reference images with Mitsuba's own integrators: ``python tests/integrators/make_references.py [NAME]…``.

Each EXR holds the mean of many seeds and the variance of that mean. Shadow references sample the emitters only.
"""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

from intervis.images import write_exr
from intervis.testing import mean_and_variance, tiles

HERE = Path(__file__).parent / "references"
WIDTH, HEIGHT, TILE = 64, 40, 8
SEEDS = 16


def reference(name: str, scene: str, integrator: dict, spp: int) -> None:
    """Render one reference and write it, in tiles, which is what the tests compare."""
    from intervis import scenes

    loaded = mi.load_dict(scenes.load(scene, width=WIDTH, height=HEIGHT))
    plugin = mi.load_dict(integrator)
    mean, variance = mean_and_variance(
        lambda seed: tiles(np.array(mi.render(loaded, integrator=plugin, spp=spp, seed=seed)), TILE),
        range(9000, 9000 + SEEDS),
    )
    header = {"integrator": str(integrator), "samples": spp * SEEDS, "tile": TILE}
    layers = {"rgb": mean.astype(np.float32)}
    layers |= {f"variance.{c}": variance[..., i].astype(np.float32) for i, c in enumerate("RGB")}
    write_exr(HERE / f"{name}.exr", layers, header)
    print(name, mean.mean((0, 1)), flush=True)


def main(wanted: list[str]) -> None:
    """Render the references named, or all."""
    from intervis import scenes

    mi.set_variant("llvm_ad_rgb")
    HERE.mkdir(exist_ok=True)
    jobs = {n: (n, {"type": "direct"}, 256) for n in scenes.names()}
    jobs |= {f"path_{n}": (n, {"type": "path", "max_depth": 6}, 256) for n in ("cornell", "glossy")}
    for name in wanted or jobs:
        reference(name, *jobs[name])


if __name__ == "__main__":
    main(sys.argv[1:])
