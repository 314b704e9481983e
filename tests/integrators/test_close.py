"""Surfaces close to a light: their light samples alone would now and then be far too bright."""

import mitsuba as mi
import numpy as np
import pytest


def T():
    return mi.ScalarTransform4f()


def upright(shape, bottom=0.0):
    """Return a lamp that stands on the floor, or nearly, and faces the camera."""
    place = T().translate([0.1, bottom + 0.5, -0.4]) @ T().scale(0.5)
    glow = {"type": "area", "radiance": {"type": "rgb", "value": [3, 2, 1]}}
    return {"type": shape, "to_world": place, "emitter": glow}


def tube(bottom):
    """Return a glowing tube that stands on the floor."""
    glow = {"type": "area", "radiance": {"type": "rgb", "value": [3, 2, 1]}}
    return {"type": "cylinder", "p0": [0.1, bottom, -0.4], "p1": [0.1, bottom + 1, -0.4], "radius": 0.15, "emitter": glow}


LAMPS = {
    "rectangle": lambda: {"lamp": upright("rectangle")},
    "disk": lambda: {"lamp": upright("disk")},
    "cube": lambda: {"lamp": upright("cube", 0.02)},
    "cylinder": lambda: {"lamp": tube(-0.5)},
    "two": lambda: {"lamp": upright("rectangle"), "other": upright("sphere", 0.6)},
}


@pytest.mark.slow
@pytest.mark.parametrize("bsdf", ["diffuse", "roughplastic"])
@pytest.mark.parametrize("lamp", LAMPS)
def test_pictures_beside_a_light(kit, lamp, bsdf):
    scene = kit.room(LAMPS[lamp](), bsdf={"type": "twosided", "nested": {"type": bsdf}})
    kit.compare(scene, reference={"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})


@pytest.mark.parametrize("lamp", LAMPS)
def test_no_sparks_beside_a_light(kit, lamp):
    scene = mi.load_dict(kit.room(LAMPS[lamp](), blocker=False))
    reference = np.array(mi.render(scene, integrator=mi.load_dict({"type": "direct"}), spp=1024, seed=9))
    integrator = mi.load_dict({"type": "visdirect"})
    renders = np.array([np.array(mi.render(scene, integrator=integrator, spp=8, seed=k)) for k in range(8)])
    # Squared errors of a lamp's own brightness and more: without BSDF samples they reach hundreds
    assert ((renders - reference) ** 2).max() < 9


def test_far_lights_cost_no_bsdf_samples(kit):
    integrator = mi.load_dict({"type": "visdirect"})
    mi.render(mi.load_dict(kit.room()), integrator=integrator, spp=8)
    assert integrator.report.rays["bsdf"] == 0
