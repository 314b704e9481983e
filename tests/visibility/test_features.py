import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import intervis  # noqa: F401
from intervis.visibility import (
    classify_grid,
    cluster_features,
    co_occurrence,
    features,
    grid_features,
    grid_positions,
    neighbor_distance,
    quantize,
)
from intervis.visibility.features import feature_count

GRID = grid_positions(4)
HALF = np.repeat([0.0, 1.0], 8)
fractions_4x4 = arrays(np.float32, (4, 4), elements=st.floats(0, 1, width=32))


def floats(columns):
    """One Dr.Jit array a column."""
    return [mi.Float(np.ascontiguousarray(c, np.float32)) for c in np.asarray(columns).T]


def stacked(arrays, lanes):
    return np.stack([np.broadcast_to(a.numpy(), lanes) for a in arrays], -1)


def test_levels_by_hand():
    f = [0, 0.12, 1 / 8, 0.3, 0.499, 0.5, 7 / 8, 0.88, 1]
    assert quantize(f).tolist() == [0, 0, 1, 1, 1, 2, 2, 3, 3]
    assert quantize([0, 0.49, 0.5, 1], levels=2).tolist() == [0, 0, 1, 1]
    # G = 3: black below 1/6, white above 5/6, ties are gray
    assert quantize([0.16, 1 / 6, 5 / 6, 0.84], levels=3).tolist() == [0, 1, 1, 2]


@pytest.mark.parametrize("levels", range(2, 9))
def test_levels_mirror(levels):
    f = np.linspace(0, 1, 841)[1:-1]
    f = f[np.abs(f - 0.5) > 1e-6]
    assert np.array_equal(quantize(1 - f, levels), levels - 1 - quantize(f, levels))


def test_half_blocked_by_hand():
    # Two black rows over two white ones: 6 + 4 pairs inside each half, 4 across
    histogram, matrix = co_occurrence(HALF, GRID)
    assert histogram.tolist() == [8, 0, 0, 8]
    assert matrix.tolist() == [[20, 0, 0, 4], [0, 0, 0, 0], [0, 0, 0, 0], [4, 0, 0, 20]]
    expected = np.zeros(14)
    expected[[0, 3]] = 0.5
    expected[[4, 7, 13]] = 10 / 24, 4 / 24, 10 / 24
    np.testing.assert_allclose(features(HALF, GRID), expected, rtol=1e-6)


def test_aligned_stripes_by_hand():
    # Fig. 5h against Fig. 5b: the same histogram, but 12 of 24 pairs across
    histogram, matrix = co_occurrence(np.tile([0.0, 1.0], 8), GRID)
    assert histogram.tolist() == [8, 0, 0, 8]
    assert matrix.tolist() == [[12, 0, 0, 12], [0, 0, 0, 0], [0, 0, 0, 0], [12, 0, 0, 12]]


def test_see_through_by_hand():
    # Fig. 5f and 5g kinds: gray beside white, and gray scattered in white, differ in P_Δ₁ alone
    block = np.array([[0.4, 0.4, 1, 1]] * 4).ravel()
    scattered = np.where(np.add.outer(range(4), range(4)) % 2, 0.4, 1).ravel()
    (h, m), (g, k) = co_occurrence(block, GRID), co_occurrence(scattered, GRID)
    assert h.tolist() == g.tolist() == [0, 8, 0, 8]
    assert (m[1, 1], m[1, 3], m[3, 3]) == (20, 4, 20)
    assert (k[1, 1], k[1, 3], k[3, 3]) == (0, 24, 0)


def test_neighbor_distance_by_hand():
    # Nearest others at 1, 1 and 2: Δ₁ = 4/3 (Eq. 4), and no distance is within 20 % of it
    line = [(0, 0), (1, 0), (3, 0)]
    assert neighbor_distance(line) == pytest.approx(4 / 3)
    assert co_occurrence([0, 0, 0], line)[1].sum() == 0
    # Nearest others at 1, 1 and 1.1: both neighbour pairs count, the outer pair does not
    assert co_occurrence([0, 0.4, 1], [(0, 0), (1, 0), (2.1, 0)])[1].tolist() == [
        [0, 1, 0, 0],
        [1, 0, 0, 1],
        [0, 0, 0, 0],
        [0, 1, 0, 0],
    ]


def test_tolerance_ends_at_a_fifth():
    # Δ₁ = (1 + 1 + d)/3; with d = 1.42 the second pair is 0.28 > 0.2 Δ₁ away, with 1.3 it is 0.2 < 0.22
    for d, pairs in ((1.3, 4), (1.42, 2)):
        assert co_occurrence([1, 1, 1], [(0, 0), (1, 0), (1 + d, 0)])[1].sum() == pairs


def test_culled_cluster_is_absent():
    rng = np.random.default_rng(3)
    p, f = rng.random((9, 2)), rng.random(9)
    keep = np.delete(np.arange(9), 4)
    g = f.copy()
    g[4] = np.nan
    np.testing.assert_array_equal(features(g, p), features(f[keep], p[keep]))


@pytest.mark.parametrize("fractions, positions", [([0.3], [(0, 0)]), ([0.3, 1], [(1, 1), (1, 1)])])
def test_no_neighbors_gives_zeros(fractions, positions):
    x = features(fractions, positions)
    assert x[:4].sum() == 1
    assert not x[4:].any()


