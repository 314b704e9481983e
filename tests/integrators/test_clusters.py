"""Many lights in clusters: bounds hold, light is left out nowhere, chances add up, and pictures stay Mitsuba's."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

COUNT = 150
KINDS = ("rectangle", "sphere", "disk", "point", "cube", "cylinder", "spot")


def T():
    return mi.ScalarTransform4f()


def lights_of_all_kinds(count=COUNT, suns=0, seed=3, spread=2, kinds=KINDS):
    """Return lights of each kind in turn, anywhere above the floor, facing anywhere."""
    rng = np.random.default_rng(seed)
    found = {}
    for k in range(count):
        kind = kinds[k % len(kinds)]
        colour = {"type": "rgb", "value": list(rng.uniform(0.2, 1, 3) * 2)}
        place = T().translate(list(rng.uniform([-spread, 1, -spread], [spread, 2.5, spread])))
        axis = rng.normal(size=3)
        turn = T().rotate(list(axis / np.linalg.norm(axis)), rng.uniform(0, 360))
        turned = place @ turn @ T().scale(rng.uniform(0.05, 0.2))
        if kind == "point":
            found[f"light{k}"] = {"type": "point", "to_world": place, "intensity": {"type": "rgb", "value": 0.1}}
        elif kind == "spot":
            found[f"light{k}"] = {"type": "spot", "to_world": place @ turn, "cutoff_angle": 30, "intensity": 0.3}
        else:
            found[f"light{k}"] = {"type": kind, "to_world": turned, "emitter": {"type": "area", "radiance": colour}}
    for k in range(suns):
        down = [np.cos(k), -1.0, np.sin(k)]
        found[f"sun{k}"] = {"type": "directional", "direction": down, "irradiance": 0.02 * (1 + k)}
    return found


def ceilings(count=COUNT):
    """Return squares that all look down, at any height."""
    rng = np.random.default_rng(5)
    glow = {"type": "area", "radiance": 1.0}
    places = (T().translate(list(rng.uniform([-2, 0, -2], [2, 3, 2]))) for _ in range(count))
    return {
        f"light{k}": {"type": "rectangle", "to_world": p @ T().rotate([1, 0, 0], 90) @ T().scale(0.1), "emitter": glow}
        for k, p in enumerate(places)
    }


def stage(count=COUNT):
    """Return narrow spots that look down, more or less, from one height."""
    rng = np.random.default_rng(5)
    found = {}
    for k in range(count):
        at = rng.uniform([-2, 3, -2], [2, 3, 2])
        place = T().look_at(origin=list(at), target=list(at + rng.normal(size=3) * 0.4 - [0, 3, 0]), up=[1, 0, 0])
        found[f"light{k}"] = {"type": "spot", "to_world": place, "cutoff_angle": float(rng.uniform(5, 25)), "intensity": 5.0}
    return found


def collected(lights):
    """Return the lights, and the scene, which must outlive them."""
    from intervis.integrators.collect import collect

    scene = mi.load_dict({"type": "scene", **lights})
    return collect(scene), scene


def below(clusters):
    """Return a list of the lights below each node."""
    child, light = np.array(clusters.child), np.array(clusters.light)
    lists = [[int(l)] if c == 0 else [] for c, l in zip(child, light, strict=True)]
    for k in reversed(range(len(child))):
        if child[k]:
            lists[k] = lists[child[k]] + lists[child[k] + 1]
    return lists


@pytest.mark.parametrize("count, suns", [(17, 0), (COUNT, 0), (COUNT, 1), (10, 20), (0, 40), (200, 3)])
def test_trees_hold_every_light_once(variant_llvm, count, suns):
    from intervis.integrators.clusters import COUNTED, TOPS

    lights, _scene = collected(lights_of_all_kinds(count, suns))
    tree = lights.clusters
    lists = below(tree)
    counter = np.array(tree.counter)
    assert min(TOPS, count + suns) // 2 < tree.tops <= TOPS and lights.count == count + suns
    assert sorted(set(counter)) == list(range(COUNTED)) and len(counter) == tree.tops
    assert sorted(l for top in lists[: tree.tops] for l in top) == list(range(lights.count))
    assert [lists[k] for k in np.array(tree.node)] == [[l] for l in range(lights.count)]
    parent, child, after = (np.array(x) for x in (tree.parent, tree.child, tree.after))
    for k in np.flatnonzero(child):
        assert list(parent[child[k] : child[k] + 2]) == [k, k]
        assert after[child[k]] == child[k] + 1 and after[child[k] + 1] == after[k]
    rows, table = np.array(tree.table).reshape(-1, 12), np.array(lights.table).reshape(-1, 12)
    for k, some in enumerate(lists):
        inside = table[some]
        beams = (inside[:, 3] == 0) & (inside[:, 7] > 0)
        assert rows[k, 8] == pytest.approx(inside[:, 8].sum(), rel=1e-5)
        assert rows[k, 11] == (-1 if beams.all() else 1) * len(some)
        # Lights at infinity have no place and are kept apart
        assert (rows[k, 3] < 0) == (inside[0, 3] < 0) and len(set(inside[:, 3] < 0)) == 1
        if rows[k, 3] >= 0:
            reach = np.linalg.norm(inside[:, :3] - rows[k, :3], axis=1) + inside[:, 3]
            assert reach.max() <= rows[k, 3] * (1 + 1e-5) + 1e-6
        if rows[k, 9] > -1 and len(some) > 1:
            cosine = inside[:, 4:7] @ rows[k, 4:7] / np.linalg.norm(rows[k, 4:7])
            assert (cosine / inside[:, 7]).min() >= rows[k, 9] - 1e-5


def points(n=300, seed=1):
    """Return random points among the lights, and normals."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return rng.uniform([-2, 0, -2], [2, 3, 2], (n, 3)), normal


