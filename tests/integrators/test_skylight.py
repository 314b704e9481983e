"""Skies sampled with regard for the surface."""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.skylight import NORMALS, Sky, octahedron

UP = (0.0, 1.0, 0.0)


def bitmap(radiance):
    return {"type": "envmap", "bitmap": mi.Bitmap(np.repeat(np.asarray(radiance, np.float32)[..., None], 3, axis=2))}


def noise():
    return mi.Bitmap(np.random.default_rng(2).random((16, 16, 1), np.float32))


def sunny():
    """Return an envmap with a small sun high up, a bright window at the side and a dim ground."""
    map_ = np.full((32, 64), 0.3)
    map_[16:] = 0.1
    map_[6, 20] = 150.0
    map_[12:16, 40:44] = 4.0
    return bitmap(map_)


SKIES = {"even": lambda: {"type": "constant", "radiance": 0.7}, "sunny": sunny}


def sky_of(light):
    scene = mi.load_dict({"type": "scene", "light": light, "shape": {"type": "sphere"}})
    return scene, Sky(0, scene.emitters()[0])


def midpoints(side):
    i = dr.arange(mi.UInt32, side * side)
    return (mi.Point2f(mi.Float(i % side), mi.Float(i // side)) + 0.5) / side


def uniform_directions(side):
    return mi.warp.square_to_uniform_sphere(midpoints(side))


@pytest.mark.parametrize("light", ["constant", "noisy", "overcast", "sunny", "black"])
def test_which_skies_are_even(variant_llvm, light):
    rng = np.random.default_rng(1)
    overcast = np.where(np.arange(32) < 16, (1 + 2 * np.cos((np.arange(32) + 0.5) / 32 * np.pi)) / 3, 0.1)
    skies = {
        "constant": SKIES["even"](),
        "noisy": bitmap(rng.uniform(0.05, 0.3, (16, 32))),
        "overcast": bitmap(np.repeat(overcast[:, None], 64, axis=1)),
        "sunny": sunny(),
        "black": bitmap(np.zeros((4, 8))),
    }
    _, sky = sky_of(skies[light])
    assert sky.even is (light != "sunny")


@pytest.mark.parametrize("transmits", [False, True])
def test_warped_points_have_the_density_they_are_said_to_have(variant_llvm, transmits):
    """Means of functions over density are their integrals over the unit square, for normals all around."""
    _, sky = sky_of(sunny())
    u = midpoints(256)
    for n in octahedron(NORMALS)[::7]:
        warped = sky.warp(mi.Vector3f(*map(float, n)), mi.Bool(transmits), u, mi.Bool(True))
        v, density = (np.array(x, np.float64) for x in warped)
        assert v.min() >= 0 and v.max() < 1 and density.min() > 0.1
        for f, integral in ((1 + 0 * v[0], 1), (v[0], 1 / 2), (v[0] * v[1] ** 2, 1 / 6), (np.cos(9 * v[1]), np.sin(9) / 9)):
            assert np.mean(f / density) == pytest.approx(integral, abs=1e-3)


def test_tables_of_normals_are_where_they_are_looked_up(variant_llvm):
    _, sky = sky_of(sunny())
    n = octahedron(NORMALS)
    for transmits in (False, True):
        table = np.array(sky.table(mi.Vector3f(np.ascontiguousarray(n.T)), mi.Bool(transmits)))
        np.testing.assert_array_equal(table, np.arange(NORMALS**2) + (NORMALS**2 if transmits else 0))


@pytest.mark.parametrize("n", [UP, (0.6, 0.0, 0.8), (-0.36, -0.48, 0.8)])
def test_few_samples_lie_below_the_horizon(variant_llvm, n):
    """Where the sun is on the wrong side, or the brighter half of the sky, most of Mitsuba's do."""
    scene, sky = sky_of(sunny())
    u, normal = midpoints(128), mi.Vector3f(*n)
    it = dr.zeros(mi.Interaction3f, 128**2)

    def below(points):
        return np.mean(np.array(dr.dot(scene.emitters()[0].sample_direction(it, points, True)[0].d, normal)) < 0)

    warped, _ = sky.warp(normal, mi.Bool(False), u, mi.Bool(True))
    assert below(warped) < min(0.25, 0.75 * below(u))


@pytest.mark.parametrize("slant", [0.0, 0.1])
@pytest.mark.parametrize("transmits", [False, True])
def test_samples_about_a_normal_have_their_density(variant_llvm, transmits, slant):
    """A density that integrates to one; samples whose means over it are integrals over the hemisphere, or the sphere."""
    _, sky = sky_of(SKIES["even"]())
    n, both = mi.Normal3f(0.48, -0.6, 0.64), mi.Bool(transmits)
    d = uniform_directions(512)
    p = np.array(sky.density(n, both, slant, d, mi.Float(0)), np.float64)
    assert p.mean() * 4 * np.pi == pytest.approx(1, abs=2e-3)
    ds, weight = sky.around(dr.zeros(mi.SurfaceInteraction3f, 256**2), n, both, slant, midpoints(256), mi.Bool(True))
    z, w = np.array(dr.dot(ds.d, n), np.float64), np.array(weight, np.float64)[0]
    assert np.mean(w * abs(z)) == pytest.approx(0.7 * np.pi * (2 if transmits else 1), rel=1e-3)
    assert np.mean(w * z) == pytest.approx(0 if transmits else 0.7 * np.pi, abs=5e-3)
    assert np.mean(w * z**2) == pytest.approx(0.7 * 2 / 3 * np.pi * (2 if transmits else 1), rel=1e-3)
    np.testing.assert_allclose(np.array(ds.pdf), sky.density(n, both, slant, ds.d, mi.Float(0)), rtol=1e-5)


def test_an_open_floor_under_an_even_sky_has_no_noise(kit):
    """Radiance times albedo, whatever the seed."""
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(50)}
    matt = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.4, 0.3]}}
    camera = kit.sensor(origin=(0, 3, 1))
    scene = mi.load_dict({"type": "scene", "sky": SKIES["even"](), "floor": {**floor, "bsdf": matt}, "sensor": camera})
    image = np.array(mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=8))
    np.testing.assert_allclose(image, np.broadcast_to([0.35, 0.28, 0.21], image.shape), rtol=1e-5)


