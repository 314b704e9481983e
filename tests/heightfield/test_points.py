"""Chosen receivers, lamps and tiles: the same answers as the sweeps, and as Mitsuba."""

import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError
from intervis.heightfield import HeightField, tiles
from intervis.heightfield.fields import make
from intervis.heightfield.surface import normals


@pytest.fixture(scope="module")
def field():
    return HeightField(make("fractal", 48, seed=1), spacing=(1.0, 1.3))


def test_points_see_what_sweeps_see(field):
    azimuths = np.array([0.0, 0.3, np.pi / 4, 2.2, np.pi, 4.0, 5.9])
    everywhere = np.ones(field.heights.shape, dtype=bool)
    at_points = field.horizons(azimuths, points=everywhere).reshape(len(azimuths), *field.heights.shape)
    np.testing.assert_allclose(at_points, field.horizons(azimuths, method="march"), atol=3e-6)
    view = field.sky_view(16, points=everywhere).reshape(field.heights.shape)
    np.testing.assert_allclose(view, field.sky_view(16, method="march"), atol=1e-6)


@pytest.mark.parametrize("spacing", [(1.0, 1.3), (0.1, 0.1)])
@pytest.mark.parametrize("radius", [0.05, 0.3, 0.5, 1.0, 2**0.5, 3.3, 1e30])
def test_points_look_as_far_as_sweeps(spacing, radius):
    """To the radius, exactly, and what is just so far away is seen: 0.3 / 0.1 is less than 3 in floating point."""
    field = HeightField(make("fractal", 24, seed=2), spacing, radius=radius)
    everywhere = np.ones(field.heights.shape, dtype=bool)
    azimuths = np.array([0.0, 0.3, np.pi / 4, np.pi / 2, 2.2, 5.9])
    at_points = field.horizons(azimuths, points=everywhere).reshape(len(azimuths), *field.heights.shape)
    for method in ("auto", "march"):
        np.testing.assert_allclose(field.horizons(azimuths, method=method), at_points, atol=1e-5)
    light = {"sky": 0.2, "emission": 1.0, "bounces": 1, "azimuths": 12}
    e = field.irradiance(**light, points=everywhere)
    np.testing.assert_allclose(field.irradiance(**light).reshape(e.shape), e, rtol=1e-5)


def test_a_step_is_seen_from_just_as_far_as_the_radius():
    h = np.zeros((1, 8))
    h[0, 7] = 1.0
    found = HeightField(h, 0.1, radius=0.3).horizons([np.pi / 2])[0, 0]
    np.testing.assert_allclose(found[:7], [0, 0, 0, 0, np.arctan(1 / 0.3), np.arctan(5), np.arctan(10)], atol=1e-6)


def test_points_between_samples_of_a_ramp():
    """On a ramp that rises 1 : 4 to the east the horizon is its slope from anywhere."""
    ramp = HeightField(np.tile(np.arange(20.0), (20, 1)), spacing=4.0)
    found = ramp.horizons([np.pi / 2, 0.0], points=[[3.5, 2.25], [7.0, 11.9]])
    np.testing.assert_allclose(found[0], np.arctan(0.25), atol=1e-6)
    np.testing.assert_allclose(found[1], 0, atol=1e-6)


def test_points_beside_unknown_heights_are_unknown():
    h = np.zeros((5, 5))
    h[2, 2] = np.nan
    found = HeightField(h).horizons(4, points=[[1.5, 1.5], [0.0, 0.0], [1.0, 2.0]])
    assert np.isnan(found[:, 0]).all()
    assert np.isfinite(found[:, 1:]).all()


@pytest.mark.parametrize("points", [[[0, 50.0]], [[-0.1, 0]], [1, 2], np.ones((3, 3), bool), [["a", "b"]], [[np.nan, 0]]])
def test_points_refused(field, points):
    with pytest.raises(InputError, match="'points'"):
        field.horizons(4, points=points)


def test_a_lamp_lights_what_mitsuba_says(variant_llvm, field):
    """Shadow and irradiance of a point light equal those of Mitsuba's, whose rays meet the same triangles."""
    lamp = (30.0, -20.0, field.heights.max() + 4.0, 900.0)
    found = field.irradiance(sky=0.0, albedo=0.0, bounces=0, azimuths=1, lamps=[lamp])[..., 0]
    scene = mi.load_dict({"type": "scene", "terrain": field.to_mitsuba()})
    n = np.moveaxis(normals(field.heights, field.spacing), 0, -1).reshape(-1, 3)
    i, j = np.indices(field.heights.shape)
    p = np.stack([j * 1.3, -i * 1.0, field.heights - field.centre], -1).reshape(-1, 3)
    to = np.array([lamp[0], lamp[1], lamp[2] - field.centre]) - p
    distance = np.linalg.norm(to, axis=1)
    w = to / distance[:, None]
    # From a little above the surface, all the way to the lamp
    start = p + np.array([0, 0, 1e-3])
    ray = mi.Ray3f(mi.Point3f(*start.T.astype(np.float32)), mi.Vector3f(*w.T.astype(np.float32)))
    ray.maxt = mi.Float(distance.astype(np.float32))
    lit = ~np.array(scene.ray_test(ray))
    expected = (lamp[3] * lit * np.maximum((w * n).sum(1), 0) / distance**2).reshape(found.shape)
    # Grazing rays may fall either way
    assert (np.abs(found - expected) > 1e-4 * expected.max()).mean() < 0.01
    assert 0.1 < (found > 0).mean() < 0.95


