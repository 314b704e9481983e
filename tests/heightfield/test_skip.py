"""Rays that step over stretches find what rays that look everywhere find."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from intervis.heightfield import HeightField, fields, march, skip
from intervis.heightfield.sweep import direction

SHAPES = [(1, 1), (1, 9), (9, 1), (2, 2), (17, 33), (40, 16), (70, 150), (20, 1100), (1100, 20)]


def rough(shape, seed=0, scale=30.0):
    return np.random.default_rng(seed).normal(0, scale, shape)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("azimuth", [0, 45, 90, 135, 225, 270, 17, 100.5, 211, 300])
def test_steps_over_nothing_that_is_seen(shape, azimuth):
    hf = HeightField(rough(shape), spacing=(30, 25))
    azimuths = np.radians([azimuth])
    np.testing.assert_allclose(hf.horizons(azimuths), hf.horizons(azimuths, method="march"), rtol=1e-5, atol=1e-6)


@given(
    rows=st.integers(1, 60),
    columns=st.integers(1, 60),
    azimuth=st.floats(0, 6.28),
    power=st.floats(0.2, 8),
    radius=st.one_of(st.none(), st.floats(1, 60)),
    curvature=st.booleans(),
    seed=st.integers(0, 1000),
)
@example(rows=1, columns=2, azimuth=1.5707963, power=1.0, radius=None, curvature=False, seed=0)  # a hair off the border
@settings(max_examples=150, deadline=None)
def test_any_field(rows, columns, azimuth, power, radius, curvature, seed):
    # Of high powers few samples stand out: most stretches are stepped over
    heights = np.abs(rough((rows, columns), seed, 1.0)) ** power
    hf = HeightField(heights, 1.0, radius=radius, curvature=curvature)
    # Heights between samples are float32 too
    rounding = 1e-6 + 2e-7 * heights.max()
    np.testing.assert_allclose(hf.horizons([azimuth]), hf.horizons([azimuth], method="march"), rtol=1e-5, atol=rounding)


@pytest.mark.parametrize("azimuth", [90, 97, 112, 130, 135])
@pytest.mark.parametrize("y, x", [(0, 0), (2 / 3, 1 / 3), (1 / 3, 2 / 3)])
def test_stretches_are_as_high_as_what_rays_meet_there(azimuth, y, x):
    rows, columns = 90, 200
    heights = rough((rows, columns)).astype(np.float32)
    d = direction(np.radians(azimuth), (1, 1))
    laid = skip.lay(heights, d)
    offset, weight, distance = march.crossings(d.slope, d.diagonal, columns, y, x)
    edges = np.zeros((len(offset), 6), int)
    edges[:, [1, 2, 4, 5]] = offset
    tops = skip.stretches(laid, d)
    way = skip.way(laid.shape, tops, d, 0.0, edges, weight, distance, y, x)
    stride, tested = laid.shape[2], 0
    for row, column in [(0, 0), (3, 5), (40, 17), (80, 130)]:
        for level, size in enumerate(skip.SIZES):
            first = (column // size + 1) * size - column
            for k in range(first, columns - column, size):
                if row + way.down[k] >= rows:
                    break
                at = way.begins[level] + (column + k) // size * stride + row + way.down[k]
                for n in range(way.upto[k], way.upto[min(k + size, len(way.upto) - 1)]):
                    (ra, ca, rb, cb) = offset[n] + [row, column, row, column]
                    if max(ra, rb) < rows and max(ca, cb) < columns:
                        turned = d.turn(heights)
                        tested += 1
                        assert way.tops[at] >= (1 - weight[n]) * turned[ra, ca] + weight[n] * turned[rb, cb]
    assert tested > 200


def test_looks_at_little_of_a_landscape():
    hf = HeightField(fields.fractal(256), spacing=30.0)
    hf.horizons(8)
    ours = hf.tally.looked / hf.tally.rays
    hf.horizons(8, method="march")
    assert ours < 0.6 * hf.tally.looked / hf.tally.rays
