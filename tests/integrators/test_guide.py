"""Light samples of skies go where pilots nearby saw the sky."""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.guide import SIDE, TILE, Counts, Guide, guide

SUN = np.full((16, 32), 0.4, np.float32)
SUN[5, 8] = 60.0
SKIES = {
    "even": lambda: {"type": "constant", "radiance": 0.7},
    "sunny": lambda: {"type": "envmap", "bitmap": mi.Bitmap(np.repeat(SUN[..., None], 3, axis=2))},
}
SURFACES = {
    "matt": lambda: {"type": "diffuse"},
    "roughplastic": lambda: {"type": "roughplastic", "alpha": 0.15},
    "roughconductor": lambda: {"type": "roughconductor", "alpha": 0.2},
    "roughdielectric": lambda: {"type": "roughdielectric", "alpha": 0.3},
}


def counted(width, height, tried, seen):
    """Return counts of every tile from arrays of shape (tiles down, tiles across, SIDE, SIDE)."""
    counts = Counts.empty(width, height)
    counts.tried, counts.seen = (mi.Float(np.ravel(x).astype(np.float32)) for x in (tried, seen))
    return counts


def test_counts_go_to_the_tile_and_cell_of_their_sample(variant_llvm):
    """A film of 20×9 pixels has 3×2 tiles; pixel 160 is the first of their second row, 179 the film's last."""
    counts = Counts.empty(20, 9)
    index = mi.UInt32([0, 7, 8, 19, 160, 179])
    np.testing.assert_array_equal(counts.tile(index), [0, 0, 1, 2, 3, 5])
    u = mi.Point2f([0.0, 0.99, 0.13, 0.5, 0.5, 0.5], [0.0, 0.0, 0.99, 0.5, 0.5, 0.5])
    tried, seen = mi.Bool([True] * 5 + [False]), mi.Bool([True, False, True, False, False, False])
    counts.add(counts.tile(index), u, tried, seen)
    expected = np.zeros((6, SIDE, SIDE))
    expected[0, 0, 0] = expected[0, 0, SIDE - 1] = expected[1, SIDE - 1, 1] = 1
    expected[2, SIDE // 2, SIDE // 2] = expected[3, SIDE // 2, SIDE // 2] = 1
    np.testing.assert_array_equal(np.reshape(counts.tried, expected.shape), expected)
    expected[0, 0, SIDE - 1] = expected[2:] = 0
    np.testing.assert_array_equal(np.reshape(counts.seen, expected.shape), expected)


def test_warped_points_have_the_density_they_are_said_to_have(variant_llvm):
    """Means of functions over density are their integrals over the unit square; cells get their share of the points."""
    rng = np.random.default_rng(5)
    w = rng.uniform(0.05, 1, (3, SIDE, SIDE))
    it, side = Guide(Counts.empty(24, 8), w, np.ones(3)), 512
    i = dr.arange(mi.UInt32, side * side)
    u = (mi.Point2f(mi.Float(i % side), mi.Float(i // side)) + 0.5) / side
    for tile in range(3):
        v, density = (np.array(x, np.float64) for x in it.warp(mi.UInt32(tile), u, mi.Bool(True)))
        assert v.min() >= 0 and v.max() < 1
        for f, integral in ((1 + 0 * v[0], 1), (v[0], 1 / 2), (v[0] * v[1] ** 2, 1 / 6), (np.cos(9 * v[1]), np.sin(9) / 9)):
            assert np.mean(f / density) == pytest.approx(integral, abs=4e-3)
        points, _, _ = np.histogram2d(v[1], v[0], SIDE, [[0, 1], [0, 1]])
        np.testing.assert_allclose(points / side**2, w[tile] / w[tile].sum(), atol=5e-4)
    # Where it is another light's turn nothing changes
    v, density = it.warp(mi.UInt32(0), u, mi.Bool(False))
    np.testing.assert_array_equal(v, u)
    assert np.all(np.array(density) == 1)


def test_cells_of_which_nothing_was_seen_get_few_samples(variant_llvm):
    """One column of cells is seen: it, and the cells beside it, are worth most; how much denser it is, is known."""
    tried = np.full((1, 1, SIDE, SIDE), 16.0)
    seen = np.zeros_like(tried)
    seen[..., 3] = 16
    it = guide(counted(TILE, TILE, tried, seen))
    i = dr.arange(mi.UInt32, SIDE * SIDE)
    u = (mi.Point2f(mi.Float(i % SIDE), mi.Float(i // SIDE)) + 0.5) / SIDE
    v, density = (np.array(x) for x in it.warp(mi.UInt32(0), u, mi.Bool(True)))
    at = {k: density[(v[0] * SIDE).astype(int) == k].mean() for k in (2, 3)}
    assert at[3] > 3 and at[3] / at[2] < 4
    assert np.mean(v[0] * SIDE // 1 == 3) > 0.4
    assert float(it.share[0]) == pytest.approx(at[3], rel=0.1)


@pytest.mark.parametrize("seen", ["all", "nothing", "half of each"])
def test_where_all_cells_are_alike_samples_are_even(variant_llvm, seen):
    """As densities that differ only spoil nets."""
    tried = np.full((3, 4, SIDE, SIDE), 4.0)
    tried[0] = 0
    share = {"all": 1.0, "nothing": 0.0, "half of each": 0.5}[seen]
    assert guide(counted(4 * TILE, 3 * TILE, tried, share * tried)) is None


def walls():
    """Return the walls of a room, 3 wide, with a window in the left one."""
    T = mi.ScalarTransform4f
    slabs = {
        "ceiling": ([0, 2.1, 0], [1.6, 0.1, 1.6]),
        "back": ([0, 1, -1.6], [1.6, 1, 0.1]),
        "right": ([1.6, 1, 0], [0.1, 1, 1.6]),
        "front": ([0, 1, 1.6], [1.6, 1, 0.1]),
        "below": ([-1.6, 0.4, 0], [0.1, 0.4, 1.6]),
        "above": ([-1.6, 1.8, 0], [0.1, 0.3, 1.6]),
        "behind": ([-1.6, 1, -1.5], [0.1, 1, 1.0]),
        "before": ([-1.6, 1, 1.5], [0.1, 1, 1.0]),
    }
    return {k: {"type": "cube", "to_world": T().translate(c).scale(s)} for k, (c, s) in slabs.items()}


def inside(kit, sky, surface, size=32):
    """Return a room that a sky lights through a window."""
    camera = kit.sensor(origin=(0.9, 1.4, 1.4), target=(-0.6, 0.3, 0), fov=70, size=size)
    return kit.room({"sky": SKIES[sky]()}, bsdf=SURFACES[surface](), camera=camera, **walls())


QUICK = (("even", "matt"), ("sunny", "roughplastic"))


@pytest.mark.parametrize(
    ("sky", "surface"),
    [
        pytest.param(sky, surface, marks=() if (sky, surface) in QUICK else pytest.mark.slow)
        for sky in SKIES
        for surface in SURFACES
    ],
)
def test_a_room_with_a_window(kit, sky, surface):
    kit.compare(inside(kit, sky, surface))


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
def test_a_window_beside_a_lamp_and_along_paths(kit, sky):
    scene = {**inside(kit, sky, "roughplastic"), "lamp": kit.lamp(3.0)}
    kit.compare(scene, ours="vispath", reference="path", both={"max_depth": 3})


@pytest.mark.parametrize("sky", SKIES)
def test_a_window_is_found(kit, sky):
    """Far less error than that of `direct` at equal samples; without a guide 0.27 and 0.9 times as much."""
    assert kit.error_ratio(inside(kit, sky, "matt", size=64), 2048, seeds=3) < 0.25