@given(fractions_4x4, st.integers(0, 3), st.booleans(), st.integers(2, 8))
@settings(max_examples=60, deadline=None)
def test_rotation_and_mirror_invariance(f, turns, mirror, levels):
    g = np.rot90(f[:, ::-1] if mirror else f, turns)
    x = features(f.ravel(), GRID, levels)
    np.testing.assert_array_equal(x, features(g.ravel(), GRID, levels))
    assert x.shape == (feature_count(levels),) and x.min() >= 0 and x.max() <= 1


@given(fractions_4x4, st.floats(0, 7), st.floats(1e-4, 1e6), st.floats(-1e5, 1e5))
@settings(max_examples=60, deadline=None)
def test_similar_grids_give_the_same(f, angle, scale, offset):
    # A grid turned, scaled and moved far away in the plane keeps its neighbours
    p = GRID.astype(float) @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]] * scale + offset * scale
    np.testing.assert_array_equal(features(f.ravel(), p), features(f.ravel(), GRID))


@pytest.mark.parametrize("n, levels", [(2, 4), (3, 3), (4, 2), (4, 4), (4, 5), (4, 8), (6, 4)])
def test_grid_batch_equals_numpy(variant_llvm, n, levels):
    # Half the lanes hold k/8 fractions, where ties are
    f = np.random.default_rng(n).random((512, n * n)).astype(np.float32)
    f[:256] = np.round(f[:256] * 8) / 8
    f[256:300] = np.round(f[256:300])
    got = stacked(grid_features(floats(f), levels), 512)
    np.testing.assert_array_equal(got, features(f, grid_positions(n), levels))


@given(arrays(np.float32, (8, 16), elements=st.floats(0, 1, width=32)), st.sampled_from([2, 4, 5]))
@settings(max_examples=25, deadline=None)
def test_grid_batch_equals_numpy_everywhere(f, levels):
    mi.set_variant("llvm_ad_rgb")
    np.testing.assert_array_equal(stacked(grid_features(floats(f), levels), 8), features(f, GRID, levels))


def brute_force(f, p, levels):
    """Eq. 2 and Eq. 4 as they are printed, in float64 loops."""
    kept = [i for i in range(len(f)) if not np.isnan(f[i])]
    q = quantize(f, levels)
    d = {(i, j): np.hypot(*(p[i] - p[j])) for i in kept for j in kept if i != j}
    delta = np.mean([min(d[i, j] for j in kept if j != i) for i in kept])
    matrix = np.zeros((levels, levels), int)
    for (i, j), distance in d.items():
        matrix[q[i], q[j]] += abs(distance - delta) < 0.2 * delta
    return matrix


@given(st.integers(0, 10**6), st.integers(2, 20), st.integers(2, 5))
@settings(max_examples=60, deadline=None)
def test_co_occurrence_equals_brute_force(seed, n, levels):
    rng = np.random.default_rng(seed)
    p, f = rng.random((n, 2)), rng.random(n)
    f[rng.random(n) < 0.2] = np.nan
    f[:2] = 0.1, 0.9
    np.testing.assert_array_equal(co_occurrence(f, p, levels)[1], brute_force(f, p, levels))


@pytest.mark.parametrize("culling", [False, True])
@pytest.mark.parametrize("shared", [False, True])
def test_cluster_batch_equals_numpy(variant_llvm, shared, culling):
    rng = np.random.default_rng(7)
    lanes, n = 256, 9
    f = rng.random((lanes, n)).astype(np.float32)
    p = rng.random((n, 2) if shared else (lanes, n, 2)).astype(np.float32)
    valid = rng.random((lanes, n)) < 0.8 if culling else np.ones((lanes, n), bool)
    masks = [mi.Bool(np.ascontiguousarray(v)) for v in valid.T] if culling else None
    if shared:
        positions = [tuple(map(float, xy)) for xy in p]
        p = p.astype(np.float64)
    else:
        positions = [tuple(mi.Float(np.ascontiguousarray(p[:, i, k])) for k in range(2)) for i in range(n)]
    got = stacked(cluster_features(floats(f), positions, 4, masks), lanes)
    np.testing.assert_array_equal(got, features(np.where(valid, f, np.nan), p))


def test_scattered_equals_grid_on_a_grid(variant_llvm):
    f = np.random.default_rng(0).random((64, 16))
    cells, positions = floats(f), [tuple(map(float, p)) for p in GRID]
    assert all(dr.all(a == b) for a, b in zip(grid_features(cells), cluster_features(cells, positions), strict=True))


def test_traces_into_a_larger_kernel(variant_llvm):
    # Inside a symbolic loop an evaluation would raise; around it, everything is one kernel
    index = dr.arange(mi.UInt32, 1000)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()

        def body(i, total):
            cells = [mi.Float((index >> (c % 10)) & 1) for c in range(16)]
            return i + 1, total + classify_grid(cells)

        _, total = dr.while_loop((mi.UInt32(0), mi.UInt32(0)), lambda i, _: i < 3, body)
        assert not dr.kernel_history([dr.KernelType.JIT])
        dr.eval(total)
        assert len(dr.kernel_history([dr.KernelType.JIT])) == 1
    bits = np.arange(1000)[:, None] >> (np.arange(16) % 10) & 1
    from intervis.visibility import classify

    np.testing.assert_array_equal(total.numpy(), 3 * classify(bits))
