"""Directions that serve one point in so many (§10.3): the same light on average, with noise instead of bands."""

import numpy as np
import pytest

from intervis import InputError
from intervis.heightfield import HeightField, make


def bands(e, middle, radius, count):
    """Amplitude of ``count`` waves around a circle."""
    angle = np.arange(4096) * 2 * np.pi / 4096
    i, j = (np.round(middle[k] + radius * f(angle)).astype(int) for k, f in enumerate((np.sin, np.cos)))
    return np.abs(np.fft.rfft(e[i, j]))[count] / len(angle)


def test_bands_turn_to_noise():
    """A tower in a plain darkens it along every azimuth: with sparse ones the rays of the star are gone."""
    heights = np.zeros((97, 97))
    heights[47:50, 47:50] = 20.0
    field = HeightField(heights)
    light = dict(sky=1.0, albedo=0.0, bounces=0)
    dense, sparse, truth = (
        field.irradiance(azimuths=k, sparse=n, **light)[..., 0] for k, n in ((32, 1), (256, 8), (1024, 1))
    )
    assert bands(dense, (48, 48), 40, 32) > 3 * bands(sparse, (48, 48), 40, 32)
    assert sparse.mean() == pytest.approx(truth.mean(), rel=1e-3)


@pytest.mark.parametrize("options", [{}, {"supersampling": 2}, {"tolerance": 0.01}])
def test_the_same_light_on_average(options):
    field = HeightField(make("fractal", 45, seed=4)[:, :38], spacing=(1.0, 1.4))
    light = dict(sky=[5.0, 1.0], sun=(2.0, 0.6, 30.0), albedo=0.6, bounces=2, **options)
    expected, found = (field.irradiance(azimuths=64, sparse=n, **light) for n in (1, 4))
    assert found.shape == expected.shape and found.min() > 0
    np.testing.assert_allclose(found.mean((0, 1)), expected.mean((0, 1)), rtol=5e-3)
    assert (np.abs(found - expected) < 0.3 * expected).all()
    # The order of azimuths is nothing to go by
    shuffled = np.random.default_rng(0).permutation(64) * 2 * np.pi / 64
    np.testing.assert_allclose(field.irradiance(azimuths=shuffled, sparse=4, **light), found, rtol=1e-5)


@pytest.mark.parametrize("shape", [(20, 33), (2, 40), (1, 40), (1, 1)])
def test_every_point_is_served(shape):
    e = HeightField(np.zeros(shape)).irradiance(sky=1.0, azimuths=64, sparse=4, bounces=1)
    np.testing.assert_allclose(e, np.pi, rtol=1e-4)


@pytest.mark.parametrize("sparse", [0, 5, 1.5, "x", None])
def test_refused(sparse):
    with pytest.raises(InputError, match="'sparse'"):
        HeightField(np.zeros((4, 4))).irradiance(azimuths=64, sparse=sparse)
    with pytest.raises(InputError, match=r"\(got 2 of 8\): take 32"):
        HeightField(np.zeros((4, 4))).irradiance(azimuths=8, sparse=2)
