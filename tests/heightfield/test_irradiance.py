"""Gathered light: furnaces, interreflection in closed form, and the environment map's orientation."""

import numpy as np
import pytest

from intervis.errors import InputError
from intervis.heightfield import HeightField, make


@pytest.mark.parametrize("name", ["fractal", "brick", "sine", "blocks", "random", "bowl", "groove"])
def test_a_white_furnace(name):
    """Where surface and sky radiate alike, every point receives π, whatever hides what."""
    e = HeightField(make(name, 64)).irradiance(sky=1.0, emission=1.0, albedo=0.0, bounces=0, azimuths=64)
    assert e.mean() == pytest.approx(np.pi, rel=1e-4)
    np.testing.assert_allclose(e, np.pi, rtol=2e-3)


def test_bounces_approach_the_furnace():
    """With albedo 1 a closed valley loses light only through its opening: E rises towards that of the open sky."""
    field = HeightField(make("bowl", 48))
    e = [field.irradiance(sky=1.0, albedo=0.8, bounces=b, azimuths=32)[24, 24, 0] for b in (0, 1, 4, 30)]
    assert e[0] < e[1] < e[2] < e[3] < np.pi


def test_a_bowl_is_an_integrating_sphere():
    """In a spherical cap every point sees every other alike: E = L π s / (1 − ρ (1 − s)), s = 1/2 for a hemisphere.

    The cap's opening is half of the sphere, so a point's share of sky is 1/2 wherever it lies.
    """
    n = 161
    h = make("bowl", n)
    y, x = np.mgrid[:n, :n] - (n - 1) / 2
    inside = np.hypot(y, x) < 0.3 * n
    e = HeightField(h).irradiance(sky=1.0, albedo=0.6, bounces=10, azimuths=48)[..., 0]
    expected = np.pi * 0.5 / (1 - 0.6 * 0.5)
    assert e[inside].mean() == pytest.approx(expected, rel=0.02)


def test_channels_are_independent():
    field = HeightField(make("fractal", 40))
    kw = {"bounces": 2, "azimuths": 8}
    sun = (1.0, 0.6, np.array([100.0, 50.0, 20.0]))
    both = field.irradiance(sky=[1.0, 2.0, 3.0], sun=sun, albedo=[0.1, 0.5, 0.9], **kw)
    assert both.shape == (40, 40, 3)
    one = field.irradiance(sky=2.0, sun=(1.0, 0.6, 50.0), albedo=0.5, **kw)
    np.testing.assert_allclose(both[..., 1], one[..., 0], rtol=1e-5)


def test_lamps_have_channels_too():
    field = HeightField(make("fractal", 12))
    lamp = 4.0, -4.0, 40.0
    light = {"sky": 0.0, "bounces": 1, "azimuths": 8}
    coloured = field.irradiance(lamps=[(*lamp, [10.0, 20.0, 5.0]), (*lamp, 1.0)], **light)
    assert coloured.shape == (12, 12, 3)
    np.testing.assert_allclose(coloured[..., 1], field.irradiance(lamps=[(*lamp, 21.0)], **light)[..., 0], rtol=1e-5)
    with pytest.raises(InputError, match=r"^'sky', 'lamps\[1\]' must .* \(got 3, 2\)$"):
        field.irradiance([1.0, 2.0, 3.0], lamps=[(*lamp, 1.0), (*lamp, [1.0, 2.0])])
    with pytest.raises(InputError, match="'albedo' must hold real numbers"):
        field.irradiance(albedo=None)


def test_the_sun_on_a_plane():
    e = HeightField(np.zeros((5, 5))).irradiance(sky=0.0, sun=(2.0, np.radians(30), 1000.0), bounces=3, azimuths=8)
    np.testing.assert_allclose(e, 500.0, rtol=1e-5)


def test_a_function_and_a_map_of_the_sky_agree():
    """The map's first row is up, its columns run clockwise from north."""

    def sky(azimuth, elevation):
        return (1 + 0.5 * np.cos(azimuth - 1.0) * np.cos(elevation))[..., None]

    v, u = (np.arange(180) + 0.5) / 180, (np.arange(360) + 0.5) / 360
    pixels = sky(2 * np.pi * u[None, :], np.pi / 2 - np.pi * v[:, None])
    field = HeightField(make("fractal", 48))
    a, b = (field.irradiance(sky=s, bounces=1, azimuths=48) for s in (sky, pixels))
    np.testing.assert_allclose(a, b, rtol=2e-3)
    # A plane that leans towards the bright side receives more
    y, x = np.mgrid[:20, :20]
    lit, dark = (HeightField(-0.5 * s * (x * np.sin(1.0) - y * np.cos(1.0))).irradiance(pixels, bounces=0) for s in (1, -1))
    assert lit[10, 10] > 1.1 * dark[10, 10]


def test_threads_change_nothing():
    import numba

    field = HeightField(make("fractal", 96))
    before = numba.get_num_threads()
    try:
        out = []
        for threads in (1, before):
            numba.set_num_threads(threads)
            out.append((field.horizons(5), field.irradiance(bounces=1, azimuths=5)))
    finally:
        numba.set_num_threads(before)
    for a, b in zip(*out, strict=True):
        np.testing.assert_array_equal(a, b)
