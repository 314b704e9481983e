"""Make the pictures of the README: renders, class maps, ray maps and error maps (``python -m benchmarks.pictures``)."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mitsuba as mi
import numpy as np

import intervis  # noqa: F401  (registers the plugins)

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from intervis import scenes
from intervis.visibility import COLORS, NAMES

OUT = Path(__file__).resolve().parent.parent / "docs" / "pictures"
SHOWN = ("fence", "foliage", "glossy", "spheres", "manylights", "cornell")


def _srgb(x):
    x = np.clip(x, 0, None)
    return np.clip(np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055), 0, 1)


def _bare(axis, title):
    axis.set_title(title, fontsize=9, loc="left")
    axis.axis("off")


def main() -> None:
    """Render the scenes and write ``docs/pictures``."""
    OUT.mkdir(parents=True, exist_ok=True)
    mi.set_variant("llvm_ad_rgb")
    direct = mi.load_dict({"type": "direct"})

    # One scene taken apart: what was seen, what was spent, what error is left
    scene = mi.load_dict(scenes.load("fence"))
    integrator = mi.load_dict({"type": "visdirect", "aovs": True})
    layers = np.array(mi.render(scene, integrator=integrator, spp=64, seed=1))
    reference = np.mean([np.array(mi.render(scene, integrator=direct, spp=1024, seed=s)) for s in range(2, 4)], axis=0)
    image, label, rays = layers[..., :3], layers[..., 3].astype(int), layers[..., 5]
    error = np.abs(image - reference).mean(axis=2) / (reference.mean(axis=2) + 0.01)
    figure, axes = plt.subplots(2, 2, figsize=(9.8, 6.0), layout="constrained")
    axes[0, 0].imshow(_srgb(image))
    _bare(axes[0, 0], "visdirect, 64 spp")
    colors = np.array([COLORS[i] for i in range(7)], dtype=float)
    axes[0, 1].imshow((colors / 255 if colors.max() > 1 else colors)[label])
    _bare(axes[0, 1], "visibility class of the light")
    names = [NAMES[i] for i in range(7)]
    present = [i for i in range(7) if (label == i).any()]
    handles = [plt.Rectangle((0, 0), 1, 1, color=(colors / 255 if colors.max() > 1 else colors)[i]) for i in present]
    axes[0, 1].legend(handles, [str(names[i]).replace("_", " ") for i in present], fontsize=6, loc="lower right")
    # A few pixels have many times what others have: they would leave the rest dark
    shown = axes[1, 0].imshow(rays, cmap="magma", vmax=np.percentile(rays, 99))
    _bare(axes[1, 0], "shadow rays a pixel")
    figure.colorbar(shown, ax=axes[1, 0], shrink=0.8)
    shown = axes[1, 1].imshow(error, cmap="viridis", vmax=0.1)
    _bare(axes[1, 1], "relative error against 2048 spp")
    figure.colorbar(shown, ax=axes[1, 1], shrink=0.8)
    figure.savefig(OUT / "maps.png", dpi=72)

    # The scene library
    figure, axes = plt.subplots(2, 3, figsize=(9.8, 3.9), layout="constrained")
    for axis, name in zip(axes.flat, SHOWN, strict=True):
        scene = mi.load_dict(scenes.load(name, width=320, height=180))
        axis.imshow(_srgb(np.array(mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=128))))
        _bare(axis, name)
    figure.savefig(OUT / "scenes.png", dpi=80)


if __name__ == "__main__":
    main()
