"""Consistent mode: who shares with whom, that it pays, and that its bias vanishes."""

from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators import consistent
from intervis.integrators.share import PATCH, RADIUS, SLOPE, TOLERANCE, TURN, share
from intervis.scenes import load


def errors(scene, truth, mode, spp, seeds, scale=1.0):
    """Return relMSE of single renders, so many times as bright, and the rms of their mean's difference from the truth."""
    plugin = mi.load_dict({"type": "visdirect", "mode": mode})
    images = np.array([np.array(mi.render(scene, integrator=plugin, spp=spp, seed=s)) for s in range(seeds)], np.float64)
    images, truth = images * scale, truth * scale
    each = np.mean((images - truth) ** 2 / (truth**2 + 0.01))
    return each, np.sqrt(np.mean((images.mean(0) - truth) ** 2 / (truth**2 + 0.01)))


def truth_of(scene, spp):
    """Return a scene as the unbiased mode renders it with many samples."""
    plugin = mi.load_dict({"type": "visdirect"})
    return np.array(mi.render(scene, integrator=plugin, spp=spp, seed=1000), dtype=np.float64)


def scene_and_truth(name):
    scene = mi.load_dict(load(name, width=120, height=68))
    return scene, truth_of(scene, 2048)


def test_pixels_beside_another_surface_are_not_inner(variant_llvm):
    # Five columns of floor, then three of a wall that stands on it; and one pixel of floor that lies deeper
    width, height = 8, 6
    normal, point = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    normal[:, :5, 2] = normal[:, 5:, 0] = 1
    point[..., 0] = np.arange(width)
    point[..., 1] = np.arange(height)[:, None]
    point[:, 5:, 0] = 5
    point[:, 5:, 2] = np.arange(3)
    point[2, 2, 2] = -3
    dark = [mi.UInt64(np.zeros(width * height, np.uint64))] * 2
    pilot = SimpleNamespace(
        normal=mi.Vector3f(normal.reshape(-1, 3).T), point=mi.Point3f(point.reshape(-1, 3).T), seen=dark, tried=dark
    )
    grid = consistent.Grid(SimpleNamespace(width=width, height=height, pixels=width * height), pilot)
    inner = np.ones((height, width), bool)
    inner[:, 4:6] = False
    for row, column in ((2, 2), (1, 2), (3, 2), (2, 1), (2, 3)):
        inner[row, column] = False
    np.testing.assert_array_equal(np.array(grid.inner).reshape(height, width), inner)


def test_sharp_edges_of_shadows_leave_nothing_to_share(variant_llvm):
    # An even floor, four of four rays seen left of column 4, none from there on
    width, height = 9, 7
    y, x = np.mgrid[:height, :width]
    four = np.full(x.size, 0x01010101, np.uint64)
    pilot = SimpleNamespace(
        normal=mi.Vector3f(np.stack([0 * x, 0 * x, 0 * x + 1.0]).reshape(3, -1)),
        point=mi.Point3f(np.stack([x, y, 0.0 * x]).reshape(3, -1)),
        seen=[mi.UInt64(np.where(x.ravel() < 4, four, 0)), mi.UInt64(0 * four)],
        tried=[mi.UInt64(four), mi.UInt64(0 * four)],
    )
    grid = consistent.Grid(SimpleNamespace(width=width, height=height, pixels=x.size), pilot)
    left = np.array(grid.left()).reshape(height, width)[3]
    # Seen by those around column 2: all in the west, half in the east, 19 of 24 together; and turned round in column 5
    part = 0.5**2 / (4 * 19 / 24 * 5 / 24)
    some = consistent.LEFT + (1 - consistent.LEFT) * part / consistent.SHARP
    expected = [consistent.LEFT, consistent.LEFT, some, 1, 1, some, consistent.LEFT, consistent.LEFT, consistent.LEFT]
    np.testing.assert_allclose(left, expected, rtol=1e-5)


def test_narrow_penumbrae_lose_nothing(variant_llvm):
    """Pixels of which none shares in the end are not sent fewer rays as if they did."""
    scene = mi.load_dict(load("smalllight", width=160, height=90))
    truth = truth_of(scene, 512)
    ours, plain = (errors(scene, truth, mode, 16, 8)[0] for mode in ("consistent", "unbiased"))
    assert ours < 1.05 * plain


