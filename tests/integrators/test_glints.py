"""Highlights below a pixel: where mirror directions tell of them, and what that makes of pictures full of them."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.camera import Frame
from intervis.integrators.glints import glints
from intervis.integrators.passes import pilot
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
    return [np.array(x).reshape(frame.height, frame.width) for x in glints(shading, frame, look.shine)]


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


def test_flat_things_have_none(kit):
    camera = kit.sensor((0, 0, 4), (0, 0, 0), size=33)
    lamp = ball(METAL)["lamp"]
    for place in (T().scale(3), T().translate([0, 0, -1])):
        flat = {"type": "rectangle", "to_world": place, "bsdf": METAL}
        mean, variance = told(mi.load_dict({"type": "scene", "sensor": camera, "lamp": lamp, "thing": flat}))
        # Along outlines, where a look misses the thing above and below, nothing is known of it
        assert not variance[11:22, 11:22].any() and not mean[11:22, 11:22].any()


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
