"""Scenes at the edge of what is sensible: a finite picture within error of the reference, or one clear sentence."""

import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError, mitsuba_errors


def T():
    return mi.ScalarTransform4f()


def render(scene, spp=4, seed=0, **settings):
    loaded = mi.load_dict(scene)
    integrator = mi.load_dict({"type": "visdirect", **settings})
    image = np.array(mi.render(loaded, integrator=integrator, spp=spp, seed=seed))
    # An unbiased correction of a guess may leave a pixel a little below zero; more than a trace would be a bug
    colour = image[..., :3]
    assert np.isfinite(image).all() and colour.min() >= -0.01 * colour.max()
    return image, integrator


def moved(kit, scale=1.0, shift=0.0, radiance=8.0):
    """The room, scaled and moved; the lamp sees the camera's way."""
    m = T().translate([shift, 0, 0]) @ T().scale(scale)
    scene = kit.room(camera=kit.sensor())
    for value in scene.values():
        if isinstance(value, dict) and "to_world" in value and value["type"] != "perspective":
            value["to_world"] = m @ value["to_world"]
    scene["lamp"]["emitter"]["radiance"]["value"] = [radiance, radiance, radiance]
    eye, look = m @ mi.ScalarPoint3f(0, 1.2, 4), m @ mi.ScalarPoint3f(0, 0.5, 0)
    scene["sensor"]["to_world"] = T().look_at(origin=eye, target=look, up=[0, 1, 0])
    scene["sensor"]["near_clip"], scene["sensor"]["far_clip"] = 1e-2 * scale, 1e4 * scale
    return scene


QUICK_SCALES = (1e-4, 1e6)


@pytest.mark.parametrize(
    "scale", [s if s in QUICK_SCALES else pytest.param(s, marks=pytest.mark.slow) for s in (1e-4, 1e-2, 1e3, 1e6)]
)
def test_scaled_scenes(kit, scale):
    kit.compare(moved(kit, scale))


@pytest.mark.parametrize("shift", [pytest.param(1e3, marks=pytest.mark.slow), 1e5])
def test_moved_scenes(kit, shift):
    emitters_only = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    kit.compare(moved(kit, shift=shift), emitters_only)


@pytest.mark.parametrize("radiance", [1e-8, pytest.param(1e-3, marks=pytest.mark.slow), 1e8])
def test_dim_and_bright_lights(kit, radiance):
    kit.compare(moved(kit, radiance=radiance))


@pytest.mark.parametrize("mode", ["unbiased", "consistent"])
def test_light_whose_square_float32_does_not_hold(kit, mode):
    bright, _ = render(moved(kit, radiance=1e30), spp=16, mode=mode)
    plain, _ = render(moved(kit, radiance=1.0), spp=16, mode=mode)
    assert bright.mean() == pytest.approx(1e30 * plain.mean(), rel=0.01)


def on_floor(kind):
    return {
        "touching": T().translate([0.8, 0.4, 0]) @ T().scale(0.4),
        "edge_on": T().translate([0, 1, 0]) @ T().rotate([0, 1, 0], 90) @ T().scale(0.4),
        "facing_away": T().translate([0, 2, 0]) @ T().rotate([1, 0, 0], -90) @ T().scale(0.4),
        "buried": T().translate([0.5, 0, 0]) @ T().scale(0.4),
    }[kind]


@pytest.mark.parametrize("kind", ["touching", "edge_on", "facing_away", "buried"])
def test_awkward_lights(kit, kind):
    kit.compare(kit.room({"lamp": kit.lamp(to_world=on_floor(kind))}), spp=32)


def test_a_light_does_not_light_itself(kit):
    """The camera looks at points that lie on a tilted lamp."""
    tilt = T().translate([7.3, 5.1, -2.7]) @ T().rotate([0.3, 1, 0.2], 33)
    scene = kit.room({"lamp": kit.lamp(to_world=tilt)}, blocker=False)
    back = tilt @ mi.ScalarPoint3f(0.2, 0.1, 3)
    middle = tilt @ mi.ScalarPoint3f(0, 0, 0)
    scene["sensor"] = kit.sensor(origin=back, target=middle, fov=15, size=16)
    image, _ = render(scene)
    np.testing.assert_allclose(image, np.broadcast_to([8, 6.4, 4.8], image.shape), rtol=1e-4)


def test_lights_without_area(kit):
    lamp = kit.lamp(to_world=T().translate([0, 2, 0]) @ T().scale([1e-30, 1e-30, 1]))
    try:
        image, _ = render(kit.room({"lamp": lamp}))
    except (InputError, RuntimeError) as error:
        assert str(error)
    else:
        assert image.max() < 1e-3