@pytest.mark.parametrize("kind", [lights_of_all_kinds, ceilings, stage])
def test_no_importance_only_where_no_light_below_has_any(variant_llvm, kind):
    from intervis.integrators.lights import importance

    lights, _scene = collected(kind())
    p, n = points()
    args = mi.Point3f(p.T), mi.Vector3f(n.T), mi.Bool(False)
    lists = below(lights.clusters)
    value = np.array([np.array(importance(lights, mi.UInt32(k), *args)) for k in range(len(lists))])
    alone = value[np.array(lights.clusters.node)]
    assert (alone == 0).mean() > 0.1
    for k, some in enumerate(lists):
        assert (value[k][(alone[some] > 0).any(axis=0)] > 0).all()
    # Clusters are of use where they are left out as a whole
    inner = np.array([len(some) > 1 for some in lists])
    assert (value[inner] == 0).mean() > 0.1


@pytest.mark.parametrize("specular", [False, True])
def test_lights_are_found_as_often_as_their_chance_says(variant_llvm, specular):
    """Every place of the unit interval belongs to one light, which has the chance that its interval is long."""
    from intervis.integrators.clusters import ascend, descend
    from intervis.integrators.lights import importance

    lights, _scene = collected(lights_of_all_kinds())
    tree, steps = lights.clusters, 4096
    p, n = mi.Point3f(0.3, 0.2, -0.4), mi.Vector3f(0.6, 0.8, 0)
    weigh = lambda k: importance(lights, k, p, n, mi.Bool(False), mi.Bool(specular))  # noqa: E731
    u = (dr.arange(mi.Float, steps) + 0.5) / steps
    for top, some in enumerate(below(tree)[: tree.tops]):
        light, chance, rest = (np.array(x) for x in descend(tree, weigh, mi.UInt32(top) + 0 * mi.UInt32(u), u, mi.Bool(True)))
        assert ((rest >= 0) & (rest < 1)).all() and set(light) <= set(some)
        root, back = (np.array(x) for x in ascend(tree, weigh, mi.UInt32(some), mi.Bool(True)))
        assert (root == top).all()
        if np.array(weigh(mi.UInt32(top)))[0] == 0:
            continue
        assert back.sum() == pytest.approx(1, abs=1e-5)
        for l, c in zip(some, back, strict=True):
            assert np.mean(light == l) == pytest.approx(c, abs=2 / steps)
            assert chance[light == l] == pytest.approx(c, rel=1e-4, abs=1e-7)


