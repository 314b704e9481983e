"""Everything a Mitsuba scene may contain, against Mitsuba's own `direct`."""

import re

import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError
from intervis.integrators.brightness import bounds
from intervis.integrators.shading import prepare


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
        "to_world": over() @ mi.ScalarTransform4f([[1, 0.6, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
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
    # Where lamps coincide, rays meet one of them, samples of lights all: what comes out depends on the weights of the two
    "all": lambda: [EMITTERS[k]() for k in ("rectangle", "sphere", "cube_mesh", "point", "spot", "directional", "constant")]
    + [{"type": "disk", "to_world": over(0.4, -0.9), "emitter": area()}],
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
    "principled_twosided": lambda: {"type": "twosided", "bsdf": BSDFS["principled"]()},
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
QUICK_BSDFS = ("roughconductor", "checkerboard", "plastic", "principled_twosided")


def slowly(names, quick):
    return [n if n in quick else pytest.param(n, marks=pytest.mark.slow) for n in names]


@pytest.mark.parametrize("name", slowly(EMITTERS, QUICK_EMITTERS))
def test_every_emitter(kit, name):
    kit.compare(kit.room({"light": EMITTERS[name]()}))


@pytest.mark.parametrize("integrator", ["visdirect", "vispath"])
@pytest.mark.parametrize("light", ["constant", "directional"])
def test_no_light_through_merged_rectangles(variant_llvm, light, integrator):
    """A lid as large as the floor, close above it: light reaches the middle from nowhere, whatever Mitsuba merges."""
    grey = {"type": "diffuse"}
    floor = {"type": "rectangle", "to_world": T().scale(50), "bsdf": grey}
    lid = {"type": "rectangle", "to_world": T().translate([0, 0, 0.5]) @ T().rotate([1, 0, 0], 180) @ T().scale(50)}
    camera = {
        "type": "perspective",
        "to_world": T().look_at([0, 0, 0.3], [0.1, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
    }
    above = {"type": light, "direction": [0, 0.3, -1]} if light == "directional" else {"type": light}
    cube = {"type": "cube", "to_world": T().translate([0, 0, 0.4]) @ T().scale(0.01), "bsdf": grey}
    written = {"type": "scene", "floor": floor, "lid": {**lid, "bsdf": grey}, "cube": cube, "light": above, "eye": camera}
    scene = mi.load_dict(written)
    assert len(scene.shapes()) == 1, "Mitsuba no longer merges these: the test tests nothing"
    settings = {"max_depth": 2} if integrator == "vispath" else {}
    image = np.array(mi.render(scene, integrator=mi.load_dict({"type": integrator, **settings}), spp=64))
    # Between the plates the sky covers less than (0.5 / 50)² of what a floor in the open sees
    assert image.max() < 1e-3
    lower, upper = bounds(scene)
    np.testing.assert_allclose(lower, [-50, -50, 0], atol=1e-5)
    np.testing.assert_allclose(upper, [50, 50, 0.5], atol=1e-5)


@pytest.mark.parametrize("name", slowly(MIXED, QUICK_MIXED))
def test_mixed_emitters(kit, name):
    lights = MIXED[name]()
    kit.compare(kit.room({f"light{i}": light for i, light in enumerate(lights)}))


@pytest.mark.parametrize("name", slowly(BSDFS, QUICK_BSDFS))
def test_every_bsdf(kit, name):
    kit.compare(kit.room(bsdf=BSDFS[name]()))


@pytest.mark.parametrize("name", [n for n in BSDFS if not re.search("dielectric|twosided|mask", n)])
def test_only_matt_surfaces_are_taken_for_matt(kit, name):
    """Whatever plugins call themselves: on one side or on both."""
    matt = name in ("black", "bitmap", "checkerboard")
    for bsdf in (BSDFS[name](), {"type": "twosided", "bsdf": BSDFS[name]()}):
        assert prepare(mi.load_dict(kit.room(bsdf=bsdf))).lambert is matt


@pytest.mark.slow
@pytest.mark.parametrize("name", ["roughconductor", "principled", "roughdielectric"])
def test_glossy_under_many_lights(kit, name):
    lights = {f"light{i}": light for i, light in enumerate(MIXED["all"]())}
    kit.compare(kit.room(lights, bsdf=BSDFS[name]()))


def film(**more):
    return lambda kit: kit.room(camera=kit.sensor(film=more))


def instances(kit):
    leaf = {"type": "rectangle", "to_world": T().scale(0.2), "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}}}
    scene = kit.room(blocker=False, group={"type": "shapegroup", "leaf": leaf})
    for i in range(4):
        place = T().translate([0.4 * i - 0.6, 0.6, 0]) @ T().rotate([1, 1, 0], 40 * i + 70)
        scene[f"copy{i}"] = {"type": "instance", "to_world": place, "group": {"type": "ref", "id": "group"}}
    return scene


def lens(kit):
    camera = kit.sensor(aperture_radius=0.2, focus_distance=3.5)
    camera["type"] = "thinlens"
    return kit.room(camera=camera)


VIEWS = {
    "thinlens": lens,
    "orthographic": lambda kit: kit.room(
        camera={
            **{k: v for k, v in kit.sensor().items() if k != "fov"},
            "type": "orthographic",
            "to_world": T().look_at([0, 1.2, 4], [0, 0.5, 0], [0, 1, 0]) @ T().scale([2, 2, 1]),
        }
    ),
    "instances": instances,
    "crop": film(width=64, height=64, crop_offset_x=13, crop_offset_y=20, crop_width=32, crop_height=24),
    "tent": film(rfilter={"type": "tent"}),
    "gaussian": film(rfilter={"type": "gaussian"}),
    "mitchell": film(rfilter={"type": "mitchell"}),
    "gaussian_border": film(rfilter={"type": "gaussian"}, sample_border=True),
    "gaussian_crop_border": film(
        rfilter={"type": "gaussian"},
        sample_border=True,
        width=64,
        height=64,
        crop_offset_x=13,
        crop_offset_y=20,
        crop_width=32,
        crop_height=24,
    ),
    "alpha": film(pixel_format="rgba"),
    "alpha_gaussian": film(pixel_format="rgba", rfilter={"type": "gaussian"}),
    "luminance": film(pixel_format="luminance"),
}
QUICK_VIEWS = ("thinlens", "instances", "gaussian_crop_border", "alpha")


@pytest.mark.parametrize("name", slowly(VIEWS, QUICK_VIEWS))
def test_films_lenses_and_instances(kit, name):
    kit.compare(VIEWS[name](kit))


@pytest.mark.parametrize("sky", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_hidden_emitters(kit, sky):
    lights = {"lamp": kit.lamp(to_world=T().translate([0, 1, 0]) @ T().scale(0.4))}
    if sky:
        lights["sky"] = EMITTERS["constant"]()
    camera = kit.sensor(film={"pixel_format": "rgba"})
    kit.compare(kit.room(lights, camera=camera), both={"hide_emitters": True})


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral"])
@pytest.mark.parametrize("name", ["rectangle", "sphere", "all"])
def test_other_colours(kit, variant, name):
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not built")
    try:
        mi.set_variant(variant)
        lights = MIXED["all"]() if name == "all" else [EMITTERS[name]()]
        kit.compare(kit.room({f"light{i}": light for i, light in enumerate(lights)}))
    finally:
        mi.set_variant("llvm_ad_rgb")


def test_layers(kit):
    integrator = mi.load_dict({"type": "visdirect", "aovs": True})
    names = ["visibility.class", "visibility.fraction", "rays.shadow", "error.R", "error.G", "error.B"]
    assert integrator.aov_names() == names
    scene = mi.load_dict(kit.room())
    image = np.array(mi.render(scene, integrator=integrator, spp=16))
    assert image.shape == (32, 32, 9)
    label, fraction, rays, error = image[..., 3], image[..., 4], image[..., 5], image[..., 6:]
    assert set(np.unique(label)) <= set(range(7)) and len(np.unique(label)) > 2
    assert fraction.min() >= 0 and fraction.max() <= 1
    assert rays.sum() == integrator.report.rays["pilot"] + integrator.report.rays["refinement"]
    assert (error >= 0).all() and error.max() > 0
    channels = [field.name for field in scene.sensors()[0].film().bitmap().struct_()]
    assert channels == ["R", "G", "B", *names]
    plain = np.array(mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=16))
    np.testing.assert_allclose(plain, image[..., :3], rtol=1e-5, atol=1e-6)
    assert sum(integrator.report.classes.values()) == 32 * 32


def test_layers_survive_a_wide_filter(kit):
    camera = kit.sensor(film={"rfilter": {"type": "gaussian"}, "pixel_format": "rgba"})
    scene = mi.load_dict(kit.room(camera=camera))
    image = np.array(mi.render(scene, integrator=mi.load_dict({"type": "visdirect", "aovs": True}), spp=16))
    assert image.shape == (32, 32, 10)
    assert set(np.unique(np.round(image[..., 4], 3))) <= set(range(7))
    assert image[..., 5].min() >= 0 and image[..., 5].max() <= 1 + 1e-5


def test_a_spectral_film_is_refused(kit):
    """A film with channels of its own is refused in a sentence."""
    try:
        mi.set_variant("llvm_ad_spectral")
        camera = kit.sensor()
        camera["film"] = {
            "type": "specfilm",
            "width": 16,
            "height": 16,
            "band": {"type": "spectrum", "value": [(400, 1.0), (700, 1.0)]},
        }
        scene = mi.load_dict(kit.room(camera=camera))
        with pytest.raises(InputError, match="hdrfilm"):
            mi.load_dict({"type": "visdirect"}).render(scene, spp=4)
    finally:
        mi.set_variant("llvm_ad_rgb")


def test_same_seed_same_picture(kit):
    scene, integrator = mi.load_dict(kit.room()), mi.load_dict({"type": "visdirect"})
    a, b, c = (np.array(mi.render(scene, integrator=integrator, spp=8, seed=s)) for s in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert (a != c).any()


@pytest.mark.slow
@pytest.mark.parametrize("depth", [2, 3, 5])
def test_paths(kit, depth):
    kit.compare(kit.room(), "path", "vispath", both={"max_depth": depth}, seeds=24)
