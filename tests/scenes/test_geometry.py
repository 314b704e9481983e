"""The scenes are what their documentation says: dimensions, orientation, classes of visibility, seeds."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import intervis.scenes as scenes
from intervis.scenes import canopy, figures, measured, meshes


def volume(part):
    """Signed volume of a closed surface: positive when its faces are counter-clockwise from outside."""
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def closed(part):
    """Every directed edge has its opposite, once."""
    edges = np.concatenate([part.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forward, backward = ({tuple(e) for e in edges[:, o].tolist()} for o in ([0, 1], [1, 0]))
    return len(forward) == len(edges) and forward == backward


def floor_points(points, samples=1):
    """Interactions at the points (N, 3), each `samples` times."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(points) * samples)
    si.p = mi.Point3f(np.repeat(points, samples, 0).T.astype(np.float32))
    si.n = mi.Normal3f(0, 0, 1)
    return si


def visible(scene, points, samples=400, seed=0):
    """Return two fractions for each floor point (N, 3), over all lights.

    First, of the light samples that face the point those it sees; second, of all samples those that face it.
    """
    n = len(points)
    si = floor_points(points, samples)
    u = np.random.default_rng(seed).random((2, n * samples)).astype(np.float32)
    ds, weight = scene.sample_emitter_direction(si, mi.Point2f(u), False)
    facing = np.array((dr.max(weight) > 0) & (ds.d.z > 0)).reshape(n, samples)
    blocked = np.array(scene.ray_test(si.spawn_ray_to(ds.p))).reshape(n, samples)
    return (facing & ~blocked).sum(1) / np.maximum(facing.sum(1), 1), facing.mean(1)


def test_solids_are_closed_and_face_outwards():
    solids = {
        "box": (meshes.box((-1, 0, 2), (1, 3, 3)), 6.0),
        "ellipsoid": (meshes.ellipsoid((5, 0, 0), (1, 2, 0.5), 96), 4 / 3 * np.pi),
        "torus": (meshes.tube(_circle(2.0, 200), 0.5, 48), 2 * np.pi**2 * 2.0 * 0.25),
        "limb": (meshes.limb((0, 1, 2), (3, 1, 2), (0.5, 0.5), segments=96), np.pi / 4 * 3 + np.pi / 6),
    }
    for name, (solid, expected) in solids.items():
        assert closed(solid), name
        assert volume(solid) == pytest.approx(expected, rel=0.01), name
    for solid in (figures.pawn(), figures.vase()):
        assert closed(solid) and volume(solid) > 0
    top = figures.pawn().vertices[:, 2]
    assert (top.min(), top.max()) == pytest.approx((0, 1))


def _circle(radius, points):
    t = 2 * np.pi * np.arange(points) / points
    return np.stack([radius * np.cos(t), radius * np.sin(t), 0 * t], -1)


def test_join_and_move_by_hand():
    one = meshes.quads(np.array([[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]], float))
    two = meshes.join([one, meshes.move(one, (5, 0, 1), scale=2.0, turn=np.pi / 2)])
    assert two.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    np.testing.assert_allclose(two.vertices[4:], [(5, 0, 1), (5, 2, 1), (3, 2, 1), (3, 0, 1)], atol=1e-12)


@pytest.mark.parametrize("name", [n for n in scenes.names() if n != "cornell"])
def test_lights_face_the_floor(variant_llvm, name):
    scene = mi.load_dict(scenes.load(name, width=16, height=9))
    spots = np.array([(x, y, 0.0) for x in (-1.2, 0.3, 1.1) for y in (-1.5, 0.4)])
    seen, facing = visible(scene, spots)
    assert (facing > 0.2).all()
    assert seen.max() > 0.2