def test_a_lamp_close_to_the_ground():
    """What triangles get from a lamp is not what their centroids get: light bounced off a groove is that of a fine one's."""
    field = HeightField(np.abs(np.arange(24) - 11.5) * np.ones((24, 1)))
    options = dict(sky=0.0, albedo=0.5, azimuths=32, lamps=[(11.5, -11.5, 3.0, 100.0)])
    direct = field.irradiance(bounces=0, **options)
    coarse, fine = (field.irradiance(bounces=1, supersampling=s, **options) - direct for s in (1, 4))
    assert np.abs(coarse - fine).mean() < 0.01 * fine.mean()


@pytest.mark.parametrize("lamps", ["x", [(1, 2, 3)], [(1, 2, np.nan, 4)], [(1, 2, 3, -4)], [(1, 2, 3, [])]])
def test_lamps_refused(field, lamps):
    with pytest.raises(InputError, match="lamps"):
        field.irradiance(bounces=0, azimuths=1, lamps=lamps)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2, 0.1])
def test_tolerance_is_kept(field, tolerance):
    """What a bounce leaves out stays below the tolerance, and nothing is added."""
    settings = {"sky": 1.0, "albedo": 0.8, "bounces": 1, "azimuths": 16}
    exact, fast = field.irradiance(**settings), field.irradiance(**settings, tolerance=tolerance)
    greatest = 0.8 * field.irradiance(**{**settings, "bounces": 0}).max() / np.pi
    assert (exact - fast).max() <= tolerance * np.pi * greatest
    assert (exact - fast).min() > -1e-6
    assert tolerance < 0.1 or (exact - fast).max() > 0


def test_tiles_equal_the_whole():
    h = make("fractal", 70, seed=4)
    whole = HeightField(h, (2.0, 1.5), radius=18.0)
    view, light = np.full(h.shape, np.nan), np.full(h.shape, np.nan)
    count = 0
    for window, tile, inner in tiles(h, (2.0, 1.5), radius=18.0, size=32):
        view[window] = tile.sky_view(12)[inner]
        light[window] = tile.irradiance(bounces=0, azimuths=12)[inner][..., 0]
        count += 1
    assert count == 9
    np.testing.assert_allclose(view, whole.sky_view(12), atol=2e-6)
    np.testing.assert_allclose(light, whole.irradiance(bounces=0, azimuths=12)[..., 0], atol=1e-5)


def test_tiles_that_light_reaches_after_bounces():
    h = 4 * make("random", 60, seed=4)
    light = dict(sky=1.0, sun=(1.0, 0.6, 3.0), albedo=0.8, bounces=2, azimuths=8)
    whole, found = HeightField(h, radius=3.0).irradiance(**light), np.full((60, 60, 1), np.nan)
    narrow = found.copy()
    for bounces, out in ((2, found), (0, narrow)):
        for window, tile, inner in tiles(h, radius=3.0, size=30, bounces=bounces):
            out[window] = tile.irradiance(**light)[inner]
    np.testing.assert_allclose(found, whole, rtol=1e-5)
    assert np.abs(narrow / whole - 1).max() > 1e-4


def test_tiles_know_what_is_masked_and_leave_out_what_is_unknown():
    h = np.ma.masked_less(np.arange(40.0) * np.ones((20, 1)), 25)
    (window, tile, _), = tiles(h, radius=2.0, size=20)
    assert window[1] == slice(20, 40) and (~tile.valid).sum() == tile.valid.size - 20 * 15
    (window, *_), = tiles(np.asarray(h) // 25, radius=2.0, size=20, nodata=0)
    assert window[1] == slice(20, 40)
    with pytest.raises(InputError, match="at least one known height"):
        next(tiles(np.full((9, 9), np.nan), radius=2.0, size=3))


def test_tiles_read_a_memory_map_piece_by_piece(tmp_path):
    path = tmp_path / "dem.npy"
    np.save(path, make("sine", 40).astype(np.float32))
    h = np.load(path, mmap_mode="r")
    (window, tile, inner), *rest = tiles(h, radius=4.0, size=20)
    assert window == (slice(0, 20), slice(0, 20)) and inner == window and len(rest) == 3
    assert tile.heights.shape == (26, 26)


@pytest.mark.parametrize(
    "settings", [{"radius": 0}, {"radius": 5, "size": 0}, {"radius": 5, "spacing": -1}, {"radius": 5, "bounces": -1}]
)
def test_tiles_refused(settings):
    with pytest.raises(InputError):
        next(tiles(np.zeros((4, 4)), **settings))
