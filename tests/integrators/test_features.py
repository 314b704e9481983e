"""Everything a Mitsuba scene may contain, against Mitsuba's own `direct`."""

import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError


def T():
    return mi.ScalarTransform4f()


def rgb(*value):
    return {"type": "rgb", "value": list(value)}


def area(radiance=8.0):
    return {"type": "area", "radiance": rgb(radiance, 0.8 * radiance, 0.6 * radiance)}


def bitmap(shape=(8, 8), seed=0, low=0.0):
    data = np.random.default_rng(seed).uniform(low, 1, (*shape, 3)).astype(np.float32)
    return mi.Bitmap(data)


def over(scale=0.5, x=0.3):
    return T().translate([x, 2, 0]) @ T().rotate([1, 0, 0], 90) @ T().scale(scale)


EMITTERS = {
    "rectangle": lambda: {"type": "rectangle", "to_world": over(), "emitter": area()},
    "rectangle_sheared": lambda: {
        "type": "rectangle",
        "to_world": over() @ T([[1, 0.6, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        "emitter": area(),
    },
    "rectangle_flipped": lambda: {
        "type": "rectangle",
        "flip_normals": True,
        "to_world": T().translate([0.3, 2, 0]) @ T().rotate([1, 0, 0], -90) @ T().scale(0.5),
        "emitter": area(),
    },
    "rectangle_mirrored": lambda: {
        "type": "rectangle",
        "to_world": over() @ T().scale([-1, 1, 1]),
        "emitter": area(),
    },
    "rectangle_textured": lambda: {
        "type": "rectangle",
        "to_world": over(),
        "emitter": {
            "type": "area",
            "radiance": {"type": "bitmap", "bitmap": bitmap(), "raw": True, "filter_type": "nearest"},
        },
    },
    "disk": lambda: {"type": "disk", "to_world": over(), "emitter": area()},
    "sphere": lambda: {"type": "sphere", "center": [0.4, 1.6, 0.2], "radius": 0.3, "emitter": area()},
    "cube_mesh": lambda: {"type": "cube", "to_world": over(0.2), "emitter": area()},
    "cylinder": lambda: {"type": "cylinder", "p0": [-1, 1.8, 0], "p1": [1, 1.8, 0.3], "radius": 0.1, "emitter": area()},
    "point": lambda: {"type": "point", "position": [0.3, 2, 0], "intensity": rgb(6, 5, 4)},
    "spot": lambda: {
        "type": "spot",
        "to_world": T().look_at(origin=[0.5, 2.5, 1.5], target=[0, 0.3, 0], up=[0, 0, 1]),
        "cutoff_angle": 25,
        "intensity": rgb(12, 11, 9),
    },
    "directional": lambda: {"type": "directional", "direction": [0.3, -1, -0.4], "irradiance": rgb(2, 1.5, 1)},
    "directionalarea": lambda: {
        "type": "rectangle",
        "to_world": over(),
        "emitter": {"type": "directionalarea", "radiance": rgb(3, 2, 1)},
    },
    "constant": lambda: {"type": "constant", "radiance": rgb(0.5, 0.6, 0.9)},
    "envmap": lambda: {"type": "envmap", "bitmap": bitmap((8, 16), 3)},
}

MIXED = {
    "two_rectangles": lambda: [
        EMITTERS["rectangle"](),
        {"type": "rectangle", "to_world": over(0.15, -0.8), "emitter": area(20)},
    ],
    "area_and_constant": lambda: [EMITTERS["rectangle"](), EMITTERS["constant"]()],
    "area_and_envmap": lambda: [EMITTERS["sphere"](), EMITTERS["envmap"]()],
    "area_and_point": lambda: [EMITTERS["disk"](), EMITTERS["point"]()],
    # A spot that lights a corner only, and misses the middle of the scene
    "area_and_aside_spot": lambda: [
        EMITTERS["rectangle"](),
        {
            "type": "spot",
            "to_world": T().look_at(origin=[-1, 1.5, 0], target=[-1.2, 0, 0], up=[0, 0, 1]),
            "cutoff_angle": 15,
            "intensity": rgb(30, 30, 30),
        },
    ],
    # A point light where the scene's bounding box has its middle
    "area_and_central_point": lambda: [
        {"type": "disk", "to_world": over(0.4, 0.5), "emitter": area()},
        {"type": "point", "position": [0, 1, 0], "intensity": rgb(3, 3, 3)},
    ],
    "all": lambda: [EMITTERS[k]() for k in ("rectangle", "disk", "sphere", "cube_mesh", "point", "spot", "directional")]
    + [EMITTERS["constant"]()],
}

BSDFS = {
    "twosided": lambda: {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(0.6, 0.5, 0.4)}},
    "black": lambda: {"type": "diffuse", "reflectance": rgb(0, 0, 0)},
    "bitmap": lambda: {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": bitmap(low=0.1)}},
    "checkerboard": lambda: {"type": "diffuse", "reflectance": {"type": "checkerboard", "to_uv": T().scale([6, 6, 1])}},
    "roughconductor": lambda: {"type": "roughconductor", "alpha": 0.15, "material": "Cu"},
    "roughconductor_sharp": lambda: {"type": "roughconductor", "alpha": 0.02, "material": "none"},
    "conductor": lambda: {"type": "conductor", "material": "none"},
    "dielectric": lambda: {"type": "dielectric"},
    "roughdielectric": lambda: {"type": "roughdielectric", "alpha": 0.2},
    "plastic": lambda: {"type": "plastic", "diffuse_reflectance": rgb(0.5, 0.2, 0.2)},
    "roughplastic": lambda: {"type": "roughplastic", "alpha": 0.1},
    "principled": lambda: {"type": "principled", "base_color": rgb(0.7, 0.3, 0.2), "roughness": 0.3, "metallic": 0.4},
    "normalmap": lambda: {
        "type": "normalmap",
        "normalmap": {"type": "bitmap", "raw": True, "bitmap": bitmap((16, 16), 1, 0.5)},
        "bsdf": {"type": "diffuse"},
    },
    "bumpmap": lambda: {
        "type": "bumpmap",
        "arbitrary": {"type": "bitmap", "raw": True, "bitmap": bitmap((16, 16), 1, 0.5)},
        "bsdf": {"type": "diffuse"},
        "scale": 0.4,
    },
    "mask": lambda: {"type": "mask", "opacity": 0.6, "bsdf": {"type": "diffuse"}},
    "blend": lambda: {
        "type": "blendbsdf",
        "weight": 0.5,
        "a": {"type": "diffuse"},
        "b": {"type": "roughconductor", "alpha": 0.2},
    },
}

QUICK_EMITTERS = ("rectangle", "sphere", "spot", "rectangle_textured", "directionalarea")
QUICK_MIXED = ("two_rectangles", "area_and_aside_spot", "area_and_central_point")
QUICK_BSDFS = ("roughconductor", "checkerboard", "plastic")


def slowly(names, quick):
    return [n if n in quick else pytest.param(n, marks=pytest.mark.slow) for n in names]


@pytest.mark.parametrize("name", slowly(EMITTERS, QUICK_EMITTERS))
def test_every_emitter(kit, name):
    # Under a constant sky Mitsuba's two strategies differ by 0.4 %: the reference samples the emitter, as we do
    strategy = {"emitter_samples": 1, "bsdf_samples": 0} if name == "constant" else {}
    kit.compare(kit.room({"light": EMITTERS[name]()}), {"type": "direct", **strategy})


@pytest.mark.parametrize("name", slowly(MIXED, QUICK_MIXED))
def test_mixed_emitters(kit, name):
    lights = MIXED[name]()
    kit.compare(kit.room({f"light{i}": light for i, light in enumerate(lights)}))


@pytest.mark.parametrize("name", slowly(BSDFS, QUICK_BSDFS))
def test_every_bsdf(kit, name):
    kit.compare(kit.room(bsdf=BSDFS[name]()))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["roughconductor", "principled", "roughdielectric"])
def test_glossy_under_many_lights(kit, name):
    lights = {f"light{i}": light for i, light in enumerate(MIXED["all"]())}
    kit.compare(kit.room(lights, bsdf=BSDFS[name]()))
