"""What scenes seldom hold, and what must then be neither lost nor left out: odd lights, sensors, films, parameters."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError
from intervis.integrators.collect import collect
from intervis.scenes import load


def T():
    return mi.ScalarTransform4f()


def power(scene):
    """Brightness of each light, by which rays are shared out before anything is seen."""
    return np.array(collect(scene).table).reshape(-1, 12)[:, 8]


def panel(radiance, x):
    """A square lamp, 1 wide, 2 above the floor."""
    at = T().translate([x, 2, 0]) @ T().rotate([1, 0, 0], 90) @ T().scale(0.5)
    return {"type": "rectangle", "to_world": at, "emitter": {"type": "area", "radiance": radiance}}


def texel():
    """A picture, black but for one bright texel that no coarse grid hits."""
    pixels = np.zeros((64, 64, 3), np.float32)
    pixels[33, 33] = 20_000
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}


def test_a_lamp_that_shines_from_one_texel(kit):
    lights = {"a": panel(texel(), -0.7), "b": panel({"type": "rgb", "value": 2.0}, 0.7)}
    kit.compare(kit.room(lights, camera=kit.sensor(target=(0, 0, 1))), spp=64, reference_spp=512)


def test_a_lamp_that_shines_at_one_wavelength():
    before = mi.variant()
    mi.set_variant("llvm_ad_spectral")
    try:
        line = {"type": "irregular", "wavelengths": "360,449,450,451,830", "values": "0,0,800,0,0"}
        scene = mi.load_dict({"type": "scene", "a": panel(line, -0.7), "b": panel({"type": "d65"}, 0.7)})
        dim, white = sorted(power(scene))
    finally:
        mi.set_variant(before or "llvm_ad_rgb")
    # The line's area over that of the D65 lamp's spectrum, as the eye weighs them: y(450 nm) = 0.038
    assert dim / white == pytest.approx(800 * 0.038 / 106.857 / 0.989, rel=0.1)


def test_a_low_sun_over_a_high_box(kit):
    """Its rays come from above the box's top, though a place in their direction may lie below it."""
    sun = {"type": "directional", "direction": [1, -0.05, 0.1], "irradiance": {"type": "rgb", "value": 9.0}}
    lamp = kit.lamp(to_world=T().translate([0, 0.5, 1]) @ T().rotate([1, 0, 0], 90) @ T().scale(0.1))
    box = {"type": "cube", "to_world": T().translate([0.5, 1.9, 0]) @ T().scale([0.3, 0.1, 0.3])}
    camera = kit.sensor(origin=(0, 3.2, 4), target=(0, 1, 0))
    scene = kit.room({"sun": sun, "lamp": lamp}, camera=camera, box=box)
    kit.compare(scene, spp=64)
    loaded = mi.load_dict(scene)
    far = [mi.has_flag(e.flags(), mi.EmitterFlags.Infinite) for e in loaded.emitters()]
    np.testing.assert_allclose(power(loaded)[far], 9, rtol=1e-3)


def test_a_narrow_beam_leaves_rays_to_others(kit):
    beam = {"type": "spot", "to_world": T().look_at([1, 3, 0], [1.2, 0, 0.5], [0, 0, 1]), "cutoff_angle": 4.0}
    beam["intensity"] = {"type": "rgb", "value": 300.0}
    lights = {"beam": beam, "lamp": kit.lamp()}
    kit.compare(kit.room(lights), spp=64)
    lamp, beam = sorted(power(mi.load_dict(kit.room(lights))))
    # 300 W/sr in the inner 9/16 of its cone, from there linearly down, with a mean square of 9/16 + 13/96
    assert beam == pytest.approx(300 * np.sqrt(9 / 16 + 13 / 96), rel=0.05)


def test_hair(kit):
    image = mi.render(mi.load_dict(kit.room(bsdf={"type": "hair"})), integrator=mi.load_dict({"type": "visdirect"}), spp=2)
    assert np.isfinite(np.array(image)).all()


