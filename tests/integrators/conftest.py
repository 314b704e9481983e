"""What the integrators' tests share: small scenes, and a comparison with Mitsuba's own integrators."""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import mitsuba as mi
import numpy as np
import pytest

from intervis.testing import assert_matches_reference, mean_and_variance, tiles

SIZE, TILE = 32, 8


def render_tiles(scene, integrator, spp, seeds, tile=TILE, keep=None):
    """Mean and variance over seeds of an image's tiles, and of its mean, of one integrator."""

    def stack(seed):
        image = np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed), dtype=np.float64)
        assert np.isfinite(image).all(), "the picture has values that are not finite"
        image = image[..., :keep]
        side = min(tile, *image.shape[:2])
        small = tiles(image, side)
        return np.concatenate([small.reshape(-1, small.shape[-1]), image.mean((0, 1))[None]])

    return mean_and_variance(stack, seeds)


def compare(
    scene,
    reference="direct",
    ours="visdirect",
    spp=16,
    seeds=12,
    reference_spp=128,
    reference_seeds=16,
    keep=None,
    **settings,
):
    """Assert that an intervis integrator and a Mitsuba one agree within their noise; return the integrator.

    Mitsuba's gets the scene as it was written, with no meshes merged: 3.9.1 forgets merged rectangles when it bounds a
    scene, and lets the light of skies through them. `settings` go to ours; those in a dict named `both` go to both.
    """
    both = settings.pop("both", {})
    loaded = mi.load_dict(scene) if isinstance(scene, dict) else scene
    integrator = mi.load_dict({"type": ours, **both, **settings})
    theirs = mi.load_dict({**({"type": reference} if isinstance(reference, str) else reference), **both})
    x, v = render_tiles(loaded, integrator, spp, range(1, 1 + seeds), keep=keep)
    apart = mi.load_dict(scene, optimize=False) if isinstance(scene, dict) else scene
    r, rv = render_tiles(apart, theirs, reference_spp, range(1001, 1001 + reference_seeds), keep=keep)
    assert x.min() >= -1e-6 * max(np.abs(r).max(), 1e-30), "the mean of a tile is negative"
    # The last row is the whole image's mean: its variance counts what pixels share
    mean_v = v[-1] + rv[-1]
    assert_matches_reference(
        x[None, :-1], (v + rv)[None, :-1], r[None, :-1], samples=seeds, mean_variance=mean_v, alpha=1e-3
    )
    return integrator


def error_ratio(scene, reference_spp, seeds=24, spp=64):
    """Mean error (relMSE) of `visdirect` over that of `direct` at equal samples a pixel."""
    loaded = mi.load_dict(scene)

    def render(kind, spp, seed):
        return np.array(mi.render(loaded, integrator=mi.load_dict({"type": kind}), spp=spp, seed=seed), np.float64)

    truth = np.mean([render("direct", reference_spp, 1000 + s) for s in range(4)], axis=0)
    ours, theirs = (
        np.mean([np.mean((render(kind, spp, s) - truth) ** 2 / (truth**2 + 0.01)) for s in range(seeds)])
        for kind in ("visdirect", "direct")
    )
    return ours / theirs


def sensor(origin=(0, 1.2, 4), target=(0, 0.5, 0), size=SIZE, height=None, fov=45, film=None, up=(0, 1, 0), **more):
    """Return a perspective camera on a small box-filtered film."""
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up)),
        "film": {
            "type": "hdrfilm",
            "width": size,
            "height": height or size,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
            **(film or {}),
        },
        **more,
    }


def rectangle_lamp(radiance=8.0, to_world=None):
    """Return a square lamp, 1 wide, 2 above the floor, looking down."""
    T = mi.ScalarTransform4f
    return {
        "type": "rectangle",
        "to_world": to_world or T().translate([0.3, 2, 0]) @ T().rotate([1, 0, 0], 90) @ T().scale(0.5),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [radiance, 0.8 * radiance, 0.6 * radiance]}},
    }


def room(lights=None, bsdf=None, blocker=True, camera=None, **more):
    """Return a floor, a box that casts a shadow, a camera and lights (a rectangle lamp unless given)."""
    T = mi.ScalarTransform4f
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.4, 0.3]}}
    scene = {
        "type": "scene",
        "sensor": camera or sensor(),
        "floor": {
            "type": "rectangle",
            "to_world": T().rotate([1, 0, 0], -90) @ T().scale(3),
            "bsdf": bsdf or grey,
        },
        **({"lamp": rectangle_lamp()} if lights is None else lights),
        **more,
    }
    if blocker:
        scene["blocker"] = {
            "type": "cube",
            "to_world": T().translate([0, 0.5, 0.2]) @ T().rotate([0, 1, 0], 30) @ T().scale(0.25),
            "bsdf": bsdf or grey,
        }
    return scene


class Kit:
    """The helpers above, for tests to ask for as a fixture."""

    compare = staticmethod(compare)
    error_ratio = staticmethod(error_ratio)
    sensor = staticmethod(sensor)
    lamp = staticmethod(rectangle_lamp)
    room = staticmethod(room)
    tiles = staticmethod(render_tiles)


@pytest.fixture
def kit(variant_llvm):
    return Kit
