"""What the surface sends: parts of triangles, and sharp shadows where receivers stand."""

import numpy as np
import pytest

from intervis.heightfield import HeightField, faces, pointlight
from intervis.heightfield.surface import refine

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("s", [1, 2, 3, 5])
def test_parts_of_triangles(s):
    values = RNG.uniform(size=(2, 2, 3, 4, 5)).astype(np.float32)
    parts = faces.cut(values, s)
    assert parts.shape == (2, 2, 3, 4 * s, 5 * s)
    np.testing.assert_array_equal(faces.outer(parts, s), values)
    np.testing.assert_allclose(faces.joined(parts, s), values, atol=1e-6)
    # Where grid points say what triangles have, parts are those of a finer grid
    image = RNG.uniform(size=(4, 5))
    np.testing.assert_allclose(faces.cut(faces.cornered(image), s), faces.cornered(refine(image, s)), atol=1e-12)


def test_joined_is_a_fit_to_means():
    # Of the four parts of the triangle south-west of the diagonal only that at its own corner has anything
    parts = np.zeros((2, 3, 2, 2))
    parts[0, :, 1, 0] = 1
    # Means of the fit a + b d, d the distance from the diagonal at the centroids: 1/6 (twice), 1/3, 2/3 of the way
    d, m = np.array([1 / 6, 1 / 6, 1 / 3, 2 / 3]), np.array([0, 0, 0, 1])
    b, a = np.polyfit(d, m, 1)
    np.testing.assert_allclose(faces.joined(parts, 2)[0, :, 0, 0], [a, a + b, a], atol=1e-12)
    np.testing.assert_allclose(faces.joined(parts, 2)[1], 0, atol=1e-12)


def test_triangles_that_meet():
    values = RNG.uniform(size=(3, 2, 4, 5))
    found = faces.corners(faces.meeting(values))
    np.testing.assert_array_equal(found, np.broadcast_to(values[:, :, None], found.shape))


def test_triangles_around_places():
    """A step aside from a place leads into the triangle that is told; on samples, edges and inside."""
    cells = np.array([5, 6])
    places = np.concatenate([RNG.uniform(0, cells, (300, 2)), RNG.integers(0, cells + 1, (100, 2))])
    places[:40, 0] = np.round(places[:40, 0])
    places[40:80] = np.floor(places[40:80]) + 0.25
    steps = RNG.normal(size=places.shape)
    ahead = np.clip(places + 1e-4 * steps / np.linalg.norm(steps, axis=1, keepdims=True), 0, cells)
    kind, row, column = pointlight.around(places.T, tuple(cells))
    for n, ((y, x), (v, u)) in enumerate(zip(places, ahead, strict=True)):
        q = pointlight._which(y, x, v, u, *cells)
        r, c = row[q, n], column[q, n]
        assert -1e-9 <= v - r <= 1 + 1e-9 and -1e-9 <= u - c <= 1 + 1e-9
        assert (u - c > v - r) == kind[q, n] or abs(u - c - (v - r)) < 1e-12


# --- A groove one cell deep: walls of slope 2, at its bottom only they are seen below the sky ----------------------------

GROOVE = np.full((21, 12), 2.0)
GROOVE[:, 5] = 0.0
BOTTOM = (10, 5)


def bounced(light, **options):
    """What comes from the surface after one reflection, where nothing else shines."""
    settings = {"sky": 0.0, "albedo": 0.5, "azimuths": 128, **light, **options}
    field = HeightField(GROOVE)
    return field.irradiance(**settings, bounces=1) - field.irradiance(**settings, bounces=0)


@pytest.mark.parametrize("cuts", [1, 2])
@pytest.mark.parametrize("light", [{"sun": (1.5 * np.pi, np.pi / 4, 7.0, 0.0)}, {"lamps": [(-95.0, -10.0, 101.0, 7e4)]}])
def test_the_bottom_of_a_groove_sees_its_own_shadow(light, cuts):
    """From the west at 45° light reaches the upper two thirds of a wall: at the bottom both walls are in the shadow."""
    found = bounced(light, supersampling=cuts)
    assert found[10, 4] > 0.1
    np.testing.assert_allclose(found[BOTTOM], 0, atol=1e-6)
    # So are they a fifth of the way up, for whoever stands there
    found = bounced(light, supersampling=cuts, points=[BOTTOM, (10.0, 5.2), (10.3, 5.1)])
    np.testing.assert_allclose(found, 0, atol=1e-6)


@pytest.mark.parametrize("cuts", [1, 2])
def test_the_bottom_of_a_groove_in_the_sun(cuts):
    """Under a vertical sun both walls send ρ w / (√5 π) and fill the 1 − 1 / √5 of the sky that they hide."""
    light = {"sun": (0.0, np.pi / 2, 7.0, 0.0)}
    expected = 0.5 * 7.0 / np.sqrt(5) * (1 - 1 / np.sqrt(5))
    np.testing.assert_allclose(bounced(light, supersampling=cuts)[BOTTOM], expected, rtol=2e-3)
    np.testing.assert_allclose(bounced(light, supersampling=cuts, points=[BOTTOM]), expected, rtol=2e-3)