def ply(vertices, faces):
    mesh = mi.Mesh("blocker", len(vertices), len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(np.asarray(vertices, np.float32))
    parameters["faces"] = np.ravel(np.asarray(faces, np.uint32))
    parameters.update()
    return mesh


def leaves(count, seed=0):
    r = np.random.default_rng(seed)
    centre = r.uniform([-1, 0.3, -1], [1, 1.3, 1], (count, 3))
    corners = centre[:, None] + r.normal(0, 0.6 / np.sqrt(count), (count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


@pytest.mark.parametrize("count", [1, 100_000])
def test_blockers_of_few_and_many_triangles(kit, count):
    kit.compare(kit.room(blocker=False, mesh=ply(*leaves(count))))


def test_triangles_of_no_area_and_of_no_place(kit):
    vertices, faces = leaves(200)
    vertices[0:30] = vertices[0]
    vertices[30:33] = np.nan
    kit.compare(kit.room(blocker=False, mesh=ply(vertices, faces)))


def test_no_light(kit):
    image, integrator = render(kit.room({}))
    assert (image == 0).all() and integrator.report.rays["refinement"] == 0


def test_no_geometry(kit):
    image, _ = render({"type": "scene", "sensor": kit.sensor()})
    assert (image == 0).all()


def test_only_an_environment(kit):
    image, _ = render({"type": "scene", "sensor": kit.sensor(), "sky": {"type": "constant", "radiance": 0.5}})
    np.testing.assert_allclose(image, 0.5, rtol=1e-5)


def test_a_point_light_on_the_floor(kit):
    image, _ = render(kit.room({"lamp": {"type": "point", "position": [0, 0, 0]}}))
    assert image.shape == (32, 32, 3)


def test_one_pixel(kit):
    scene = kit.room(camera=kit.sensor(size=1, fov=3))
    kit.compare(scene, spp=16, seeds=64, reference_spp=4096)


def test_a_camera_inside_an_object(kit):
    kit.compare(kit.room(camera=kit.sensor(origin=(0, 0.5, 0.2), target=(1, 0.6, 0.2))))


@pytest.mark.parametrize("spp", [1, 2, 3, 4])
def test_few_samples(kit, spp):
    integrator = kit.compare(kit.room(), spp=spp, seeds=48, aovs=False)
    rays = integrator.report.rays
    assert rays["camera"] >= 32 * 32
    assert sum(rays.values()) <= 1.1 * 2 * spp * 32 * 32


def test_budget_is_kept_at_64_spp(kit):
    _, integrator = render(kit.room(), spp=64, max_rays=100_000)
    assert sum(integrator.report.rays.values()) <= 1.1 * 2 * 64 * 32 * 32


def test_most_rays_a_pixel(kit):
    image, _ = render(kit.room(), spp=256, max_rays=20, aovs=True)
    assert image[..., 5].max() <= 20


def test_a_threshold_saves_rays(kit):
    _, all_rays = render(kit.room(), spp=64)
    _, fewer = render(kit.room(), spp=64, threshold=0.05)
    assert sum(fewer.report.rays.values()) < 0.7 * sum(all_rays.report.rays.values())


@pytest.mark.parametrize(
    "settings, word",
    [
        ({"mode": "wrong"}, "mode"),
        ({"classifier": "oracle"}, "classifier"),
        ({"light_grid": 9}, "light_grid"),
        ({"threshold": -1.0}, "threshold"),
        ({"max_rays": 0}, "max_rays"),
        ({"threshold": float("inf")}, "threshold"),
        ({"max_depth": 3}, "'max_depth' .* vispath"),
        ({"rr_depth": 3}, "'rr_depth' .* vispath"),
        ({"no_such_parameter": 1}, "no_such_parameter"),
    ],
)
def test_wrong_parameters_are_named(variant_llvm, settings, word):
    with pytest.raises((InputError, RuntimeError), match=word):
        mi.load_dict({"type": "visdirect", **settings})


@pytest.mark.parametrize("depth", [0, 1, -2, 2**31, 2**33])
def test_wrong_depths_are_named(variant_llvm, depth):
    with pytest.raises((InputError, RuntimeError), match="'max_depth' must be"):
        mi.load_dict({"type": "vispath", "max_depth": depth})


def test_inside_another_integrator(kit):
    nested = mi.load_dict({"type": "aov", "aovs": "d:depth", "image": {"type": "visdirect"}})
    with pytest.raises(InputError, match="cannot be inside another"), mitsuba_errors():
        mi.render(mi.load_dict(kit.room()), integrator=nested, spp=4)


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral_polarized"])
@pytest.mark.parametrize("name", ["visdirect", "vispath"])
def test_other_variants_are_refused(variant_llvm, variant, name):
    if variant not in mi.variants():
        variant = next(v for v in mi.variants() if v.startswith("scalar"))
    try:
        mi.set_variant(variant)
        with pytest.raises((InputError, RuntimeError), match="set_variant"):
            mi.load_dict({"type": name})
    finally:
        mi.set_variant("llvm_ad_rgb")
