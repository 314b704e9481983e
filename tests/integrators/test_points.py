"""Point sets, light cells and closed forms against brute force."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

RELAXED = settings(max_examples=15, deadline=None)
WORD = st.integers(0, 2**32 - 1)


@pytest.fixture(autouse=True)
def _variant(variant_llvm):
    pass


@RELAXED
@given(WORD, WORD, st.integers(0, 8), st.integers(0, 1000))
def test_every_elementary_interval_holds_one_point(s0, s1, m, block):
    from intervis.integrators.points import net_2d

    n = 2**m
    i = dr.arange(mi.UInt32, n) + block * n
    p = np.array(net_2d(i, mi.UInt32(s0), mi.UInt32(s1)))
    assert (p >= 0).all() and (p < 1).all()
    for a in range(m + 1):
        cell = (p[0] * 2**a).astype(int) * 2 ** (m - a) + (p[1] * 2 ** (m - a)).astype(int)
        assert len(set(cell)) == n


@RELAXED
@given(WORD, st.integers(0, 9))
def test_one_dimension_is_stratified_and_shuffles_permute_blocks(s, m):
    from intervis.integrators.points import net_1d, shuffle

    n = 2**m
    i = dr.arange(mi.UInt32, n)
    assert len(set((np.array(net_1d(i, mi.UInt32(s))) * n).astype(int))) == n
    order = np.array(shuffle(i, mi.UInt32(s)))
    assert sorted(order - order.min()) == list(range(n)) and order.min() % n == 0


@RELAXED
@given(st.tuples(WORD, WORD, WORD, WORD), st.integers(0, 3), st.integers(0, 500))
def test_pixel_and_light_are_spread_together(s, k, block):
    """64 places in a pixel with 2^k light samples each: the 2×2×2×2 boxes of pixel × light hold equally many."""
    from intervis.integrators.points import net_2d, net_high

    s = [mi.UInt32(x) for x in s]
    i = dr.arange(mi.UInt32, 64 << k) + block * (64 << k)
    place, light = np.array(net_high(i >> k, s[0], s[1])), np.array(net_2d(i, s[2], s[3]))
    box = sum((x * 2).astype(int) << n for n, x in enumerate([*place, *light]))
    assert set(np.bincount(box, minlength=16)) == {4 << k}
    # The places alone: each axis in 64 strata, the square in 16
    assert all(len(set((x[:: 1 << k] * 64).astype(int))) == 64 for x in place)
    square = (place[0, :: 1 << k] * 4).astype(int) * 4 + (place[1, :: 1 << k] * 4).astype(int)
    assert set(np.bincount(square, minlength=16)) == {4}


def test_points_past_the_table_are_new_ones():
    from intervis.integrators.points import INDEX_BITS, net_high

    i = dr.arange(mi.UInt32, 256)
    a, b = (np.array(net_high(i + x, mi.UInt32(1), mi.UInt32(2))) for x in (0, 1 << INDEX_BITS))
    assert (a != b).any(axis=0).mean() > 0.9


@pytest.mark.parametrize("net", ["net_2d", "net_high"])
def test_scrambled_points_are_uniform_over_seeds(net):
    """Mean, variance and covariance of one point of the net over 2^16 scramblings."""
    from intervis.integrators import points
    from intervis.integrators.points import seeds

    n = 2**16
    for number in (0, 5):
        s = seeds(dr.arange(mi.UInt32, n), mi.UInt32(7), 2)
        x, y = np.array(getattr(points, net)(mi.UInt32(number), *s), dtype=np.float64)
        for u in (x, y):
            assert abs(u.mean() - 0.5) < 4.5 * np.sqrt(1 / 12 / n)
            assert abs(u.var() - 1 / 12) < 4.5 * np.sqrt(1 / 180 / n)
        assert abs(np.mean((x - 0.5) * (y - 0.5))) < 4.5 / 12 / np.sqrt(n)


def test_seeds_are_deterministic_and_distinct():
    from intervis.integrators.points import seeds

    a, b, c = (np.array(seeds(dr.arange(mi.UInt32, 64), mi.UInt32(s), 12)) for s in (3, 3, 4))
    assert (a == b).all() and len(np.unique(np.concatenate([a.ravel(), c.ravel()]))) == 2 * a.size


def irradiance(p, n, corners):
    from intervis.integrators.rectangle import polygon_irradiance

    corners = [mi.Point3f(*map(float, c)) for c in corners]
    return float(polygon_irradiance(mi.Point3f(*map(float, p)), mi.Vector3f(*map(float, n)), corners)[0])


SQUARE = [(0, 0, 1), (0, 1, 1), (1, 1, 1), (1, 0, 1)]


def test_a_point_under_the_corner_of_a_square():
    """The textbook factor: F = (A/√(1+A²) atan(B/√(1+A²)) + B/√(1+B²) atan(A/√(1+B²))) / 2π, A = B = 1."""
    factor = 2 / np.sqrt(2) * np.arctan(1 / np.sqrt(2)) / (2 * np.pi)
    value = max(irradiance((0, 0, 0), (0, 0, 1), SQUARE), irradiance((0, 0, 0), (0, 0, 1), SQUARE[::-1]))
    assert value == pytest.approx(np.pi * factor, rel=1e-5)


def quadrature(p, n, size=1200):
    u = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(u, u)
    d = np.stack([x, y, np.ones_like(x)], -1) - p
    d2 = (d**2).sum(-1)
    return np.mean(np.maximum(d @ n, 0) * np.abs(d[..., 2]) / d2**2)


@RELAXED
@given(st.tuples(*[st.floats(-1, 2)] * 2), st.floats(-1, 0.6), st.tuples(*[st.floats(-1, 1)] * 3))
def test_the_horizon_clips_a_square(xy, z, n):
    n = np.array(n)
    if np.linalg.norm(n) < 0.1:
        n = np.array([0.0, 0, 1])
    n /= np.linalg.norm(n)
    p = np.array([*xy, z])
    # The orientation that lights a point straight below is the emitting one
    up = irradiance((0.5, 0.5, 0), (0, 0, 1), SQUARE)
    corners = SQUARE if up > 0 else SQUARE[::-1]
    assert irradiance(p, n, corners) == pytest.approx(quadrature(p, n), rel=2e-4, abs=2e-5)


@RELAXED
@given(st.integers(1, 12), st.integers(1, 9), st.integers(0, 2), st.integers(1, 3), st.integers(0, 99))
def test_windows_leave_the_pixel_out(width, height, radius, apart, seed):
    from intervis.integrators.cells import window_sum

    image = np.random.default_rng(seed).integers(0, 9, (height, width))
    padded = np.pad(image, radius * apart)
    steps = range(0, 2 * radius * apart + 1, apart)
    expected = sum(padded[y : y + height, x : x + width] for y in steps for x in steps)
    (got,) = window_sum([mi.UInt64(image.ravel().astype(np.uint64))], width, height, radius, apart)
    np.testing.assert_array_equal(np.array(got).reshape(height, width), expected - image)


@RELAXED
@given(st.integers(1, 12), st.integers(1, 9), st.integers(1, 3))
def test_windows_are_cut_at_the_border(width, height, radius):
    from intervis.integrators.cells import window_count, window_sum

    (ones,) = window_sum([dr.full(mi.Float, 1, width * height)], width, height, radius)
    np.testing.assert_array_equal(np.array(window_count(width, height, radius)), np.array(ones))


def test_a_bright_pixel_leaves_nothing_in_its_own_window(variant_llvm):
    from intervis.integrators.cells import window_sum

    image = np.full((5, 5), 1e-3, np.float32)
    image[2, 2] = 1e9
    (got,) = window_sum([mi.Float(image.ravel())], 5, 5)
    assert np.array(got)[12] == pytest.approx(24e-3, rel=1e-5)


@RELAXED
@given(st.lists(st.integers(0, 15), min_size=1, max_size=200))
def test_packed_counters_count(bins):
    from intervis.integrators import cells

    words = cells.empty(16)
    for b in bins:
        words = cells.count(words, mi.UInt32(b), mi.Bool(True))
    words = cells.count(words, mi.UInt32(3), mi.Bool(False))
    assert [int(cells.read(words, b)[0]) for b in range(16)] == [bins.count(b) for b in range(16)]


@RELAXED
@given(st.lists(st.sampled_from([0.0, 0.001, 0.3, 0.5, 0.999, 1.0]), min_size=16, max_size=16))
def test_only_certain_fractions_pack_to_zero_and_one(fractions):
    from intervis.integrators import cells

    word = cells.pack_fractions([mi.Float(f) for f in fractions])
    got = np.array([float(cells.fraction(word, mi.UInt32(c))[0]) for c in range(16)])
    assert (np.abs(got - fractions) <= 1 / 15).all()
    assert ((got == 0) == (np.array(fractions) == 0)).all() and ((got == 1) == (np.array(fractions) == 1)).all()
    undecided = sum(1 << c for c, f in enumerate(fractions) if 0 < f < 1)
    assert int(cells.undecided(word)[0]) == undecided


@RELAXED
@given(st.integers(0, 2**16 - 1), st.sampled_from([0.05, 0.08, 1.0]))
def test_refinement_has_the_density_that_it_says(mask, floor):
    from intervis.integrators import cells

    side = 256
    u = (dr.arange(mi.Float, side) + 0.5) / side
    cell, v, density = cells.sample(mi.UInt32(mask), mi.Point2f(dr.meshgrid(u, u)), mi.Float(floor))
    cell, v, density = np.array(cell), np.array(v), np.array(density)
    np.testing.assert_array_equal(cell, (v[1] * 4).astype(int) * 4 + (v[0] * 4).astype(int))
    weight = np.array([1.0 if mask >> c & 1 else floor for c in range(16)])
    np.testing.assert_allclose(density, 16 * weight[cell] / weight.sum(), rtol=1e-5)
    # Each cell is hit in proportion, and one over the density averages to the square's area
    share = np.bincount(cell, minlength=16) / side**2
    np.testing.assert_allclose(share, weight / weight.sum(), atol=0.02)
    assert np.mean(1 / density) == pytest.approx(1, abs=0.05)
