import numpy as np
import pytest

from intervis.visibility import VisibilityClass as C
from intervis.visibility import patterns
from intervis.visibility.labels import label, region_areas

SIZE = 64
Y, X = (np.indices((SIZE, SIZE)) + 0.5) / SIZE


def test_patterns_come_from_the_seed_alone():
    a, b, c = (patterns.generate(210, seed, rays=(4, 8)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a[0], b[0])
    np.testing.assert_array_equal(a[1], b[1])
    assert not np.array_equal(a[0], c[0])
    assert np.bincount(a[1]).tolist() == [30] * 7


def test_areas_are_what_the_labels_say():
    f, y = patterns.generate(2100, 5)
    mean = f.mean(1)
    assert mean[y == C.FULLY_VISIBLE].min() >= 1 - patterns.TRACE - 1e-3
    assert mean[y == C.INVISIBLE].max() <= patterns.TRACE + 1e-3
    solid = mean[y == C.PARTIAL_SOLID]
    assert patterns.SOLID - 1e-3 <= solid.min() and solid.max() <= 1 - patterns.SOLID + 1e-3
    assert mean[y == C.FULL_SEE_THROUGH].min() > 0.15 and mean[y == C.FULL_SEE_THROUGH].max() < 0.85
    # At least 0.3 of a third region is black or white
    assert mean[y == C.PARTIAL_SEE_THROUGH].min() > 0.3 and mean[y == C.FULL_SOLID_SEE_THROUGH].max() < 0.7


def test_measured_fractions_are_counts_without_bias():
    rng = np.random.default_rng(0)
    exact = np.full((20_000, 1), 0.3)
    found = patterns.measure(exact, (6, 6), rng)
    np.testing.assert_allclose(found * 6, np.rint(found * 6), atol=1e-12)
    # z-test at 4 standard deviations
    assert abs(found.mean() - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 6 / 20_000)


def bars(period, duty=0.5, angle=0.0):
    return (X * np.cos(angle) + Y * np.sin(angle)) / period % 1 >= duty


GRATING = bars(1 / 16)
MAPS = {
    "lit": (np.ones((SIZE, SIZE), bool), C.FULLY_VISIBLE),
    "hidden": (np.zeros((SIZE, SIZE), bool), C.INVISIBLE),
    "wire": (np.abs(X - 0.43) > 0.005, C.FULLY_VISIBLE),
    "half": (X > 0.45, C.PARTIAL_SOLID),
    "edge strip": (X > 0.1, C.PARTIAL_SOLID),
    "diagonal": (X + Y > 0.8, C.PARTIAL_SOLID),
    "disc": (np.hypot(X - 0.5, Y - 0.5) > 0.25, C.PARTIAL_SOLID),
    "wide bars": (bars(0.8), C.PARTIAL_SOLID),
    "fine bars": (GRATING, C.FULL_SEE_THROUGH),
    "turned bars": (bars(1 / 10, angle=0.6), C.FULL_SEE_THROUGH),
    "checker": ((X * 8 % 2 < 1) ^ (Y * 8 % 2 < 1), C.FULL_SEE_THROUGH),
    "bars on half": (GRATING | (Y > 0.5), C.PARTIAL_SEE_THROUGH),
    "bars beside a wall": (GRATING & (Y > 0.5), C.FULL_SOLID_SEE_THROUGH),
    "thirds": ((GRATING | (Y > 0.67)) & (Y > 0.33), C.PARTIAL_SOLID_SEE_THROUGH),
}


@pytest.mark.parametrize("name", MAPS)
def test_dense_labels_by_construction(name):
    dense, expected = MAPS[name]
    assert label(dense)[0] is expected
    assert label(dense.T)[0] is expected
    assert label(dense[::-1, ::-1])[0] is expected
    assert sum(region_areas(dense)) == pytest.approx(1)


def test_the_same_bars_are_solid_for_smaller_cells():
    # See-through means as small as a cell (§5.1.1): eight bars are fine for 4×4 cells, solid for 32×32
    assert label(bars(1 / 8), n=4)[0] is C.FULL_SEE_THROUGH
    assert label(bars(1 / 8), n=32)[0] is C.PARTIAL_SOLID


def test_borderline_maps_are_marked():
    assert label(MAPS["thirds"][0])[1] and label(MAPS["half"][0])[1]
    assert not label(X > 0.04)[1]
    assert not label(GRATING | (Y > 0.12))[1]
