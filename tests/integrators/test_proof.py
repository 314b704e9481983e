"""Where no shadow ray is needed: proofs of visibility against many rays, and packets of rays that stay together."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intervis import scenes

RELAXED = settings(max_examples=20, deadline=None)


@pytest.fixture(autouse=True)
def _variant(variant_llvm):
    pass


def T():
    return mi.ScalarTransform4f()


def stage(*blockers, floor=4.0):
    """A floor, a lamp 1 wide and 2 above it, and blockers."""
    lamp = {
        "type": "rectangle",
        "to_world": T().translate([0, 0, 2]) @ T().rotate([1, 0, 0], 180) @ T().scale(0.5),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [1, 1, 1]}},
    }
    scene = {"type": "scene", "lamp": lamp}
    if floor:
        scene["floor"] = {"type": "rectangle", "to_world": T().scale(floor)}
    scene.update({f"blocker{i}": b for i, b in enumerate(blockers)})
    return mi.load_dict(scene)


def proven(scene, p, n=(0, 0, 1), radius=0.02):
    """Where the light is proven visible from disks about points p, shape (N, 3)."""
    from intervis.integrators.proof import unobstructed
    from intervis.integrators.shading import Rectangle, prepare

    shading = prepare(scene)

    class Surface:
        pass

    surface, si = Surface(), dr.zeros(mi.SurfaceInteraction3f, len(p))
    si.p, si.wi = mi.Point3f(np.float32(p).T), mi.Vector3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Vector3f(*map(float, n)))
    surface.shading, surface.si, surface.side = shading, si, mi.Float(1)
    surface.active, surface.plain, surface.albedo = mi.Bool(True), mi.Bool(True), mi.Color3f(1)
    result = unobstructed(shading.blockers, Rectangle(surface), mi.Float(radius), mi.Bool(True))
    return np.broadcast_to(np.array(result), len(p))


def seen(scene, p, n=(0, 0, 1), radius=0.02, rays=4096, seed=0):
    """Share of the lamp above the horizon that is visible from the disks."""
    rng = np.random.default_rng(seed)
    n = np.asarray(n, float)
    x = np.cross(n, [0.3, 0.5, 0.8])
    x /= np.linalg.norm(x)
    turn, far = rng.uniform(0, 2 * np.pi, rays), radius * np.sqrt(rng.uniform(0, 1, rays))
    disk = far[:, None] * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(n, x))
    lamp = np.column_stack([rng.uniform(-0.5, 0.5, (rays, 2)), np.full(rays, 2.0)])
    share = []
    for origin in p:
        d = lamp - (origin + disk)
        up = d @ n > 0
        si = dr.zeros(mi.SurfaceInteraction3f, rays)
        si.p, si.n = mi.Point3f(np.float32(origin + disk).T), mi.Normal3f(*map(float, n))
        hit = np.array(scene.ray_test(si.spawn_ray_to(mi.Point3f(np.float32(lamp).T))))
        share.append(1 - hit[up].mean() if up.any() else 1.0)
    return np.array(share)


FLOOR = np.stack(np.meshgrid(np.linspace(-1.9, 1.9, 14), np.linspace(-1.9, 1.9, 14), [0.0]), -1).reshape(-1, 3)


def test_an_open_floor_is_proven_everywhere():
    assert proven(stage(), FLOOR).all()


@RELAXED
@given(
    st.sampled_from(["cube", "rectangle", "sphere", "disk", "cylinder"]),
    st.tuples(*[st.floats(-1.2, 1.2)] * 2, st.floats(0.1, 2.4)),
    st.floats(0.05, 0.6),
    st.tuples(*[st.floats(-1, 1)] * 3, st.floats(0, 180)),
)
def test_what_is_proven_is_seen(shape, place, size, turn):
    axis = np.array(turn[:3]) if np.linalg.norm(turn[:3]) > 0.1 else np.array([0.0, 0, 1])
    rotation = T().rotate(list(axis / np.linalg.norm(axis)), turn[3])
    blocker = {"type": shape, "to_world": T().translate(list(place)) @ rotation @ T().scale(size)}
    scene = stage(blocker)
    sure = proven(scene, FLOOR)
    assert (seen(scene, FLOOR[sure]) == 1).all()


def test_a_blocker_spoils_the_proof_only_beneath_it():
    scene = stage({"type": "cube", "to_world": T().translate([0, 0, 1]) @ T().scale(0.2)})
    sure, share = proven(scene, FLOOR), seen(scene, FLOOR)
    assert not sure[share < 1].any()
    assert sure[share == 1].mean() > 0.6 and (share < 1).sum() > 20


def test_walls_part_themselves_from_what_is_before_them():
    walls = [
        {"type": "rectangle", "to_world": T().translate([2, 0, 1]) @ T().rotate([0, 1, 0], -80) @ T().scale(4)},
        {"type": "rectangle", "to_world": T().translate([0, 2, 1]) @ T().rotate([1, 0, 0], 90) @ T().scale(4)},
    ]
    assert proven(stage(*walls), FLOOR[np.abs(FLOOR).max(1) < 1.5]).all()


def test_points_on_a_slope():
    """A floor that leans away from a box which stands below its horizon."""
    n = np.array([0.6, 0, 0.8])
    for place, sure in (([-1, 0, 0], True), ([0.1, 0, 1], False)):
        scene = stage({"type": "cube", "to_world": T().translate(place) @ T().scale(0.1)}, floor=0)
        assert proven(scene, np.zeros((1, 3)), n, radius=0.0).all() == sure


def test_nothing_is_certain_far_from_the_origin():
    from intervis.integrators.shading import prepare

    lamp = {
        "type": "rectangle",
        "to_world": T().translate([1e5, 0, 2]) @ T().rotate([1, 0, 0], 180),
        "emitter": {"type": "area", "radiance": 1.0},
    }
    floor = {"type": "rectangle", "to_world": T().translate([1e5, 0, 0])}
    scene = mi.load_dict({"type": "scene", "lamp": lamp, "floor": floor})
    assert prepare(scene).blockers is not None
    assert not proven(scene, np.array([[1e5, 0, 0]])).any()


def test_a_crowded_scene_is_not_asked():
    from intervis.integrators.proof import MOST
    from intervis.integrators.shading import prepare

    balls = [{"type": "sphere", "center": [i, 0, 0.2], "radius": 0.1} for i in range(MOST + 1)]
    assert prepare(stage(*balls)).blockers is None


def test_an_open_floor_needs_no_shadow_rays(monkeypatch):
    """Through pixel centres two seeds agree up to rounding, and no shadow ray is traced."""
    from intervis.integrators import camera

    monkeypatch.setattr(camera, "net_high", lambda i, s0, s1: mi.Point2f(0.5, 0.5))
    scene = mi.load_dict(scenes.load("openfloor", width=64, height=36))
    integrator = mi.load_dict({"type": "visdirect"})
    a, b = (np.array(integrator.render(scene, seed=s, spp=16)) for s in (1, 2))
    assert a.max() > 0.1
    np.testing.assert_allclose(a, b, rtol=1e-6)
    rays, skipped = integrator.report.rays, integrator.report.skipped
    assert rays["pilot"] == rays["refinement"] == 0
    assert skipped["provably visible"] > 8 * 64 * 36


@pytest.mark.parametrize("flip", [False, True])
def test_a_quad_is_a_rectangle(flip, tmp_path):
    """A lamp made of two triangles has the closed form of a rectangle, whichever way it faces."""

    turn = T().translate([0.2, 0.1, 2]) @ T().rotate([1, 0, 0], 0 if flip else 180) @ T().scale([0.5, 0.3, 1])
    m = np.array(turn.matrix).reshape(4, 4)
    corners = (np.array([[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]]) @ m.T)[:, :3]
    path = tmp_path / "lamp.obj"
    vertices = "".join("v {} {} {}\n".format(*c) for c in corners)
    path.write_text(vertices + "f 1 2 3\nf 3 4 1\n")
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": [1, 2, 3]}}
    lamps = ({"type": "rectangle", "to_world": turn}, {"type": "obj", "filename": str(path), "face_normals": True})
    ground = T().translate([0, 0, 4]) @ T().rotate([1, 0, 0], 180) if flip else T()
    camera = {
        "type": "perspective",
        "to_world": T().look_at([0, -3, 1 if flip else 3], [0, 0, 4 if flip else 0], [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
    }
    images = []
    for lamp in lamps:
        floor = {"type": "rectangle", "to_world": ground @ T().scale(3)}
        scene = mi.load_dict({"type": "scene", "eye": camera, "lamp": {**lamp, "emitter": emitter}, "floor": floor})
        integrator = mi.load_dict({"type": "visdirect"})
        images.append(np.array(mi.render(scene, integrator=integrator, spp=64, seed=3)))
        assert integrator.report.rays["refinement"] == 0
    assert images[0].max() > 0.01
    np.testing.assert_allclose(*images, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("log_hits", [4, 5, 6, 8])
@pytest.mark.parametrize("log_rays", [0, 1, 2, 3])
def test_packets_share_a_cell_of_the_light(log_hits, log_rays):
    """At every step sixteen neighbouring lanes aim into one cell; all hits are there, and all rays of each."""
    from intervis.integrators.order import Order, turn
    from intervis.integrators.points import net_2d

    hits, rays = 2**log_hits, 2**log_rays
    k = mi.UInt32(np.arange(hits, dtype=np.uint32))
    s = Order().number(k, mi.UInt32(hits), mi.UInt32(rays))
    assert sorted(np.array(s)) == list(range(hits))
    flip = turn(s, mi.UInt32(rays))
    steps = [np.array(mi.UInt32(r) ^ flip) for r in range(rays)]
    steps = np.array([np.broadcast_to(x, hits) for x in steps])
    assert (np.sort(steps, axis=0) == np.arange(rays)[:, None]).all()
    cells = hits * rays // 16
    across = 2 ** max((log_hits + log_rays - 4 + 1) // 2, log_rays if log_hits > 4 else 0)
    down = cells // across
    for r in range(rays):
        u = np.array(net_2d(s * rays + mi.UInt32(np.uint32(steps[r])), mi.UInt32(123), mi.UInt32(77)))
        place = np.floor(u[0] * across) * down + np.floor(u[1] * down)
        assert all(len(set(packet)) == 1 for packet in place.reshape(-1, 16))