def test_close_lights_are_found_below_clusters(variant_llvm):
    from intervis.integrators.lights import CLOSE, any_close

    lights, _scene = collected(lights_of_all_kinds())
    p, _ = points(2000)
    table = np.array(lights.table, dtype=np.float64).reshape(-1, 12)
    want = np.zeros(len(p), dtype=bool)
    for row in table:
        d = row[:3] - p
        above, away = d @ row[4:7], np.linalg.norm(d, axis=1)
        beside = np.sqrt(np.maximum(away**2 - above**2, 0))
        disk = np.hypot(above, np.maximum(beside - row[3], 0))
        ball = np.maximum(away - row[3], 0)
        want |= (row[3] > 0) & ((disk if row[7] > 0 and row[9] >= 1 else ball) < CLOSE * row[3])
    assert 0.05 < want.mean() < 0.5
    assert (np.array(any_close(lights, mi.Point3f(p.T))) == want).mean() > 0.998  # but for rounding


@pytest.mark.slow
@pytest.mark.parametrize("bsdf", ["diffuse", "roughplastic"])
@pytest.mark.parametrize("integrator", ["visdirect", "vispath"])
def test_pictures_under_many_lights(kit, bsdf, integrator):
    lights = {**lights_of_all_kinds(suns=2), "sky": {"type": "constant", "radiance": 0.05}}
    scene = kit.room(lights, bsdf={"type": "twosided", "nested": {"type": bsdf}})
    if integrator == "vispath":
        kit.compare(scene, reference="path", ours="vispath", both={"max_depth": 3})
    else:
        kit.compare(scene, reference={"type": "direct", "emitter_samples": 1, "bsdf_samples": 1}, reference_spp=256)


def test_picture_under_many_lights(kit):
    kit.compare(kit.room(lights_of_all_kinds()), reference={"type": "direct", "bsdf_samples": 1})


def test_many_spots_leave_little_noise(kit):
    """A point is in the beams of few, and clusters of spots tell where none of theirs goes."""
    scene = kit.room(stage(), camera=kit.sensor(size=32))
    assert kit.error_ratio(scene, 4096, seeds=8) < 0.035


def test_lights_are_chosen_by_what_they_add(kit):
    """Of 240 lights, most are far away: chosen uniformly, as Mitsuba does, they leave much more noise."""
    scene = mi.load_dict(kit.room(lights_of_all_kinds(240, spread=15, kinds=KINDS[:-1])))
    variance = {}
    for name in ("direct", "visdirect"):
        integrator = mi.load_dict({"type": name})
        x = np.array([np.array(mi.render(scene, integrator=integrator, spp=32, seed=k)) for k in range(6)])
        variance[name] = np.median(x.var(0))
    assert variance["visdirect"] < 0.12 * variance["direct"]


def test_local_memory_has_one_size(kit, monkeypatch):
    """Kernels that differ in nothing else are one to Dr.Jit 1.5, which would run those of small scenes in large ones."""
    sizes, allocate = [], dr.alloc_local
    monkeypatch.setattr(dr, "alloc_local", lambda dtype, size, *a: sizes.append(size) or allocate(dtype, size, *a))
    for count in (2, 5, 40):
        scene = mi.load_dict(kit.room(lights_of_all_kinds(count)))
        mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=4)
    assert len(sizes) >= 3 and len(set(sizes)) == 1
