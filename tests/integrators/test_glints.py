"""Highlights below a pixel: where mirror directions tell of them, and what that makes of pictures full of them."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.camera import Frame
from intervis.integrators.glints import glints
from intervis.integrators.pilot import pilot
from intervis.integrators.shading import prepare

MIRROR = {"type": "conductor", "material": "none"}
METAL = {"type": "roughconductor", "material": "none", "alpha": 0.05}


def T():
    return mi.ScalarTransform4f()


def ball(bsdf, **more):
    """A small ball some pixels wide, which a lamp far above and behind the camera shines on."""
    lamp = {"type": "sphere", "center": [0, 30, 30], "radius": 1.0, "emitter": {"type": "area", "radiance": 50.0}}
    return {"lamp": lamp, "ball": {"type": "sphere", "radius": 0.3, "bsdf": bsdf}, **more}


def told(scene):
    """Mean and variance that are told of each pixel's highlights; images."""
    frame = Frame(scene.sensors()[0])
    shading = prepare(scene)
    shading.integrator, shading.hide = mi.load_dict({"type": "visdirect"}), False
    look = pilot(shading, frame, mi.UInt32(1), 4, True)
    dr.eval(vars(look))
    return [np.array(x).reshape(frame.height, frame.width) for x in glints(shading, frame, look.shine)[:2]]


@pytest.mark.parametrize("bsdf", [MIRROR, METAL], ids=["mirror", "metal"])
def test_a_ball_shows_a_highlight_where_it_is(kit, bsdf):
    """A sum over a ball's pixels of what is told of their highlights is near what they really add, in the right place."""
    scene = mi.load_dict({"type": "scene", "sensor": kit.sensor((0, 0, 4), (0, 0, 0), size=33), **ball(bsdf)})
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "direct"}), spp=2048))[..., 0]
    mean, variance = told(scene)
    lit = truth > 0.1 * truth.max()
    assert 1 <= np.count_nonzero(lit) < 10
    assert (variance[lit] > 0).all()
    assert np.count_nonzero(variance) < 30
    # All pixels that may have it count with the whole of it: by an area of 1.5 in half-width, a disk's, seven of them
    assert truth.sum() < mean[truth > 0].sum() < 12 * truth.sum()


def test_flat_things_have_none_where_no_lamp_is_mirrored(kit):
    camera = kit.sensor((0, 0, 4), (0, 0, 0), size=33)
    lamp = ball(METAL)["lamp"]
    for place in (T().scale(3), T().translate([0, 0, -1])):
        flat = {"type": "rectangle", "to_world": place, "bsdf": METAL}
        mean, variance = told(mi.load_dict({"type": "scene", "sensor": camera, "lamp": lamp, "thing": flat}))
        # Along outlines, where a look misses the thing above and below, nothing is known of it
        assert not variance[11:22, 11:22].any() and not mean[11:22, 11:22].any()


def mirrored(kit, bsdf, size):
    """What is told, and the truth, of a flat square in which a small lamp behind the camera is mirrored at its middle."""
    lamp = {"type": "sphere", "center": [0, 0, 6], "radius": size, "emitter": {"type": "area", "radiance": 50.0}}
    flat = {"type": "rectangle", "to_world": T().scale(3), "bsdf": bsdf}
    scene = mi.load_dict({"type": "scene", "sensor": kit.sensor((0, 0, 4), (0, 0, 0), size=33), "lamp": lamp, "flat": flat})
    return *told(scene), np.array(mi.render(scene, integrator=mi.load_dict({"type": "direct"}), spp=2048))[..., 0]


def test_a_flat_mirror_shows_a_lamp_below_a_pixel(kit):
    mean, variance, truth = mirrored(kit, MIRROR, 0.05)
    middle = truth[16, 16]
    assert truth.sum() == pytest.approx(middle, rel=0.01)
    # It is told of in all pixels that may show it, as far as the surface is seen from elsewhere in each
    assert truth.sum() < mean.sum() < 12 * truth.sum()
    assert 0.2 < variance[16, 16] / (middle * (50 - middle)) < 2
    assert not variance[:13].any() and not variance[:, 20:].any()


