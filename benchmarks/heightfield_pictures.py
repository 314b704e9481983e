"""The pictures of docs/heightfield.md and README.md: ``python -m benchmarks.heightfield_pictures``."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np

import intervis  # noqa: F401
from intervis.heightfield import HeightField, example
from intervis.images import write_png
from intervis.maps import heat

from .heightfield_path import reference

OUT = Path(__file__).resolve().parent.parent / "docs" / "heightfield"
SUN = (np.radians(300.0), np.radians(25.0), 800.0)
GAP = 6  # pixels between pictures
COLOURS = 224


def beside(pictures: list[np.ndarray]) -> np.ndarray:
    """Join pictures of one height with white gaps."""
    gap = np.ones((pictures[0].shape[0], GAP, 3))
    return np.concatenate([x for p in pictures for x in (p, gap)][:-1], axis=1)


def grey(values: np.ndarray) -> np.ndarray:
    """Return an image of three equal channels."""
    return np.repeat(np.asarray(values, dtype=np.float64)[..., None], 3, axis=2)


def save(name: str, picture: np.ndarray) -> None:
    """Write a linear picture with a palette: a third of the size, and no difference to the eye."""
    from PIL import Image

    path = OUT / name
    write_png(path, picture)
    with Image.open(path) as full:
        full.convert("RGB").quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    print(f"{path.relative_to(OUT.parent.parent)}: {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Light the terrain, trace a piece of it, and write the pictures (Pillow comes with Matplotlib)."""
    mi.set_variant("llvm_ad_rgb")
    OUT.mkdir(parents=True, exist_ok=True)
    heights, spacing = example()
    field = HeightField(heights, spacing)
    # A warm sun under a blue sky
    sun = (SUN[0], SUN[1], np.array([900.0, 780.0, 600.0]))
    light = field.irradiance(sky=[28.0, 40.0, 62.0], sun=sun, albedo=[0.25, 0.22, 0.15], bounces=2)
    seen = field.sky_view(72)
    horizon = np.clip(field.horizons(72).mean(0) / np.radians(25), 0, 1)
    stretch = (seen - np.percentile(seen, 1)) / np.ptp(np.percentile(seen, [1, 99.5]))
    lit = light * np.array([0.25, 0.22, 0.15]) / np.percentile(light, 99.5) * 4.0
    save("terrain.png", beside([lit, grey(np.clip(stretch, 0, 1) ** 2.2), heat(horizon)]))

    # A valley, light gathered and light traced, and where they differ
    part = HeightField(heights[100:228, 100:228], spacing)
    traced = reference(part, 30.0, SUN, 0.4, 2, samples=4096, seed=0)
    gathered = part.irradiance(30.0, (*SUN, 0.0), 0.4, bounces=2)[..., 0]
    top = np.percentile(traced, 99.5)
    difference = np.abs(gathered - traced) / traced.mean()
    rows = [grey(0.8 * gathered / top), grey(0.8 * traced / top), heat(np.clip(difference / 0.005, 0, 1))]
    big = [np.kron(p, np.ones((2, 2, 1))) for p in rows]
    save("error.png", beside(big))
    rms = np.sqrt(np.mean((gathered - traced) ** 2) / np.mean(traced**2))
    print(f"relative RMSE {rms:.4f}")


if __name__ == "__main__":
    main()