def test_open_floor_is_fully_visible_and_has_the_closed_form(variant_llvm):
    size, radiance = 1.5, 10.0
    scene = mi.load_dict(scenes.load("openfloor", light_size=size, radiance=radiance))
    seen, facing = visible(scene, np.array([(0.0, 0, 0), (2, 1, 0), (-3, 4, 0)]))
    assert (seen == 1).all() and (facing == 1).all()
    # Irradiance under the centre of a rectangle: four corners of Lambert's formula.
    a = size / 2 / 3.0
    corner = 2 * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a)) / (2 * np.pi)
    expected = 4 * corner * np.pi * radiance * 0.72 / np.pi
    u = np.random.default_rng(1).random((2, 100_000)).astype(np.float32)
    ds, weight = scene.sample_emitter_direction(floor_points(np.zeros((1, 3)), 100_000), mi.Point2f(u), True)
    sampled = (np.array(weight[0]) * np.array(ds.d.z)).mean() * 0.72 / np.pi
    assert sampled == pytest.approx(expected, rel=0.01)


def test_wires_hide_two_thousandths_to_two_hundredths(variant_llvm):
    scene = mi.load_dict(scenes.load("wires"))
    under = np.array([(0.0, y, 0.0) for y in np.linspace(-1.4, 2.4, 20)])
    hidden = 1 - visible(scene, under, samples=100_000)[0]
    assert (hidden > 0.001).all() and (hidden < 0.02).all()
    assert (hidden > 0.002).mean() > 0.7
    far = np.array([(0.0, -3.5, 0.0), (1.0, 5.0, 0.0)])
    assert (visible(scene, far, samples=4000)[0] == 1).all()


def test_penumbra_holds_umbra_penumbra_and_light(variant_llvm):
    scene = mi.load_dict(scenes.load("penumbra"))
    x, y = np.meshgrid(np.linspace(-1, 2.5, 15), np.linspace(-2, 2, 15))
    seen, _ = visible(scene, np.stack([x, y, 0 * x], -1).reshape(-1, 3))
    assert (seen == 0).any() and (seen == 1).mean() > 0.3
    assert 0.15 < ((seen > 0) & (seen < 1)).mean() < 0.6


def test_grating_grows_from_left_to_right(variant_llvm):
    scene = mi.load_dict(scenes.load("grating", bars=10, finest=0.1, coarsest=0.5))
    x = np.linspace(-1.3, 1.3, 4000).astype(np.float32)
    rays = mi.Ray3f(mi.Point3f(x, -1, 1), mi.Vector3f(0, 1, 0))
    behind = np.array(scene.ray_intersect(rays).t) > 1.2
    blocked = ~behind
    widths = np.diff(np.flatnonzero(np.diff(blocked.astype(int))))[::2] * (x[1] - x[0])
    assert len(widths) >= 8 and (np.diff(widths) > -2e-3).all() and widths[-1] > 3 * widths[0]


def test_small_light_shadows_are_hard(variant_llvm):
    scene = mi.load_dict(scenes.load("smalllight"))
    x, y = np.meshgrid(np.linspace(-2, 3, 40), np.linspace(-1, 3, 40))
    seen, _ = visible(scene, np.stack([x, y, 0 * x], -1).reshape(-1, 3), samples=64)
    assert ((seen > 0) & (seen < 1)).mean() < 0.06 < (seen == 0).mean()


@pytest.mark.parametrize(
    ("name", "values", "emitters"),
    [
        ("manylights", {}, 18),
        ("manylights", {"rows": 2, "columns": 5}, 10),
        ("spheres", {}, 3),
        ("glossy", {}, 4),
    ],
)
def test_number_of_lights(variant_llvm, name, values, emitters):
    assert len(mi.load_dict(scenes.load(name, **values)).emitters()) == emitters


def test_lights_of_every_shape_are_there(variant_llvm):
    shapes = {
        name: {s.class_name() for s in mi.load_dict(scenes.load(name)).shapes() if s.is_emitter()}
        for name in ("fence", "foliage", "spheres", "meshlight")
    }
    assert shapes == {
        "fence": {"Rectangle"},
        "foliage": {"Disk"},
        "spheres": {"Sphere"},
        "meshlight": {"Mesh"},
    }


