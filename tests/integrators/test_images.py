"""Images of the built-in scenes against references kept as EXR files (see make_references.py)."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from intervis import scenes
from intervis.images import read_exr
from intervis.testing import assert_matches_reference, mean_and_variance, tiles

HERE = Path(__file__).parent / "references"
WIDTH, HEIGHT, TILE = 64, 40, 8
QUICK = ("penumbra", "wires", "manylights", "glossy")
SCENES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in scenes.names()]


def check(reference, scene, seeds=32, spp=16, **integrator):
    layers, _ = read_exr(HERE / f"{reference}.exr")
    mean = next(v for k, v in layers.items() if np.ndim(v) == 3 and "variance" not in k)
    spread = layers["variance"] if "variance" in layers else np.dstack([layers[f"variance.{c}"] for c in "RGB"])
    loaded = mi.load_dict(scenes.load(scene, width=WIDTH, height=HEIGHT))
    plugin = mi.load_dict(integrator)

    def both(seed):
        image = np.array(mi.render(loaded, integrator=plugin, spp=spp, seed=seed), dtype=np.float64)
        small = tiles(image, TILE)
        return np.concatenate([small.reshape(-1, 3), small.mean((0, 1))[None]])

    x, v = mean_and_variance(both, range(seeds))
    # A tile whose samples all agree still owes its reference's noise
    flat, flat_v = mean.reshape(-1, 3), spread.reshape(-1, 3).astype(np.float64)
    assert_matches_reference(
        x[None, :-1],
        (v[:-1] + flat_v)[None],
        flat[None],
        samples=seeds,
        mean_variance=v[-1] + flat_v.sum(0) / len(flat) ** 2,
        name=reference,
    )


@pytest.mark.parametrize("name", SCENES)
def test_direct_light_matches_its_reference(variant_llvm, name):
    check(name, name, type="visdirect")


@pytest.mark.slow
@pytest.mark.parametrize("classifier", ["mlp", "svm"])
def test_classifiers_change_no_expectation(variant_llvm, classifier):
    check("fence", "fence", type="visdirect", classifier=classifier)


@pytest.mark.slow
def test_refinement_changes_no_expectation(variant_llvm):
    check("grating", "grating", type="visdirect", refine=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell", "glossy"])
def test_paths_match_their_reference(variant_llvm, name):
    check(f"path_{name}", name, seeds=32, type="vispath", max_depth=6)


def test_open_floor_has_no_light_noise(variant_llvm, kit):
    """Nothing is in the way of a rectangle light over a Lambertian floor: two seeds agree to float rounding."""
    scene = kit.room(blocker=False, camera=kit.sensor(origin=(0, 1.2, 1.2), target=(0, 0, 0), size=16))
    # No noise from inside the pixel either: the mean irradiance changes linearly to second order
    loaded = mi.load_dict(scene)
    plugin = mi.load_dict({"type": "visdirect"})
    a, b = (np.array(mi.render(loaded, integrator=plugin, spp=64, seed=s)) for s in (1, 2))
    direct = mi.load_dict({"type": "direct"})
    c, d = (np.array(mi.render(loaded, integrator=direct, spp=64, seed=s)) for s in (1, 2))
    ours, theirs = (np.sqrt(np.mean(((x - y) / y) ** 2)) for x, y in ((a, b), (c, d)))
    assert ours < 3e-3 and ours < 0.05 * theirs


def test_a_tiny_view_of_an_open_floor_is_exact(variant_llvm, kit):
    """Where the pixel's own footprint does not matter, only float rounding is left."""
    camera = kit.sensor(origin=(0, 1.2, 1.2), target=(0, 0, 0), size=16, fov=0.001)
    loaded = mi.load_dict(kit.room(blocker=False, camera=camera))
    plugin = mi.load_dict({"type": "visdirect"})
    a, b = (np.array(mi.render(loaded, integrator=plugin, spp=16, seed=s)) for s in (1, 2))
    np.testing.assert_allclose(a, b, rtol=1e-5)
