"""Path trace the references of the height-field tests with Mitsuba: ``python tests/heightfield/make_references.py``."""

import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "references"
LIGHT = {"sky": 30.0, "sun": (2.4, 0.5, 900.0), "albedo": 0.4, "bounces": 2}
SAMPLES = 16384


def fields():
    """Return the fields by name: smooth, rough, and 64 × 64 points of real terrain."""
    from intervis.heightfield import HeightField, example, make

    heights, spacing = example()
    return {
        "sine": HeightField(make("sine", 64)),
        "fractal": HeightField(make("fractal", 64, seed=1)),
        "jacksboro": HeightField(heights[100:164, 100:164], spacing),
    }


def main():
    import mitsuba as mi

    import intervis
    from intervis.images import write_exr

    mi.set_variant("llvm_ad_rgb")
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    from benchmarks.heightfield_path import path_irradiance

    FOLDER.mkdir(exist_ok=True)
    for name, field in fields().items():
        halves = [path_irradiance(field, *LIGHT.values(), SAMPLES // 2, seed=s) for s in (1, 2)]
        error = np.sqrt(np.mean((halves[0] - halves[1]) ** 2)) / 2 / np.mean(halves)
        header = {"mitsuba": mi.__version__, "intervis": intervis.__version__, "samples": SAMPLES, "relative_error": error}
        write_exr(FOLDER / f"{name}.exr", {"irradiance": np.mean(halves, axis=0)}, header)
        print(name, f"relative standard error {error:.2e}")


if __name__ == "__main__":
    main()