def test_mesh_light_is_triangles_without_normals(variant_llvm):
    scene = mi.load_dict(scenes.load("meshlight", points=60, segments=5))
    (knot,) = (s for s in scene.shapes() if s.is_emitter())
    assert knot.face_count() == 2 * 60 * 5 and not knot.has_vertex_normals()


def test_foliage_is_decided_by_its_seed():
    def tree(seed):
        rng = np.random.default_rng(seed)
        return canopy._leaves(rng, canopy._branches(rng)[1], 50, 0.15)

    assert np.array_equal(tree(3), tree(3)) and not np.array_equal(tree(3), tree(4))


@pytest.mark.parametrize("name", ["foliage", "manylights"])
def test_same_parameters_same_picture(variant_llvm, name):
    def picture(**values):
        scene = mi.load_dict(scenes.load(name, width=32, height=18, **values))
        integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0})
        return np.array(mi.render(scene, integrator=integrator, spp=4))

    np.testing.assert_allclose(picture(), picture(), rtol=1e-5)
    changed = {"foliage": {"seed": 2}, "manylights": {"light_size": 0.3}}[name]
    assert not np.allclose(picture(), picture(**changed), rtol=1e-2)


def test_larger_light_widens_the_penumbra(variant_llvm):
    points = np.array([(x, y, 0.0) for x in np.linspace(-1, 2.5, 15) for y in np.linspace(-2, 2, 15)])

    def undecided(size):
        seen, _ = visible(mi.load_dict(scenes.load("penumbra", light_size=size)), points, samples=200)
        return ((seen > 0) & (seen < 1)).mean()

    assert undecided(0.3) < 0.7 * undecided(1.5)


def test_cornell_is_the_published_box(variant_llvm):
    # Light of 130 mm by 105 mm, blocks of 165 mm and 330 mm on square feet of about 160 mm.
    light = np.array(measured.LIGHT)
    assert np.ptp(light, axis=0).tolist() == [130, 0, 105]
    for block, height in ((measured.SHORT_BLOCK, 165), (measured.TALL_BLOCK, 330)):
        top = np.array(block[0])
        assert (top[:, 1] == height).all()
        sides = np.linalg.norm(top - np.roll(top, 1, 0), axis=1)
        assert ((sides > 155) & (sides < 170)).all()
        for wall in block[1:]:
            assert {p[1] for p in wall} == {0, height}
    scene = mi.load_dict(scenes.load("cornell"))
    np.testing.assert_allclose(np.array(scene.bbox().min).ravel(), 0)
    np.testing.assert_allclose(np.array(scene.bbox().max).ravel(), [556, 548.8, 559.2], rtol=1e-6)
    (light,) = (s for s in scene.shapes() if s.is_emitter())
    assert np.array(light.surface_area()).item() == pytest.approx(130 * 105, rel=1e-5)
    # Straight up, a ray meets the light in the opening and the ceiling beside it, at one height.
    up = mi.Ray3f(mi.Point3f([278, 100], [400, 400], [280, 280]), mi.Vector3f(0, 1, 0))
    hit = scene.ray_intersect(up)
    np.testing.assert_allclose(np.array(hit.p.y), 548.8, rtol=1e-6)
    emitted = hit.emitter(scene).eval(hit)
    np.testing.assert_allclose(np.array(emitted), np.transpose([measured.EMISSION, (0, 0, 0)]), rtol=1e-6)


def test_order_of_lights_is_the_same_each_time(variant_llvm):
    def radiances():
        lights = mi.load_dict(scenes.load("manylights")).emitters()
        return [float(mi.traverse(e)["radiance.value"].y[0]) for e in lights]

    assert all(radiances() == radiances() for _ in range(5))
