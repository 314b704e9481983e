"""The sky: an environment map lies over a field as Mitsuba's ``envmap`` does, and a function lies as its map does."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.cli import main
from intervis.heightfield import HeightField, make
from intervis.heightfield.surface import normals
from intervis.images import read_exr, write_exr

ROWS, COLUMNS = 32, 64
AZIMUTHS = np.arange(8) * 45.0  # degrees
ELEVATIONS = (20.0, 60.0)


def patch(azimuth, elevation):
    """Return a dim map with a bright patch, 22.5° wide and 11° high, around a direction in degrees."""
    v, u = (np.arange(ROWS) + 0.5) / ROWS, (np.arange(COLUMNS) + 0.5) / COLUMNS
    away = (360 * u - azimuth + 180) % 360 - 180
    bright = (np.abs(away)[None, :] < 11.3) & (np.abs(90 - 180 * v - elevation)[:, None] < 6)
    assert bright.sum() in (8, 12)
    return np.where(bright, 50.0, 0.1)[..., None].astype(np.float32)


def turned(pixels):
    """Return Mitsuba's ``envmap``, turned as `HeightField.irradiance` documents."""
    bitmap = mi.Bitmap(np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels)
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90)}


def traced(field, pixels, samples=1024):
    """Direct irradiance of every point, from samples of the emitter and shadow rays; means and standard errors."""
    scene = mi.load_dict({"type": "scene", "terrain": field.to_mitsuba(), "sky": turned(pixels)})
    y, x = np.mgrid[: field.heights.shape[0], : field.heights.shape[1]]
    n = normals(field.heights, field.spacing).reshape(3, -1)
    lift = 1e-4 * min(field.spacing)
    place = np.stack([x * field.spacing[1], -y * field.spacing[0], field.heights - field.centre + lift]).reshape(3, -1)
    lane = dr.arange(mi.UInt32, x.size * samples) // samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, x.size * samples)
    si = dr.zeros(mi.SurfaceInteraction3f, x.size * samples)
    si.p = dr.gather(mi.Point3f, mi.Point3f(place.astype(np.float32)), lane)
    si.n = dr.gather(mi.Normal3f, mi.Normal3f(n.astype(np.float32)), lane)
    ds, weight = scene.sample_emitter_direction(si, sampler.next_2d(), test_visibility=False)
    hidden = scene.ray_test(mi.Ray3f(si.p, ds.d))
    value = dr.select(hidden, 0, weight.x * dr.maximum(dr.dot(ds.d, si.n), 0))
    value = np.array(value, dtype=np.float64).reshape(*x.shape, samples)
    return value.mean(-1), value.std(-1) / np.sqrt(samples)


def surfaces():
    y, x = np.mgrid[:12, :14]
    return {
        "plane": HeightField(np.zeros((12, 14)), (2.0, 1.0)),
        "ramp": HeightField(0.5 * (x * np.sin(1.0) - 2.0 * y * -np.cos(1.0)), (2.0, 1.0)),
        "fractal": HeightField(3 * make("fractal", 16, seed=2)),
    }


@pytest.mark.parametrize("name", list(surfaces()))
def test_a_map_lies_as_in_mitsuba(variant_llvm, name):
    """A bright patch in each of 8 azimuths and 2 elevations lights the same sides."""
    field = surfaces()[name]
    for azimuth in AZIMUTHS:
        for elevation in ELEVATIONS:
            pixels = patch(azimuth, elevation)
            found = field.irradiance(pixels, bounces=0, azimuths=64)[..., 0]
            expected, error = traced(field, pixels)
            where = f"azimuth {azimuth}, elevation {elevation}"
            # Five standard errors, and what the sectors leave
            spread = np.sqrt(np.sum(error**2)) / error.size
            assert abs(found.mean() - expected.mean()) < 5 * spread + 2e-3 * expected.mean(), where
            assert (np.abs(found - expected) < 6 * error + 0.02 * expected.mean()).all(), where


def test_a_function_equals_its_map(variant_llvm):
    """Mitsuba's emitter, asked direction by direction, is a function that gives the same light as the map given whole."""
    pixels = np.random.default_rng(5).uniform(size=(8, 16, 3)).astype(np.float32) ** 2
    emitter = mi.load_dict(turned(pixels))

    def sky(azimuth, elevation):
        d = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
        si = dr.zeros(mi.SurfaceInteraction3f, len(azimuth))
        si.wi = mi.Vector3f(*(mi.Float(-np.asarray(x, dtype=np.float32)) for x in d))
        return np.array(emitter.eval(si)).reshape(3, -1).T

    field = HeightField(3 * make("fractal", 16, seed=2))
    a, b = (field.irradiance(s, bounces=1, azimuths=64) for s in (sky, pixels))
    assert a.shape == (16, 16, 3) and a[..., 0].mean() != pytest.approx(a[..., 2].mean(), rel=1e-3)
    np.testing.assert_allclose(a, b, rtol=2e-3)


def test_energy_of_a_small_sun_in_a_large_map_is_kept():
    """One pixel in 4096 rows, smaller than any step of the table: the plane receives its radiance times solid angle."""
    rows, columns = 4096, 512
    pixels = np.zeros((rows, columns, 1), np.float32)
    at = np.pi * 1000 / (rows - 1)  # from the zenith
    pixels[1000, 100] = 1e6
    expected = 1e6 * np.cos(at) * np.sin(at) * (np.pi / (rows - 1)) * (2 * np.pi / columns)
    found = HeightField(np.zeros((3, 3))).irradiance(pixels, bounces=0, azimuths=64)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_tiny_maps(shape):
    found = HeightField(np.zeros((3, 3))).irradiance(np.full((*shape, 1), 2.0), bounces=0, azimuths=5)
    np.testing.assert_allclose(found, 2 * np.pi, rtol=1e-5)


def test_the_command_line_takes_a_map(tmp_path, capsys):
    pixels = np.repeat(patch(90.0, 20.0), 3, axis=2) * np.array([1, 2, 3], np.float32)
    write_exr(tmp_path / "sky.exr", {"rgb": pixels})
    heights = surfaces()["ramp"].heights
    np.savez(tmp_path / "ramp.npz", heights=heights, spacing=(2.0, 1.0))
    out = tmp_path / "out.exr"
    options = ["--sky", tmp_path / "sky.exr", "-o", out, "--azimuths", 16, "--bounces", 1]
    assert main([str(w) for w in ("heightfield", tmp_path / "ramp.npz", *options)]) == 0
    found = read_exr(out)[0]["irradiance"]
    expected = HeightField(heights, (2.0, 1.0)).irradiance(pixels, bounces=1, azimuths=16)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    np.testing.assert_allclose(found[..., 2], 3 * found[..., 0], rtol=1e-4)