def test_a_pane_mirrors_a_lamp_in_one_look_of_many(kit):
    mean, variance, truth = mirrored(kit, {"type": "dielectric"}, 0.6)
    # Several pixels all of which show it, at 4 % of 50: one look in 25
    assert truth[15:18, 15:18].mean() == pytest.approx(2.0, rel=0.1)
    # A lamp not much larger than a pixel may be outside
    assert (mean[15:18, 15:18] < 2.0).all() and (mean[15:18, 15:18] > 1.0).all()
    assert variance[15:18, 15:18] == pytest.approx(24 * 2.0 * mean[15:18, 15:18], rel=0.1)


@pytest.mark.parametrize("bsdf", [MIRROR, {"type": "dielectric"}, {"type": "plastic"}], ids=["mirror", "glass", "plastic"])
def test_mirrors_do_not_show_points(kit, bsdf):
    lamp = {"type": "point", "position": [0, 30, 30], "intensity": 1e5}
    scene = mi.load_dict({"type": "scene", "sensor": kit.sensor((0, 0, 4), (0, 0, 0), size=33), **ball(bsdf), "lamp": lamp})
    mean, variance = told(scene)
    assert not mean.any() and not variance.any()


def test_normal_maps_bend_what_is_mirrored(kit):
    """A flat thing with waves shows highlights where a flat one has none."""
    waves = np.zeros((33, 33, 3), np.float32)
    waves[..., 0] = 0.5 + 0.2 * np.sin(np.arange(33))
    waves[..., 1:] = 0.5, 1
    image = {"type": "bitmap", "raw": True, "bitmap": mi.Bitmap(waves)}
    waved = {"type": "normalmap", "normalmap": image, "bsdf": METAL}
    camera, lamp = kit.sensor((0, 0, 4), (0, 0, 0), size=33), ball(METAL)["lamp"]
    lamp = {**lamp, "center": [25, 0, 30]}
    found = []
    for bsdf in (METAL, waved):
        flat = {"type": "rectangle", "to_world": T().scale(3), "bsdf": bsdf}
        scene = mi.load_dict({"type": "scene", "sensor": camera, "lamp": lamp, "flat": flat})
        found.append(np.count_nonzero(told(scene)[1]))
    assert found[0] < 10 and found[1] > 100


def test_matt_scenes_do_not_ask(kit):
    scene = mi.load_dict(kit.room())
    shading = prepare(scene)
    shading.integrator = mi.load_dict({"type": "visdirect"})
    assert pilot(shading, Frame(scene.sensors()[0]), mi.UInt32(1), 4, True).shine is None


@pytest.mark.parametrize("bsdf", [MIRROR, METAL, {"type": "dielectric"}], ids=["mirror", "metal", "glass"])
def test_highlights_below_a_pixel_do_not_stand_out(kit, bsdf):
    """No worse than rays spread evenly: pixels that a highlight is somewhere in get as many rays as it takes."""
    rng = np.random.default_rng(2)
    balls = {}
    for k in range(12):
        at = [float(c) for c in (rng.uniform(-1, 1), rng.uniform(0.2, 1.2), rng.uniform(-1, 1))]
        balls[f"ball {k}"] = {"type": "sphere", "center": at, "radius": 0.08, "bsdf": bsdf}
    scene = kit.room({"lamp": kit.lamp()}, camera=kit.sensor(size=48), blocker=False, **balls)
    assert kit.error_ratio(scene, 4096) < 0.7


@pytest.mark.parametrize("bsdf, limit", [(MIRROR, 0.4), ({"type": "dielectric"}, 1.5)], ids=["mirror", "glass"])
def test_lamps_mirrored_by_flat_things_do_not_stand_out(kit, bsdf, limit):
    """Which no light sample finds: what pixels look like without light samples is no sign that nothing is there."""
    rng = np.random.default_rng(4)
    lamps = {}
    for k in range(8):
        at = [float(c) for c in rng.uniform([-1.5, 0.2, -2.5], [1.5, 1.5, -1])]
        glow = {"type": "area", "radiance": 20.0}
        lamps[f"lamp {k}"] = {"type": "sphere", "center": at, "radius": float(rng.uniform(0.02, 0.15)), "emitter": glow}
    scene = kit.room(lamps, bsdf=bsdf, camera=kit.sensor(size=48), blocker=False)
    assert kit.error_ratio(scene, 4096, seeds=12) < limit
