"""One rectangle light over many materials: its closed form on the Lambertian ones, samples on the others."""

import mitsuba as mi
import numpy as np
import pytest

OTHERS = {
    "roughplastic": {"type": "roughplastic", "alpha": 0.2},
    "conductor": {"type": "roughconductor", "alpha": 0.1},
    "dielectric": {"type": "dielectric"},
    "plastic_twosided": {"type": "twosided", "nested": {"type": "plastic"}},
    "blend": {"type": "blendbsdf", "weight": 0.4, "a": {"type": "diffuse"}, "b": {"type": "roughconductor"}},
}


def room(kit, other, **more):
    scene = kit.room(**more)
    scene["blocker"] = {**kit.room()["blocker"], "bsdf": OTHERS[other]}
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("other", OTHERS)
def test_pictures_of_mixed_materials(kit, other):
    kit.compare(room(kit, other), reference={"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})


@pytest.mark.slow
def test_mixed_materials_beside_a_light(kit):
    T = mi.ScalarTransform4f()
    lamp = {"type": "rectangle", "to_world": T.translate([0.1, 0.5, -0.4]) @ T.scale(0.5),
            "emitter": {"type": "area", "radiance": 3.0}}  # fmt: skip
    kit.compare(room(kit, "roughplastic", lights={"lamp": lamp}), reference={"type": "direct"})


def test_no_light_noise_on_the_floor_beside_other_materials(kit):
    # Far from its shadow the floor sees all of the light: what seeds change there is rounding
    camera = kit.sensor(origin=(-2, 1.5, 3), target=(-2, 0, 1.5), fov=20)
    scene = mi.load_dict(room(kit, "roughplastic", camera=camera))
    integrator = mi.load_dict({"type": "visdirect"})
    flat = [np.array(mi.render(scene, integrator=integrator, spp=64, seed=k)).mean((0, 1)) for k in range(2)]
    assert integrator.report.rays["refinement"] == 0 and integrator.report.skipped["provably visible"] > 0
    assert flat[0] == pytest.approx(flat[1], rel=1e-4)
