"""Mesh lights in parts: nothing that shines is left out, and pictures stay Mitsuba's."""

import mitsuba as mi
import numpy as np
import pytest


def ball(path, smooth=False, flip=False, steps=12):
    """Write a sphere of triangles as PLY and return it as a light."""
    u, v = np.meshgrid(np.arange(2 * steps) / (2 * steps), (np.arange(steps) + 0.5) / steps)
    turn, tilt = 2 * np.pi * u, np.pi * v
    point = np.stack([np.cos(turn) * np.sin(tilt), np.cos(tilt), np.sin(turn) * np.sin(tilt)], -1)
    i = np.arange(steps * 2 * steps).reshape(steps, -1)
    right = np.roll(i, -1, axis=1)
    faces = np.concatenate([np.stack([i[:-1], right[:-1], right[1:]], -1), np.stack([i[:-1], right[1:], i[1:]], -1)])
    faces = faces.reshape(-1, 3)
    # Some without area
    faces[::17, 2] = faces[::17, 1]
    mesh = mi.Mesh("ball", steps * 2 * steps, len(faces), has_vertex_normals=smooth)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = point.ravel().astype(np.float32)
    parameters["faces"] = faces.ravel().astype(np.uint32)
    if smooth:
        parameters["vertex_normals"] = point.ravel().astype(np.float32)
    parameters.update()
    mesh.write_ply(str(path))
    place = mi.ScalarTransform4f().translate([0.3, 1.6, 0.2]) @ mi.ScalarTransform4f().scale([0.3, 0.2, 0.4])
    glow = {"type": "area", "radiance": {"type": "rgb", "value": [8, 6, 4]}}
    return {"type": "ply", "filename": str(path), "to_world": place, "flip_normals": flip, "face_normals": not smooth,
            "emitter": glow}  # fmt: skip


def collected(lights):
    """Return the lights, and the scene, which must outlive them."""
    from intervis.integrators.collect import collect

    scene = mi.load_dict({"type": "scene", **lights})
    return collect(scene), scene


def test_parts_hold_all_triangles_once(variant_llvm, tmp_path):
    from intervis.integrators.meshlight import PARTS, groups, triangles

    shape = mi.load_dict(ball(tmp_path / "ball.ply"))
    mesh, kept = triangles(shape)
    group = groups(mesh)
    assert 8 <= group.max() + 1 <= PARTS and 0.9 * shape.face_count() < len(group) == len(kept) < shape.face_count()
    assert set(group) == set(range(group.max() + 1))
    assert mesh.area.sum() == pytest.approx(shape.surface_area()[0], rel=1e-5)
    for g in range(group.max() + 1):
        part = mesh.part(group == g)
        centre, radius, mean, cone = part.bounds()
        assert np.linalg.norm(part.corners - centre, axis=-1).max() <= radius * (1 + 1e-9)
        assert (part.normals @ mean / np.linalg.norm(mean)).min() >= cone - 1e-9


def test_no_importance_only_where_nothing_arrives(variant_llvm, tmp_path):
    from intervis.integrators.lights import importance
    from intervis.integrators.meshlight import groups, triangles

    light = ball(tmp_path / "ball.ply")
    (lights, _scene), mesh = collected({"ball": light}), triangles(mi.load_dict(light))[0]
    group = groups(mesh)
    rng = np.random.default_rng(1)
    p = rng.uniform(-1, 1, (400, 3)) + [0.3, 1.6, 0.2]
    n = rng.normal(size=(400, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    middle, normal = mesh.corners.mean(1), mesh.normals[:, 0]
    d = middle[None] - p[:, None]
    arrives = (np.einsum("pti,ti->pt", d, normal) < 0) & (np.einsum("pti,pi->pt", d, n) > 0)
    spared = 0
    for l in range(lights.count):
        value = np.array(importance(lights, mi.UInt32(l), mi.Point3f(p.T), mi.Vector3f(n.T), mi.Bool(False)))
        assert (value[arrives[:, group == l].any(axis=1)] > 0).all()
        spared += np.mean(value == 0) / lights.count
    # A third or more of a ball's parts are of no use to a point
    assert spared > 0.3


@pytest.mark.parametrize("smooth", [False, True], ids=["flat", "smooth"])
@pytest.mark.parametrize("flip", [False, True], ids=["outwards", "inwards"])
def test_samples_have_the_density_they_claim(variant_llvm, tmp_path, smooth, flip):
    lights, _scene = collected({"ball": ball(tmp_path / "ball.ply", smooth, flip)})
    it = dr_interaction([0.3, 1.6, 0.2] if flip else [0.9, 0.4, 0.1])
    u = (np.arange(4096) + 0.5) / 4096, (np.arange(4096) * 0.6180339887 + 0.5) % 1
    ours = np.zeros(3)
    for l in range(lights.count):
        _, weight = lights.parts.sample(it, lights.emitters[0], mi.UInt32(l), mi.Point2f(*u), mi.Bool(True))
        ours += np.array(weight).mean(axis=1)
    u = np.random.default_rng(2).uniform(size=(2, 1 << 18))
    theirs = np.array(lights.emitters[0].sample_direction(it, mi.Point2f(u), True)[1])
    error = theirs.std(axis=1) / np.sqrt(theirs.shape[1])
    assert (np.abs(ours - theirs.mean(axis=1)) < 5 * error + 1e-3 * ours).all()


def dr_interaction(p):
    it = mi.Interaction3f()
    it.p = mi.Point3f(*p)
    return it


@pytest.mark.slow
@pytest.mark.parametrize("smooth", [False, True], ids=["flat", "smooth"])
@pytest.mark.parametrize("others", [False, True], ids=["alone", "with_others"])
@pytest.mark.parametrize("glossy", [False, True], ids=["diffuse", "glossy"])
def test_pictures_under_mesh_lights(kit, tmp_path, smooth, others, glossy):
    lights = {"ball": ball(tmp_path / "ball.ply", smooth)}
    if others:
        lights["lamp"] = kit.lamp()
        lights["sky"] = {"type": "constant", "radiance": 0.2}
    kit.compare(kit.room(lights, bsdf={"type": "roughconductor", "alpha": 0.15} if glossy else None))