@pytest.mark.parametrize("kind", ["irradiancemeter", "radiancemeter", "perspective"])
def test_one_pixel_spends_its_budget(kit, kind):
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    scene = kit.room()
    place = T().look_at(origin=[0.9, 1.2, 1.5], target=[0.2, 0, 0.2], up=[0, 1, 0])
    if kind == "irradiancemeter":
        del scene["sensor"]
        scene["plate"] = {"type": "rectangle", "to_world": place @ T().scale(0.1), "sensor": {"type": kind, "film": film}}
    else:
        scene["sensor"] = {"type": kind, "to_world": place, "film": film}
    integrator = kit.compare(scene, spp=256, reference_spp=4096)
    rays = sum(integrator.report.rays.values()) + integrator.report.skipped["no contribution"]
    assert 0.5 * 2 * 256 < rays < 2 * 2 * 256


@pytest.mark.parametrize("name", ["gaussian", "tent"])
def test_consistent_under_a_wide_filter(kit, name):
    """Neighbours' shadow ratios are shared whatever the filter; less is left to gain where it already averages them."""
    written = load("penumbra", width=160, height=90)
    written["sensor"]["film"]["rfilter"] = {"type": name}
    scene = mi.load_dict(written)
    truth = np.array(mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=1024))

    def error(mode):
        plugin = mi.load_dict({"type": "visdirect", "mode": mode})
        images = [np.array(mi.render(scene, integrator=plugin, spp=8, seed=s)) for s in range(3)]
        return np.mean([(x - truth) ** 2 / (truth**2 + 0.01) for x in images])

    assert error("consistent") < 0.75 * error("unbiased")


@pytest.mark.parametrize("name", ["blocker.to_world", "sensor.to_world"])
def test_gradients_of_what_moves_are_refused(kit, name):
    scene = mi.load_dict(kit.room(blocker=False, blob={"type": "sphere", "center": [0, 0.5, 0], "radius": 0.3}))
    name = name.replace("blocker", "blob")
    params = mi.traverse(scene)
    shift = mi.Float(0)
    dr.enable_grad(shift)
    params[name] = mi.Transform4f().translate(mi.Vector3f(shift, 0, 0)) @ mi.Transform4f(params[name].matrix)
    params.update()
    with pytest.raises((InputError, RuntimeError)) as caught:
        mi.render(scene, params, integrator=mi.load_dict({"type": "visdirect"}), spp=4)
    assert "moves edges" in str(caught.value.__cause__ or caught.value)


@pytest.mark.parametrize(
    "settings",
    [
        {"light_grid": 2.5},
        {"light_grid": "4"},
        {"threshold": "low"},
        {"max_rays": 1.5},
        {"max_rays": 2**40},
        {"aovs": "yes"},
        {"refine": "no"},
    ],
)
def test_values_of_the_wrong_kind(variant_llvm, settings):
    with pytest.raises((InputError, RuntimeError), match=f"'{next(iter(settings))}' must be"):
        mi.load_dict({"type": "visdirect", **settings})


def test_sample_counts_beyond_what_is_countable(kit):
    with pytest.raises(InputError, match="'spp' must be"):
        mi.load_dict({"type": "visdirect"}).render(mi.load_dict(kit.room()), spp=2**33)


def test_paths_under_a_black_environment(kit):
    """A map of noughts has no density to sample by: it adds nothing, and takes nothing from the lamp's light."""
    black = {"type": "envmap", "bitmap": mi.Bitmap(np.zeros((4, 8, 3), np.float32))}
    # Under the lamp a ball that sees much of the sky and of the floor
    ball = {"type": "sphere", "center": [0.7, 0.9, 0.5], "radius": 0.35}
    scene = kit.room({"lamp": kit.lamp(), "sky": black}, ball=ball)
    kit.compare(scene, "path", "vispath", both={"max_depth": 4}, spp=64, reference_spp=256)


def test_outlines_of_small_bright_lamps_do_not_stand_out(kit):
    """A lamp a pixel high, which all looks nearby may miss, does not end up in pixels of few hits."""
    thin = {
        "type": "rectangle",
        "to_world": T().translate([-0.8, 1.6, 0.5]) @ T().rotate([1, 0, 0], 90) @ T().scale(0.2),
        "emitter": {"type": "area", "radiance": 20.0},
    }
    scene = kit.room({"lamp": kit.lamp(), "thin": thin}, camera=kit.sensor(size=40))
    assert kit.error_ratio(scene, 2048, seeds=32) < 0.5