def test_equal_pixels_share_alike(variant_llvm):
    # On one even surface, where noise explains all differences, a half's mean is that over its window
    width, height = 30, 50
    y, x = np.mgrid[:height, :width]
    frame = SimpleNamespace(width=width, height=height, pixels=width * height)
    normal, point = (
        mi.Vector3f(0 * x.ravel(), 0 * x.ravel(), 0 * x.ravel() + 1.0),
        mi.Point3f(x.ravel(), y.ravel(), 0 * x.ravel()),
    )
    halves = np.random.default_rng(0).uniform(0.4, 0.6, (2, height, width))
    ratios = [mi.Color3f(mi.Float(half.ravel())) for half in halves]
    known, noise, one = dr.full(mi.Bool, True, x.size), dr.full(mi.Float, 10.0, x.size), dr.full(mi.Float, 1.0, x.size)
    pairs = [(v, mi.Color3f(one)) for v in ratios]
    workers = dr.thread_count()
    sums = share(frame, normal, point, pairs, ratios, noise, known)
    assert dr.thread_count() == workers
    for half, (light, bright) in zip(halves, sums, strict=True):
        mean = np.array(light / bright)[1].reshape(height, width)
        for i, j in ((0, 0), (5, 7), (23, 29), (24, 12), (49, 3)):
            window = half[max(i - RADIUS, 0) : i + RADIUS + 1, max(j - RADIUS, 0) : j + RADIUS + 1]
            assert mean[i, j] == pytest.approx(window.mean(), rel=1e-5)


def brute(normal, point, halves, ratios, noise, known):
    """Weighted sums pixel by pixel, in float64."""
    height, width = noise.shape
    near = range(-RADIUS, RADIUS + 1)
    weights = {(u, v): np.zeros((2, height, width)) for u in near for v in near if (v, u) > (0, 0)}
    for (u, v), w in weights.items():
        # Arrays of pairs: a pixel, and the one u to the right and v below, where there is one
        a, b = (
            (slice(0, height - v), slice(max(-u, 0), width - max(u, 0))),
            (slice(v, height), slice(max(u, 0), width + min(u, 0))),
        )
        step, n = point[b] - point[a], normal[a]
        along = np.abs((step * n).sum(-1))
        same = known[a] & known[b] & ((n * normal[b]).sum(-1) > TURN) & (along < SLOPE * np.linalg.norm(step, axis=-1))
        spread = noise[a] + noise[b]
        values = [(((x[a] - x[b]) ** 2).sum(-1) - spread) / (TOLERANCE * spread + 1e-7) * same for x in ratios]
        patches = np.zeros((3, height, width))
        for plane, value in zip(patches, [*values, same], strict=True):
            plane[a] = value
        padded = np.pad(patches, ((0, 0), (PATCH, PATCH), (PATCH, PATCH)))
        sums = sum(padded[:, i : i + height, j : j + width] for i in range(2 * PATCH + 1) for j in range(2 * PATCH + 1))
        mean = sums[:2] / np.maximum(sums[2], 1)
        w[:, a[0], a[1]] = ((1 + np.maximum(mean[::-1], 0) / 16) ** -16)[:, a[0], a[1]] * same
    out = []
    for w, half in enumerate(halves):
        total = half.copy()
        for (u, v), pair in weights.items():
            for y in range(height - v):
                for x in range(max(-u, 0), width - max(u, 0)):
                    for p, q in (((y, x), (y + v, x + u)), ((y + v, x + u), (y, x))):
                        total[p] += pair[w, y, x] * half[q]
        out.append(total)
    return out


def test_sharing_against_brute_force(variant_llvm):
    # An edge between surfaces, points off the plane, unknown pixels, noise of all sizes
    height, width = 29, 23
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width]
    normal, point = np.zeros((height, width, 3)), np.stack([x, y, (rng.random(x.shape) < 0.05) * 2.0], -1)
    normal[:, :15, 2] = normal[:, 15:, 1] = 1
    halves, ratios = (rng.uniform(0.3, 0.6, (2, height, width, channels)) for channels in (6, 3))
    noise, known = 10 ** rng.uniform(-5, -1, (height, width)), rng.random((height, width)) < 0.9

    def flat(values):
        return mi.Float(np.ascontiguousarray(values, np.float32).ravel())

    def vector(kind, values):
        return kind([flat(values[..., k]) for k in range(3)])

    found = share(
        SimpleNamespace(width=width, height=height, pixels=width * height),
        vector(mi.Vector3f, normal),
        vector(mi.Point3f, point),
        [(vector(mi.Color3f, half[..., :3]), vector(mi.Color3f, half[..., 3:])) for half in halves],
        [vector(mi.Color3f, ratio) for ratio in ratios],
        flat(noise),
        mi.Bool(known.ravel()),
    )
    expected = brute(normal, point, halves, ratios, noise, known)
    for half, pair in zip(expected, found, strict=True):
        image = np.concatenate([np.array(colour).T.reshape(height, width, 3) for colour in pair], -1)
        np.testing.assert_allclose(image[known], half[known], rtol=2e-5)


@pytest.mark.parametrize("name, share", [("grating", 0.6), ("penumbra", 0.5), ("fence", 0.75)])
def test_sharing_pays(variant_llvm, name, share):
    scene, truth = scene_and_truth(name)
    plain, shared = (errors(scene, truth, mode, 16, 4)[0] for mode in ("unbiased", "consistent"))
    assert shared < share * plain


def level(height, half_width, bsdf):
    """Return a level square."""
    T = mi.ScalarTransform4f
    up = T().translate([0, height, 0]) @ T().rotate([1, 0, 0], -90) @ T().scale(half_width)
    return {"type": "rectangle", "to_world": up, "bsdf": bsdf}


