"""Local horizons on shared lines: every method against exact brute force, which is the definition written out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intervis.heightfield import HeightField, lines, tree
from intervis.heightfield import intervisibility as iv
from intervis.heightfield.sweep import direction

METHODS = ("auto", "tree", "march")


def brute_force(h):
    """Return the horizons of every sample of a line: lists of distances, nearest first, and slopes.

    Float32 heights and whole distances: float64 products of their differences are exact, and so are ties.
    """
    found = []
    for r in range(len(h)):
        seen, best = [], None
        for k in range(r + 1, len(h)):
            over, run = float(h[k]) - float(h[r]), k - r
            seen.append(best is None or over * best[1] > best[0] * run)
            if seen[-1]:
                best = over, run
        ends = [k + 1 for k, s in enumerate(seen) if s and not (k + 1 < len(seen) and seen[k + 1])]
        found.append((ends, [(float(h[r + e]) - float(h[r])) / e for e in ends]))
    return found


def check(h, method, **options):
    """Compare a field whose rows are lines, looking east, with brute force."""
    offsets, distances, angles, *_ = iv.local_horizons(direction(np.pi / 2, (1, 1)), h, method=method, **options)
    for i, row in enumerate(h):
        for j, (ends, slopes) in enumerate(brute_force(row)):
            a, b = offsets[i * h.shape[1] + j : i * h.shape[1] + j + 2]
            assert distances[a:b].tolist() == ends, (i, j, row.tolist())
            np.testing.assert_allclose(angles[a:b], np.arctan(slopes), atol=2e-7)


def rough(rng, n):
    return rng.normal(size=n)


def smooth(rng, n):
    return np.cumsum(np.cumsum(rng.normal(size=n)))


def flat(rng, n):
    return np.repeat(rng.integers(0, 3, n), rng.integers(1, 9, n))[:n]


def spiky(rng, n):
    return np.where(rng.random(n) < 0.1, rng.uniform(0, 100, n), 0)


def bowl(rng, n):
    # The worst case: everything sees everything, every other sample depressed
    x = np.arange(n) - n / 2
    return x * x + np.where(np.arange(n) % 2, 0, rng.uniform(1, 9))


def dome(rng, n):
    return -((np.arange(n) - n / 2) ** 2)


def plane(rng, n):
    return rng.integers(-5, 6) * np.arange(n)


def stairs(rng, n):
    return np.arange(n) // rng.integers(2, 6) * rng.integers(-2, 3)


def wall(rng, n):
    return np.where(np.arange(n) == rng.integers(n), 1e6, 0)


def few(rng, n):
    # Small whole numbers: ties everywhere
    return rng.integers(0, 4, n)


KINDS = (rough, smooth, flat, spiky, bowl, dome, plane, stairs, wall, few)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", KINDS)
def test_lines_equal_brute_force(kind, method):
    rng = np.random.default_rng(7)
    for n in (1, 2, 3, 15, 16, 17, 33, 70):
        h = np.array([kind(rng, n) for _ in range(18)], dtype=np.float32)
        check(h, method)


@pytest.mark.slow
def test_ten_thousand_lines_equal_brute_force():
    rng = np.random.default_rng(11)
    for part in range(50):
        n = int(rng.integers(2, 60))
        h = np.array([KINDS[k](rng, n) for k in rng.integers(0, len(KINDS), 200)], dtype=np.float32)
        for method in METHODS if part % 10 == 0 else ("auto", "tree"):
            check(h, method)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-3, 3) | st.floats(-1e4, 1e4, width=32), min_size=1, max_size=40))
def test_any_line_equals_brute_force(method, h):
    check(np.array([h], dtype=np.float32), method)


@pytest.mark.parametrize("azimuth", (0.0, 0.3, np.pi / 4, 1.9, np.pi, 4.0, 3 * np.pi / 2, 5.9))
@pytest.mark.parametrize("curve", (0.0, 1e-3))
def test_methods_agree_in_every_direction(azimuth, curve):
    h = np.random.default_rng(3).normal(size=(45, 61)).astype(np.float32)
    d = direction(azimuth, (1.5, 1.0))
    first, *others = (iv.local_horizons(d, h, curve, method=m) for m in METHODS)
    for other in others:
        for a, b in zip(first[:3], other[:3], strict=True):
            np.testing.assert_array_equal(a, b)


def test_reach_cuts_lines_short():
    h = np.random.default_rng(4).normal(size=(3, 80)).astype(np.float32)
    d = direction(np.pi / 2, (1, 1))
    for reach in (21, 0.3, 0.3 / 0.1, 5.9):
        offsets, distances, *_ = iv.local_horizons(d, h, reach=reach)
        for j in range(80):
            expected = brute_force(h[0, j : j + 1 + round(reach - 0.49)])[0][0]
            assert distances[offsets[j] : offsets[j + 1]].tolist() == expected


def test_curvature_lowers_the_far_end():
    # Flat ground falls away: the neighbour hides everything beyond, at the angle of its own fall
    d = direction(np.pi / 2, (1, 100.0))
    offsets, distances, angles, *_ = iv.local_horizons(d, np.zeros((1, 50), np.float32), 1e-6)
    assert offsets[1] == 1
    assert distances[0] == 100
    assert angles[0] == pytest.approx(-1e-4, abs=1e-9)


def test_room_is_made_for_more_horizons_than_expected(monkeypatch):
    # A rising curve with every other sample raised: most of those are horizons, more than there is room for at first
    monkeypatch.setattr(iv, "BUDGET", 1)
    x = np.arange(300)
    h = (x**2 + 600.0 * (x % 2))[None].astype(np.float32)
    for method in METHODS:
        check(h, method)
    assert iv.local_horizons(direction(np.pi / 2, (1, 1)), h)[0][-1] > 20 * 300


def test_what_one_sees_sees_back():
    # A horizon of r at e: e sees r again, so looking back from e, r is seen; count pairs by both directions' visible samples
    h = np.random.default_rng(5).normal(size=40).astype(np.float32)

    def seen(h):
        pairs = set()
        for r in range(len(h)):
            best = -np.inf
            for k in range(r + 1, len(h)):
                s = (float(h[k]) - float(h[r])) / (k - r)
                if s > best:
                    best = s
                    pairs.add((r, k))
        return pairs

    east = iv.local_horizons(direction(np.pi / 2, (1, 1)), h[None])
    west = iv.local_horizons(direction(3 * np.pi / 2, (1, 1)), h[None])
    ends = {(r, r + int(x)) for r in range(40) for x in east[1][east[0][r] : east[0][r + 1]]}
    back = {(r - int(x), r) for r in range(40) for x in west[1][west[0][r] : west[0][r + 1]]}
    mutual = seen(h)
    assert ends <= mutual
    assert back <= {(39 - b, 39 - a) for a, b in seen(h[::-1])} == mutual


def test_every_grid_point_has_one_line():
    for slope in (0.0, 0.37, 1.0):
        first = lines.first_line(slope, 19)
        hits = np.zeros((13, 19), int)
        for m in range(first, 13):
            for x in range(19):
                i = lines.row_of(m, slope, x)
                if 0 <= i < 13:
                    hits[i, x] += 1
        assert (hits == 1).all()


def test_samples_of_a_plane_are_exact():
    y, x = np.mgrid[:9, :12]
    d = replace(direction(np.pi / 2, (1, 1)), slope=0.4)
    laid = lines.lay(2.0 * x + 3.0 * y, d)
    for m in range(-5, 9):
        out = np.empty((12, lines.LANES), np.float32)
        lines.panel(laid, m, 0.4, 0, 12, 0.0, out)
        for column in range(12):
            for lane in range(lines.LANES):
                if 0 <= lines.row_of(m + lane, 0.4, column) < 9:
                    y = min(max(m + lane + 0.4 * column, 0), 8)
                    assert out[column, lane] == pytest.approx(2 * column + 3 * y, rel=1e-6)
                else:
                    assert out[column, lane] == lines.NOWHERE


def test_threads_change_no_bit():
    import numba

    h = np.random.default_rng(6).normal(size=(90, 77)).astype(np.float32)
    d = direction(0.7, (1, 1))
    before = numba.get_num_threads()
    try:
        results = []
        for threads in {1, numba.config.NUMBA_NUM_THREADS}:
            numba.set_num_threads(threads)
            results.append(iv.local_horizons(d, h))
    finally:
        numba.set_num_threads(before)
    for a, b in zip(results[0][:3], results[-1][:3], strict=True):
        np.testing.assert_array_equal(a, b)


def test_totals_are_those_of_the_lists():
    h = np.random.default_rng(8).normal(size=(30, 50)).astype(np.float32)
    d = direction(1.1, (1, 1))
    offsets, distances, *_ = iv.local_horizons(d, h)
    for how in (iv.SKIPPING, iv.EVERY, iv.TREE):
        found = [np.empty(d.turn(h).shape, np.int32) for _ in range(2)]
        for values, out in zip(iv.totals(d, h, how=how)[:2], found, strict=True):
            iv.at_points(values, d.slope, iv.first_line(d.slope, out.shape[1]), out)
        counts, sums = (d.back(v) for v in found)
        np.testing.assert_array_equal(counts.ravel(), np.diff(offsets))
        assert sums.sum() == pytest.approx(distances.sum() / d.step, rel=1e-4)


@pytest.mark.parametrize("columns", (tree.MOST, tree.MOST + 1))
def test_lines_longer_than_the_tree_counts(columns):
    # Random heights: what is seen is near, the marcher that steps over blocks is done soon
    h = np.random.default_rng(10).normal(size=(2, columns)).astype(np.float32)
    h[:, ::4000] += 100
    d = direction(np.pi / 2, (1, 1))
    expected, found = (iv.totals(d, h, how=how) for how in (iv.SKIPPING, None))
    for a, b in zip(expected[:2], found[:2], strict=True):
        np.testing.assert_array_equal(a, b)
    assert (found[2] == expected[2]) == (columns > tree.MOST)


def test_tree_visits_far_less_than_the_marcher():
    y, x = np.mgrid[:256, :256] / 256
    h = (np.sin(16 * np.pi * x) * np.sin(16 * np.pi * y) * 5).astype(np.float32)
    d = direction(np.pi / 2, (1, 1))
    tree, march = (iv.totals(d, h, how=how)[2] for how in (iv.TREE, iv.EVERY))
    assert tree < 0.05 * march


def test_report_tells_what_was_skipped():
    field = HeightField(np.random.default_rng(9).normal(size=(40, 50)))
    lists = [field.intervisibility(np.pi / 2, method=m) for m in METHODS]
    for other in lists[1:]:
        for a, b in zip(lists[0], other, strict=True):
            np.testing.assert_array_equal(a, b)
    field.intervisibility(np.pi / 2, method="tree")
    naive = 40 * 50 * 49 // 2
    assert 0 < naive - field.report.skipped["crossings"] < 0.5 * naive
