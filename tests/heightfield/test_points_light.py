"""Irradiance of chosen receivers: the grid's own at grid points, closed forms between them."""

import numpy as np
import pytest

from intervis import InputError
from intervis.heightfield import HeightField, make

LIGHT = {"sky": [10.0, 3.0], "sun": (2.4, 0.5, 900.0), "albedo": 0.6, "azimuths": 16, "lamps": [(9.0, -8.0, 30.0, 5e3)]}


@pytest.fixture(scope="module")
def field():
    return HeightField(make("fractal", 24, seed=1) * 2, spacing=(1.0, 1.3))


@pytest.mark.parametrize("options", [{"bounces": 0}, {"bounces": 2}, {"bounces": 1, "emission": 3.0, "supersampling": 2}])
def test_grid_points_receive_what_the_grid_does(field, options):
    everywhere = np.ones(field.heights.shape, dtype=bool)
    found = field.irradiance(**LIGHT, **options, points=everywhere)
    found = found.reshape(*field.heights.shape, 2)
    expected = field.irradiance(**LIGHT, **options)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[1:-1, 1:-1], expected[1:-1, 1:-1], rtol=2e-4, atol=1e-6 * expected.max())
    # Along the border the sweeps take the nearest triangle of the same kind, single rays the one at the edge
    np.testing.assert_allclose(found, expected, rtol=0.02)


def test_a_white_furnace_anywhere(field):
    """Where sky and surface send the same from everywhere, every place of any slope receives π."""
    at = np.random.default_rng(3).uniform(0, 23, (40, 2))
    found = field.irradiance(1.0, albedo=0.0, emission=1.0, bounces=0, azimuths=48, points=at)
    np.testing.assert_allclose(found, np.pi, rtol=1e-3)


def test_between_the_samples_of_a_ramp():
    """A plane receives (1 + cos) / 2 of the sky, and of the sun its cosine, wherever one stands on it."""
    slope = np.arctan(0.5)
    ramp = HeightField(np.tile(0.5 * np.arange(20.0), (20, 1)))
    sun = (np.radians(250.0), 0.9, 100.0)
    to = np.array([np.sin(sun[0]) * np.cos(sun[1]), np.sin(sun[1])])
    expected = 2 * np.pi * (1 + np.cos(slope)) / 2 + 100 * to @ [-np.sin(slope), np.cos(slope)]
    # Only the upper half of the sky shines: below the ramp's border there is no ground
    found = ramp.irradiance(
        lambda az, el: 2.0 * (el >= 0), sun, bounces=2, azimuths=256, points=[[10.5, 9.25], [3.0, 17.9], [7.0, 4.0]]
    )
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_wall_that_shines_fills_its_sector():
    """A level receiver before an endless wall of radiance 1 receives sin² e / 2 = 1 / 2 a radian of azimuth."""
    heights = np.zeros((41, 12))
    heights[:, 10:] = 1e6
    shining = np.zeros(heights.shape)
    shining[:, 9:] = 1.0
    settings = {"sky": 0.0, "emission": shining, "albedo": 0.0, "bounces": 0, "azimuths": [np.pi / 2]}
    found = HeightField(heights).irradiance(**settings, points=[[20.25, 4.5]])
    np.testing.assert_allclose(found, 2 * np.pi * 0.5, rtol=1e-5)


def test_points_beside_unknown_heights_receive_nothing_known():
    heights = np.zeros((6, 6))
    heights[2, 2] = np.nan
    found = HeightField(heights).irradiance(azimuths=4, points=[[1.5, 1.5], [4.5, 4.5]])
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()


def test_a_strip_has_no_triangles_but_a_sky():
    found = HeightField(np.zeros((1, 9))).irradiance(azimuths=8, bounces=2, points=[[0.0, 3.5]])
    np.testing.assert_allclose(found, np.pi, rtol=1e-5)


def test_progress_counts_to_its_total(field):
    for bounces in (0, 2):
        seen = []
        field.irradiance(bounces=bounces, azimuths=3, points=[[1, 1]], progress=lambda *p, s=seen: s.append(p))
        assert [s[0] for s in seen] == list(range(1, seen[-1][1] + 1))


@pytest.mark.parametrize("points", [[[0, 50.0]], [1, 2], "x", np.ones((3, 3), bool)])
def test_points_refused(field, points):
    with pytest.raises(InputError, match="'points'"):
        field.irradiance(points=points)
