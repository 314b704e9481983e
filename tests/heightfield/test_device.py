"""Kernels for GPUs find what those for CPUs find: run by LLVM everywhere, by CUDA where there is one."""

import drjit as dr
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from intervis.heightfield import HeightField, device, make, skip
from intervis.heightfield.sweep import direction

CUDA = pytest.mark.skipif(not dr.has_backend(dr.JitBackend.CUDA), reason="no GPU that CUDA runs on")
BACKENDS = ["llvm", pytest.param("cuda", marks=CUDA)]
MIXED = [0.3, 1.1, 2.0, 2.9, 3.7, 5.9, *np.arange(4) * np.pi / 2, np.pi / 4, 7 * np.pi / 4]


def both(monkeypatch, backend, compute):
    """What a function returns on CPUs, then on a backend of Dr.Jit."""
    with monkeypatch.context() as patch:
        patch.setattr(device, "chosen", lambda shape: None)
        expected = compute()
        patch.setattr(device, "chosen", lambda shape: backend)
        return expected, compute()


def rough(shape, seed=0, scale=3.0):
    return np.random.default_rng(seed).normal(0, scale, shape)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("azimuth", [0.0, 0.3, 1.9, 2.5, np.pi / 4, 5.1])
@pytest.mark.parametrize("s", [1, 2])
def test_stretches_are_as_high(backend, azimuth, s):
    d = direction(azimuth, (1, 1))
    laid = np.stack([skip.lay(rough((70, 600), n), d)[0] for n in range(s * s)])
    (tops, begins), (found, starts) = skip.stretches(laid, d, s), device.stretches(device.put(laid, backend), d, s)
    np.testing.assert_array_equal(starts, begins)
    np.testing.assert_allclose(found.numpy(), tops, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@given(
    rows=st.integers(1, 60),
    columns=st.integers(1, 60),
    azimuth=st.floats(0, 6.28),
    power=st.floats(0.2, 8),
    radius=st.one_of(st.none(), st.floats(1, 60)),
    curvature=st.booleans(),
    seed=st.integers(0, 1000),
)
@example(rows=1, columns=600, azimuth=np.pi / 2, power=1.0, radius=None, curvature=False, seed=0)
@example(rows=600, columns=7, azimuth=0.01, power=8.0, radius=None, curvature=True, seed=0)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_horizons_of_any_field(monkeypatch, backend, rows, columns, azimuth, power, radius, curvature, seed):
    heights = np.abs(rough((rows, columns), seed, 1.0)) ** power
    hf = HeightField(heights, (1.0, 1.3), radius=radius, curvature=curvature)
    expected, found = both(monkeypatch, backend, lambda: hf.horizons([azimuth]))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 + 2e-7 * heights.max())


@pytest.mark.parametrize("backend", BACKENDS)
def test_looks_at_little_of_a_landscape(monkeypatch, backend):
    hf = HeightField(make("fractal", 256), 30.0)

    def looked():
        hf.horizons(8)
        return hf.tally.looked

    expected, found = both(monkeypatch, backend, looked)
    assert 0 < found < 1.2 * expected


@pytest.mark.parametrize("backend", BACKENDS)
def test_sky_view_and_shadow(monkeypatch, backend):
    heights = make("blocks", 90)
    heights[4:7, 50:60] = np.nan
    hf = HeightField(heights, (2.0, 1.0))
    for compute in (lambda: hf.sky_view(9), lambda: hf.shadow(2.0, 0.3), lambda: hf.horizons([0.3, 0.3, 3.0])):
        expected, found = both(monkeypatch, backend, compute)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def sky(azimuths, elevations):
    return np.stack([1 + np.sin(elevations), 2 + np.cos(azimuths) + 0 * elevations], -1)