SURFACES = {
    "matt": lambda: {"type": "diffuse"},
    "roughplastic": lambda: {"type": "roughplastic", "alpha": 0.15},
    "roughdielectric": lambda: {"type": "roughdielectric", "alpha": 0.3},
    "mask": lambda: {"type": "mask", "opacity": 0.6, "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}}},
    "bumpmap": lambda: {
        "type": "bumpmap",
        "arbitrary": {"type": "bitmap", "raw": True, "bitmap": noise()},
        "bsdf": {"type": "diffuse"},
        "scale": 0.4,
    },
}
QUICK = (("sunny", "roughplastic"), ("sunny", "matt"), ("even", "bumpmap"))


@pytest.mark.parametrize(
    ("sky", "surface"),
    [
        pytest.param(sky, surface, marks=() if (sky, surface) in QUICK else pytest.mark.slow)
        for sky in SKIES
        for surface in SURFACES
    ],
)
def test_surfaces_under_skies(kit, sky, surface):
    kit.compare(kit.room({"sky": SKIES[sky]()}, bsdf=SURFACES[surface]()))


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
def test_skies_beside_lamps_and_along_paths(kit, sky):
    lights = {"sky": SKIES[sky](), "lamp": kit.lamp()}
    kit.compare(kit.room(lights, bsdf=SURFACES["roughplastic"]()), ours="vispath", reference="path", both={"max_depth": 4})


@pytest.mark.parametrize("sky", SKIES)
def test_skies_in_a_crowd(kit, sky):
    """Less error than `direct` at equal samples, though it has the BSDF samples of all its hits beside."""
    T, rng, posts = mi.ScalarTransform4f, np.random.default_rng(3), {}
    for k in range(40):
        x, z = rng.uniform(-1.5, 1.5, 2)
        posts[f"post{k}"] = {"type": "cube", "to_world": T().translate([x, 0.3, z]).scale([0.06, 0.5, 0.06])}
    scene = kit.room({"sky": SKIES[sky]()}, blocker=False, **posts)
    assert kit.error_ratio(scene, 1024, seeds=4) < 0.85
