"""Small lamps in view: light samples tell where they are, and how bright they make a pixel, where looks miss them."""

import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.camera import Frame
from intervis.integrators.in_view import in_view, samples_of
from intervis.integrators.shading import prepare

SIDE, FOV, AWAY = 16, 60.0, 4.0
RADIANCE = 30.0


def T():
    return mi.ScalarTransform4f()


def pinhole(kind="perspective", film=None, **more):
    """A camera that looks along -z from the origin; film x runs to the right, film y downwards."""
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, **(film or {})}
    return {
        "type": kind,
        "fov": FOV,
        "to_world": T().look_at([0, 0, 0], [0, 0, -1], [0, 1, 0]),
        "film": film,
        **more,
    }


def lamp(column, row, width):
    """A square lamp that faces the camera in the middle of a pixel, as wide as a share of that."""
    pixel = 2 * AWAY * np.tan(np.radians(FOV / 2)) / SIDE
    at = [(column + 0.5 - SIDE / 2) * pixel, (SIDE / 2 - row - 0.5) * pixel, -AWAY]
    shape = {"type": "rectangle", "to_world": T().translate(at) @ T().scale(float(width * pixel / 2))}
    return {**shape, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": RADIANCE}}}


def told(camera, samples=64, **things):
    """What is told of a scene's lamps: images of the mean, the mean square, and of the rays for it."""
    scene = mi.load_dict({"type": "scene", "sensor": camera, **things})
    frame = Frame(scene.sensors()[0])
    found = in_view(prepare(scene), frame, mi.UInt32(3), samples)
    return [np.array(x, dtype=np.float64).reshape(frame.height, frame.width) for x in found]


@pytest.mark.parametrize(
    ("film", "place"),
    [
        ({}, (3, 11)),
        ({"crop_width": 10, "crop_height": 6, "crop_offset_x": 4, "crop_offset_y": 2}, (1, 7)),
        ({"rfilter": {"type": "gaussian"}, "sample_border": True}, (3 + 2, 11 + 2)),
    ],
    ids=["whole", "crop", "border"],
)
def test_a_lamp_within_one_pixel(variant_llvm, film, place):
    mean, square, traced = told(pinhole(film=film), lamp=lamp(11, 3, 0.5))
    assert np.argwhere(mean).tolist() == [list(place)]
    # A quarter of the pixel
    assert mean[place] == pytest.approx(RADIANCE / 4, rel=0.02)
    assert square[place] == pytest.approx(RADIANCE**2 / 4, rel=0.02)
    assert traced[place] == traced.sum() == 64


def test_lamps_add_up(variant_llvm):
    # Two side by side in one pixel, and one elsewhere
    mean, square, _ = told(pinhole(), a=lamp(10.7, 3, 0.2), b=lamp(11.3, 3, 0.2), c=lamp(2, 9, 0.1))
    assert mean[3, 11] == pytest.approx(RADIANCE * 0.08, rel=0.02)
    assert square[3, 11] == pytest.approx(RADIANCE**2 * 0.08, rel=0.02)
    assert mean[9, 2] == pytest.approx(RADIANCE * 0.01, rel=0.02)
    assert np.count_nonzero(mean) == 2


@pytest.mark.parametrize("kind", ["hidden", "behind", "turned"])
def test_what_the_camera_does_not_see_of_a_lamp(variant_llvm, kind):
    one = lamp(11, 3, 0.5)
    card = {"card": {"type": "rectangle", "to_world": T().translate([0, 0, -3]) @ T().scale(3)}} if kind == "hidden" else {}
    if kind == "behind":
        one["to_world"] = T().rotate([0, 1, 0], 180) @ one["to_world"]
    if kind == "turned":
        one["to_world"] = one["to_world"] @ T().rotate([0, 1, 0], 180)
    mean, _, traced = told(pinhole(), lamp=one, **card)
    assert not mean.any()
    assert traced.sum() == (64 if kind == "hidden" else 0)


def test_out_of_focus(variant_llvm):
    """A point 4 away, seen by a lens focused 2 away, is spread over a disk of twice the lens' radius, at that distance."""
    lens = pinhole("thinlens", aperture_radius=0.6, focus_distance=2.0)
    mean, square, traced = told(lens, samples=256, lamp=lamp(8, 8, 0.1))
    radius = 0.6 * (AWAY - 2) / 2 / (2 * AWAY * np.tan(np.radians(FOV / 2)) / SIDE)
    y, x = np.indices(mean.shape) + 0.5
    distance = np.hypot(x - 8.5, y - 8.5)
    assert mean.sum() == pytest.approx(RADIANCE * 0.01, rel=0.02)
    assert square.sum() == pytest.approx(RADIANCE**2 * 0.01, rel=0.02)
    assert mean[distance < radius + 0.75].sum() == pytest.approx(mean.sum(), rel=1e-3)
    assert np.count_nonzero(mean > 0.3 * mean.max()) > 0.5 * np.pi * radius**2 > 3
    assert traced[8, 8] == 256


def test_its_rays_are_counted(variant_llvm):
    """A lamp alone, which has nothing to shine on: 2 rays a sample in 16×16 pixels, of which one in 512 goes here."""
    scene = mi.load_dict({"type": "scene", "sensor": pinhole(), "lamp": lamp(11, 3, 0.5)})
    integrator = mi.load_dict({"type": "visdirect"})
    mi.render(scene, integrator=integrator, spp=64)
    assert integrator.report.rays["pilot"] == 64


def test_no_lamps_to_see(variant_llvm):
    sky = {"sky": {"type": "constant"}, "point": {"type": "point", "position": [0, 0, -3]}}
    mean, _, traced = told(pinhole(), **sky)
    assert not mean.any() and not traced.any()


def test_a_small_share_of_the_rays(variant_llvm):
    shading = prepare(mi.load_dict({"type": "scene", "a": lamp(3, 3, 1), "b": lamp(5, 5, 1)}))
    camera = mi.load_dict(pinhole())
    assert samples_of(shading, camera, 512 * 20) == 10
    assert samples_of(shading, camera, 512) == 0
    assert samples_of(shading, camera, 1 << 40) == 256
    plan = {k: v for k, v in pinhole("orthographic").items() if k != "fov"}
    assert samples_of(shading, mi.load_dict(plan), 1 << 40) == 0
    shading.hide = True
    assert samples_of(shading, camera, 1 << 40) == 0


@pytest.mark.parametrize("kind", ["rectangle", "sphere", "cylinder", "out of focus"])
def test_lamps_below_a_pixel_do_not_stand_out(kit, kind):
    """No worse than rays spread evenly: pixels that a lamp is somewhere in get as many rays as it takes."""
    camera = kit.sensor(size=48)
    if kind == "out of focus":
        camera.update(type="thinlens", aperture_radius=0.05, focus_distance=2.0)
    lights, rng = {"lamp": kit.lamp()}, np.random.default_rng(5)
    for k in range(8):
        at = [float(c) for c in (rng.uniform(-1, 1), rng.uniform(0.3, 1.2), rng.uniform(-2, 0))]
        shape = {"type": "rectangle", "to_world": T().translate(at) @ T().scale(0.01)}
        if kind == "sphere":
            shape = {"type": "sphere", "center": at, "radius": 0.01}
        if kind == "cylinder":
            shape = {"type": "cylinder", "p0": at, "p1": [at[0] + 0.4, at[1] + 0.1, at[2]], "radius": 0.005}
        lights[f"small {k}"] = {**shape, "emitter": {"type": "area", "radiance": 40.0}}
    scene = kit.room(lights, camera=camera)
    assert kit.error_ratio(scene, 2048) < 0.7