LIGHT = {
    "the surface alone": dict(sky=0.0, glows=True, albedo=0.0, bounces=0),
    "an even sky": dict(sky=2.0, albedo=0.5, bounces=2),
    "three channels": dict(sky=[1.0, 2.0, 3.0], sun=(1.0, 0.5, 3.0), albedo=0.5, bounces=1),
    "an uneven sky": dict(sky=sky, glows=True, albedo=0.5, bounces=1),
    "supersampling": dict(sky=sky, sun=(4.0, 0.3, 3.0), glows=True, albedo=0.5, bounces=1, supersampling=2),
    "hulls": dict(sky=1.0, albedo=0.5, bounces=1, method="tree"),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["fractal", "blocks"])
@pytest.mark.parametrize("light", LIGHT)
def test_irradiance(monkeypatch, backend, name, light):
    heights, options = make(name, 40), dict(LIGHT[light])
    glow = np.random.default_rng(1).uniform(size=heights.shape) ** 2
    options["emission"] = glow if options.pop("glows", False) else None
    hf = HeightField(heights, (1.0, 1.3))
    expected, found = both(monkeypatch, backend, lambda: hf.irradiance(**options, azimuths=MIXED))
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=3e-6 * expected.max())


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("options", [dict(curvature=True), dict(radius=9.0), dict(nodata_policy="block")], ids=str)
@pytest.mark.parametrize("shape", [(33, 20), (3, 70), (2, 2), (1, 30), (30, 1), (1, 1)])
def test_light_of_odd_fields(monkeypatch, backend, options, shape):
    heights = rough(shape)
    heights[0, 0] = heights[0, 0] if shape == (1, 1) else np.nan
    hf = HeightField(heights, (1.0, 1.3), **options)
    expected, found = both(monkeypatch, backend, lambda: hf.irradiance(sky=1.0, albedo=0.5, bounces=1, azimuths=MIXED))
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=3e-6 * np.nanmax(expected))


@pytest.mark.parametrize("backend", BACKENDS)
def test_sparse_azimuths(monkeypatch, backend):
    hf = HeightField(make("fractal", 40))
    options = dict(sky=1.0, albedo=0.5, bounces=1, azimuths=32, sparse=2)
    expected, found = both(monkeypatch, backend, lambda: hf.irradiance(**options))
    np.testing.assert_allclose(found, expected, rtol=2e-5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_tolerance_keeps_its_promise(monkeypatch, backend):
    """Each thread ends by itself: not where sixteen rays end together, but as little is left out."""
    hf = HeightField(make("fractal", 64))
    glow = np.random.default_rng(1).uniform(size=(64, 64)) ** 2
    options = dict(sky=0.0, emission=glow, albedo=0.001, bounces=1, azimuths=8)
    monkeypatch.setattr(device, "chosen", lambda shape: backend)
    exact, some = hf.irradiance(**options), hf.irradiance(**options, tolerance=0.02)
    assert (exact - some).max() > 1e-4 and (exact - some).max() < 0.02 * np.pi * glow.max() and (exact - some).min() > -1e-6


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_is_read_beyond_the_field(monkeypatch, capfd, backend):
    """Dr.Jit's debug mode reports reads out of bounds, which otherwise pass unseen."""
    monkeypatch.setattr(device, "chosen", lambda shape: backend)
    debug = dr.flag(dr.JitFlag.Debug)
    dr.set_flag(dr.JitFlag.Debug, True)
    try:
        hf = HeightField(rough((13, 20)), (1.0, 1.3))
        hf.horizons(MIXED)
        hf.irradiance(sky=1.0, sun=(1.0, 0.5, 3.0), albedo=0.5, bounces=1, azimuths=MIXED[::3])
        dr.sync_thread()
    finally:
        dr.set_flag(dr.JitFlag.Debug, debug)
    assert "out-of-bounds" not in "".join(capfd.readouterr())


def test_large_fields_go_to_a_gpu(monkeypatch):
    for there in (True, False):
        monkeypatch.setattr(dr, "has_backend", lambda backend, there=there: there and backend == dr.JitBackend.CUDA)
        assert device.chosen((2000, 2000)) == ("cuda" if there else None)
        assert device.chosen((100, 100)) is None and device.chosen((40_000, 40_000)) is None
