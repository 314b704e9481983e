"""What covers a pixel, and what is hidden from the camera: alpha as Mitsuba's own integrators have it."""

import mitsuba as mi
import numpy as np
import pytest

from intervis.testing import mean_and_variance

SIZE = 16
SURFACES = {
    "floor": {"type": "diffuse"},
    "null": {"type": "null"},
    "mask": {"type": "mask", "opacity": 0.4, "inner": {"type": "diffuse"}},
}


def pane(kit, bsdf, **more):
    """Return a square that covers a quarter of an rgba film, and nothing behind it but what is given."""
    camera = kit.sensor(origin=(0, 0, 4), target=(0, 0, 0), size=SIZE, fov=53.13, film={"pixel_format": "rgba"})
    return mi.load_dict({"type": "scene", "sensor": camera, "pane": {"type": "rectangle", "bsdf": bsdf}, **more})


def sky():
    return {"type": "constant"}


def lamp():
    """Return a lamp of radiance 1 that covers all of the film, seen from the front."""
    T = mi.ScalarTransform4f
    return {"type": "rectangle", "to_world": T().translate([0, 0, -2]).scale(4), "emitter": {"type": "area", "radiance": 1.0}}


def means(scene, kind, spp=64, **settings):
    """Mean colour and alpha of the picture, and of the square alone."""
    image = np.array(mi.render(scene, integrator=mi.load_dict({"type": kind, **settings}), spp=spp), dtype=np.float64)
    inside = image[5:-5, 5:-5]
    return np.array([image[..., 0].mean(), image[..., 3].mean(), inside[..., 0].mean(), inside[..., 3].mean()])


def test_alpha_under_a_sky(kit):
    """Surfaces cover in `direct`, the sky as well in `path`."""
    scene = mi.load_dict(kit.room({"sky": sky()}, camera=kit.sensor(film={"pixel_format": "rgba"})))
    for ours, theirs in (("visdirect", "direct"), ("vispath", "path")):
        a, b = (np.array(mi.render(scene, integrator=mi.load_dict({"type": t}), spp=64))[..., 3] for t in (ours, theirs))
        np.testing.assert_allclose(a, b, atol=0.3)
        assert abs(a.mean() - b.mean()) < 0.01


@pytest.mark.parametrize("hide", [False, True])
@pytest.mark.parametrize("light", [sky, lamp])
@pytest.mark.parametrize("surface", ["floor", "null"])
def test_alpha_as_path(kit, surface, light, hide):
    """A surface that lets rays pass straight through covers nothing, and does not show a sky that is hidden."""
    scene = pane(kit, SURFACES[surface], light=light())
    for depth in (2, 4):
        ours, theirs = (means(scene, t, max_depth=depth, hide_emitters=hide) for t in ("vispath", "path"))
        np.testing.assert_allclose(ours, theirs, atol=0.01)


def test_a_mask_before_a_hidden_sky(kit):
    """Its own light and share of alpha are left: (0.4 · 0.5, 0.4) under an even sky of 1 (reflectance 0.5)."""
    scene = pane(kit, SURFACES["mask"], light=sky())
    x, variance = mean_and_variance(
        lambda seed: np.array(
            mi.render(scene, integrator=mi.load_dict({"type": "vispath", "hide_emitters": True}), spp=16, seed=seed)
        )[5:-5, 5:-5].mean((0, 1)),
        range(16),
    )
    np.testing.assert_array_less(np.abs(x - [0.2, 0.2, 0.2, 0.4]), 4 * np.sqrt(variance) + 1e-6)
    assert (variance < 0.02**2).all()


@pytest.mark.parametrize("lit", [True, False])
def test_outlines_in_the_dark(kit, lit):
    """Where a film wants alpha, outlines get hits even if no light tells them: closer than `direct` at the same budget."""
    camera = kit.sensor(origin=(0, 0, 4), target=(0, 0, 0), film={"pixel_format": "rgba"})
    black = {"type": "diffuse", "reflectance": 0.0}
    lights = {"lamp": kit.lamp()} if lit else {}
    scene = mi.load_dict({"type": "scene", "sensor": camera, "ball": {"type": "sphere", "bsdf": black}, **lights})

    def alpha(kind, spp):
        return np.array(mi.render(scene, integrator=mi.load_dict({"type": kind}), spp=spp))[..., 3]

    reference = alpha("direct", 4096)
    ours, theirs = (np.sqrt(np.mean((alpha(t, 32) - reference) ** 2)) for t in ("visdirect", "direct"))
    assert ours < theirs


@pytest.mark.slow
def test_light_of_a_mask_before_nothing(kit):
    """Mitsuba's `path` drops it whenever the ray goes straight on; its `prb` does not."""
    scene = kit.room(blocker=False, ball={"type": "sphere", "center": [0, 0.5, 0.2], "radius": 0.4, "bsdf": SURFACES["mask"]})
    kit.compare(scene, "prb", "vispath", both={"max_depth": 4}, reference_spp=64)