def lamp_at(kit, place, half_width, radiance):
    """Return a square lamp that looks down."""
    T = mi.ScalarTransform4f
    return kit.lamp(radiance, T().translate(place) @ T().rotate([1, 0, 0], 90) @ T().scale(half_width))


def plate_over(kit, bsdf, half_width, width):
    """Return the scene of a plate between a floor and a lamp."""
    scene = kit.room(
        camera=kit.sensor(origin=(0, 4, 6), target=(0, 0, 0), fov=40, size=width, height=3 * width // 4),
        lights={"lamp": lamp_at(kit, [0, 3, 0], half_width, 2.5 / half_width**2)},
        blocker=False,
        floor=level(0, 4, bsdf),
        plate=level(1, 0.4, {"type": "twosided", "side": {"type": "diffuse"}}),
    )
    return mi.load_dict(scene)


def test_the_few_pixels_with_halves_do_not_share_among_themselves(variant_llvm, kit):
    # At four samples a pixel only those on the sharp edge of a small lamp's shadow have two hits
    scene = plate_over(kit, {"type": "diffuse"}, 0.05, 128)
    truth = truth_of(scene, 1024)
    # So bright that what leaks into the umbra shows
    plain, shared = (errors(scene, truth, mode, 4, 6, scale=10 / truth.mean())[0] for mode in ("unbiased", "consistent"))
    assert shared < 2 * plain


def test_textures_finer_than_pixels_shift_nothing(variant_llvm, kit):
    # Halves of a pixel's hits fall on black and white by chance, in the wide penumbra of a plate too
    black, white = ({"type": "rgb", "value": v} for v in (0.0, 0.9))
    fine = {"type": "checkerboard", "color0": black, "color1": white, "to_uv": mi.ScalarTransform4f().scale(10)}
    scene, means = plate_over(kit, {"type": "diffuse", "reflectance": fine}, 0.5, 48), []
    for mode in ("unbiased", "consistent"):
        plugin = mi.load_dict({"type": "visdirect", "mode": mode})
        renders = [np.array(mi.render(scene, integrator=plugin, spp=16, seed=s)).mean() for s in range(24)]
        means.append((np.mean(renders), np.var(renders) / 24))
    (plain, v), (shared, w) = means
    assert np.sqrt(v + w) < 1e-3 * plain
    assert abs(shared - plain) < 4e-3 * plain


def test_light_that_nobody_sees_brings_no_noise(variant_llvm, kit):
    # Where it is hidden it is seldom asked, so what it would add is noisy while the light that is there is not
    lamps = {"near": kit.lamp(2.0), "far": lamp_at(kit, [-1.5, 1.2, 0], 0.05, 60.0)}
    scene = mi.load_dict(kit.room(lights=lamps, camera=kit.sensor(origin=(0, 3, 3.5), size=64)))
    truth = truth_of(scene, 4096)
    plain, shared = (errors(scene, truth, mode, 16, 8)[0] for mode in ("unbiased", "consistent"))
    assert shared < plain


def test_shadows_of_two_colours_stay_apart(variant_llvm, kit):
    # Red and green light of one luminance, of a bar's two sharp shadows that touch: only the colour tells them apart
    lamps = {}
    for name, x, colour in (("red", -0.5, [1 / 0.2127, 0, 0]), ("green", 0.5, [0, 1 / 0.7152, 0])):
        lamps[name] = lamp_at(kit, [x, 2, 0], 0.01, 1.0)
        lamps[name]["emitter"]["radiance"]["value"] = [20000 * c for c in colour]
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}}
    bar = level(0.5, 1, {"type": "twosided", "side": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}})
    bar["to_world"] = bar["to_world"] @ mi.ScalarTransform4f().scale([0.125, 3, 1])
    camera = kit.sensor(origin=(0, 0.4, 2), target=(0, 0, 0.3), fov=50, size=128, height=96)
    scene = mi.load_dict(kit.room(lights=lamps, bsdf=grey, blocker=False, camera=camera, bar=bar))
    truth = truth_of(scene, 4096)
    plain, shared = (errors(scene, truth, mode, 64, 3)[0] for mode in ("unbiased", "consistent"))
    assert shared < 2 * plain


def test_pixels_that_no_light_reaches(variant_llvm):
    # Rounding leaves one of them below nought, with hardly any light even without shadows
    scene = mi.load_dict(load("smalllight", width=480, height=270))
    plugin = mi.load_dict({"type": "visdirect", "mode": "consistent"})
    assert np.isfinite(np.array(mi.render(scene, integrator=plugin, spp=64, seed=2))).all()


def test_bias_vanishes(variant_llvm):
    scene, truth = scene_and_truth("fence")
    few, many = (errors(scene, truth, "consistent", spp, seeds)[1] for spp, seeds in ((8, 16), (256, 4)))
    assert many < 0.3 * few
