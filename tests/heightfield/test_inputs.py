"""What the methods take and refuse, and fields at the edge of what a field can be."""

import numpy as np
import pytest

from intervis import InputError
from intervis.heightfield import FIELDS, HeightField, make


def results(heights, spacing=1.0, azimuths=5, **options):
    """Run every method; check shapes, types and ranges; return the field and its irradiance."""
    field = HeightField(heights, spacing, **options)
    shape, known = field.heights.shape, field.valid
    horizons, march = field.horizons(azimuths), field.horizons(azimuths, method="march")
    assert horizons.dtype == np.float32 and horizons.shape[1:] == shape
    assert (np.isfinite(horizons) == known).all() and np.abs(horizons[:, known]).max() <= np.float32(np.pi / 2)
    # What hulls find lies on the surface, so it never exceeds what is there
    assert (horizons[:, known] <= march[:, known] + 1e-4).all()
    for weighting in ("cosine", "solid_angle"):
        share = field.sky_view(azimuths, weighting=weighting)
        assert (np.isfinite(share) == known).all() and share[known].min() >= 0 and share[known].max() <= 1
    lit = field.shadow(1.0, 0.5)
    assert lit[known].min() >= 0 and lit[known].max() <= 1
    offsets, distances, angles = field.intervisibility(0.7)
    assert offsets.shape == (known.size + 1,) and offsets[0] == 0 and (np.diff(offsets) >= 0).all()
    assert len(distances) == len(angles) == offsets[-1] and (distances > 0).all()
    e = field.irradiance(sun=(1.0, 0.5, 100.0), azimuths=azimuths, bounces=1)
    assert e.shape == (*shape, 1) and e.dtype == np.float32
    assert (np.isfinite(e[..., 0]) == known).all() and e[known].min() >= 0
    return field, e


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 40), (40, 1), (2, 40), (3, 3)])
def test_thin_fields(shape):
    results(np.random.default_rng(0).normal(size=shape))


@pytest.mark.parametrize("spacing", [1e-12, 1e-3, 1e4, 1e9, (1e-3, 1e4), (1e4, 1e-3), (1, 7.3)])
def test_spacings(spacing):
    results(make("fractal", 24), spacing)


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e-3, 1e4, 5e8])
def test_shape_matters_and_size_does_not(scale):
    """Heights and spacing scaled alike give the same angles and the same light, on the grid and at points."""
    h = make("fractal", 32)
    a, b = HeightField(h, (1.0, 2.0)), HeightField(h * scale, (scale, 2 * scale))
    points = [[0.5, 0.25], [20.0, 30.75]]
    np.testing.assert_allclose(b.horizons(7, method="march"), a.horizons(7, method="march"), atol=2e-5)
    np.testing.assert_allclose(b.horizons(7, points=points), a.horizons(7, points=points), atol=1e-6)
    light = {"sky": 0.3, "sun": (1.0, 0.5, 2.0), "albedo": 0.5, "azimuths": 16}
    np.testing.assert_allclose(b.irradiance(**light), a.irradiance(**light), rtol=2e-4)
    np.testing.assert_allclose(b.irradiance(**light, points=points), a.irradiance(**light, points=points), rtol=2e-4)
    lamp = np.array([20.0, -20.0, h.max() + 9.0, 100.0])
    e, f = (x.irradiance(0.0, lamps=[lamp * s], azimuths=8) for x, s in ((a, [1, 1, 1, 1]), (b, [scale] * 3 + [scale**2])))
    np.testing.assert_allclose(f, e, rtol=2e-4, atol=1e-6)


def test_fine_cells_at_8000_metres_lose_nothing():
    h = 0.01 * make("random", 32)
    low, high = (HeightField(h + z, 0.25).horizons(9, method="march") for z in (0.0, 8000.0))
    np.testing.assert_allclose(low, high, atol=1e-6)


def test_all_equal_is_open_sky():
    field, e = results(np.full((20, 20), 5.0))
    np.testing.assert_allclose(field.sky_view(8), 1, atol=1e-6)
    np.testing.assert_allclose(e, np.pi + 100 * np.sin(0.5), rtol=1e-5)


def test_cliffs_of_a_million_metres():
    h = np.zeros((30, 30))
    h[:, 15:] = 1e6
    field, _ = results(h)
    east = field.horizons([np.pi / 2])[0]
    np.testing.assert_allclose(east[:, :15], np.pi / 2, atol=1e-4)
    np.testing.assert_allclose(east[:, 15:29], 0, atol=1e-6)


@pytest.mark.parametrize("policy", ["block", "transparent", "fill"])
def test_unknown_points(policy):
    h = make("fractal", 48)
    known = np.ones(h.shape, bool)
    for where, value in ((np.s_[3:8, 3:9], np.nan), (np.s_[20, 20], np.inf), (np.s_[0, 0], -np.inf)):
        h[where], known[where] = value, False
    field, e = results(h, nodata_policy=policy)
    assert (field.valid == known).all()
    # The same by a number that means unknown, and by a mask
    for other, options in (
        (np.where(known, h, -9999.0), {"nodata": -9999}),
        (np.ma.array(np.where(known, h, 0), mask=~known), {}),
    ):
        np.testing.assert_array_equal(results(other, nodata_policy=policy, **options)[1], e)


def test_what_is_no_height_is_unknown():
    """Rasters without a nodata tag are full of −3.4e38 and the like."""
    h = np.zeros((6, 7), np.float32)
    h[1, 2], h[3, 3], h[4, 4] = np.finfo(np.float32).min, 1e20, -1e6
    field = HeightField(h)
    assert (~field.valid).sum() == 2 and field.heights[4, 4] == -1e6 and field.heights[1, 2] == 0
    with pytest.raises(InputError, match="at least one known height"):
        HeightField(np.full((3, 3), 1e300))


def test_policies_differ_behind_unknown_points():
    h = np.zeros((5, 40))
    h[:, 30] = np.nan
    east = {p: HeightField(h, nodata_policy=p).horizons([np.pi / 2])[0, 2] for p in ("block", "transparent", "fill")}
    assert east["block"][10] > 1.5 and abs(east["transparent"][10]) < 1e-6 and abs(east["fill"][10]) < 1e-6
    # Transparent means that light passes: the plain around the gap stays lit by all of the sky
    np.testing.assert_allclose(HeightField(h, nodata_policy="transparent").sky_view(16)[:, :30], 1, atol=1e-6)


@pytest.mark.parametrize("azimuths", [1, 3, 7, np.int64(4), [0.1, 0.1, 0.1], np.array([9.0, 0, -2]), [[0, 1], [2, 3]]])
def test_azimuths(azimuths):
    results(make("fractal", 10), azimuths=azimuths)


def test_a_thousand_azimuths():
    field = HeightField(make("fractal", 10))
    assert field.horizons(1000).shape == (1000, 10, 10)
    np.testing.assert_allclose(field.sky_view(1000), field.sky_view(100), atol=0.02)
    np.testing.assert_allclose(*(field.irradiance(bounces=0, azimuths=k) for k in (1000, 100)), rtol=0.02)


def test_duplicate_and_wrapped_azimuths_are_the_same():
    a, b, c = HeightField(make("fractal", 40)).horizons([0.6, 0.6, 0.6 + 2 * np.pi])
    np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(a, c, atol=1e-5)


def kinds():
    h = np.round(make("fractal", 24) * 10)
    frozen = h.copy()
    frozen.setflags(write=False)
    wide = np.zeros((48, 72))
    wide[::2, ::3] = h
    return {
        "int": h.astype(int),
        "int16, big endian": h.astype(">i2"),
        "float32": h.astype(np.float32),
        "float64, big endian": h.astype(">f8"),
        "Fortran": np.asfortranarray(h),
        "read only": frozen,
        "strided": wide[::2, ::3],
        "reversed twice": h[::-1].copy()[::-1],
        "list": h.tolist(),
    }


@pytest.mark.parametrize("kind", list(kinds()))
def test_arrays_of_any_kind(kind):
    expected = results(np.round(make("fractal", 24) * 10))[1]
    given = kinds()[kind]
    before = np.array(given)
    np.testing.assert_array_equal(results(given)[1], expected)
    np.testing.assert_array_equal(given, before)


def test_unsigned_bytes_do_not_wrap():
    h = np.full((9, 9), 10, np.uint8)
    h[4, 8] = 5
    field = HeightField(h)
    assert field.horizons([np.pi / 2], method="march")[0, 4, 7] == pytest.approx(np.arctan(-5.0))


@pytest.mark.parametrize("name", list(FIELDS))
def test_procedural_fields(name):
    a, b = make(name, 32, seed=4), make(name, 32, seed=4)
    np.testing.assert_array_equal(a, b)
    assert a.shape == (32, 32) and np.isfinite(a).all() and np.ptp(a) > 0
    if name in ("fractal", "brick", "blocks", "random"):
        assert (make(name, 32, seed=5) != a).any()
    # Even where there is hardly room for anything
    for size in (1, 2, 3):
        assert make(name, size).shape == (size, size) and np.isfinite(make(name, size)).all()


FIELD = {"heights": np.zeros((8, 8))}
REFUSED = [
    ({"heights": "abc"}, "heights"),
    ({"heights": None}, "heights"),
    ({"heights": np.zeros(3)}, "heights"),
    ({"heights": np.zeros((2, 2, 2))}, "heights"),
    ({"heights": np.zeros((0, 3))}, "heights"),
    ({"heights": np.zeros((3, 3), complex)}, "heights"),
    ({"heights": [[1, 2], [3]]}, "heights"),
    ({"heights": np.full((3, 3), np.nan)}, "heights"),
    *[({**FIELD, "spacing": s}, "spacing") for s in (0, -1, np.nan, np.inf, "a", None, (1, 2, 3), (0, 1), [[1], [2, 3]])],
    ({**FIELD, "nodata": "x"}, "nodata"),
    ({**FIELD, "nodata_policy": "ignore"}, "nodata_policy"),
    ({**FIELD, "curvature": 2}, "curvature"),
    ({**FIELD, "curvature": "x"}, "curvature"),
    ({**FIELD, "radius": 0}, "radius"),
    ({**FIELD, "radius": "far"}, "radius"),
]


@pytest.mark.parametrize("arguments, name", REFUSED)
def test_fields_refused(arguments, name):
    with pytest.raises(InputError, match=f"'{name}'"):
        HeightField(**arguments)


CALLS = [
    *[
        ("horizons", {"azimuths": k}, "azimuths")
        for k in (0, -1, 2.5, "72", None, True, [], [np.nan], np.nan, np.inf, 1j, 10**12, "ab", ["a"])
    ],
    ("horizons", {"method": "magic"}, "method"),
    ("sky_view", {"weighting": "sine"}, "weighting"),
    ("shadow", {"azimuth": "a", "elevation": 1}, "azimuth"),
    ("shadow", {"azimuth": 0, "elevation": 2}, "elevation"),
    ("shadow", {"azimuth": 0, "elevation": 1, "radius": -1}, "radius"),
    ("intervisibility", {"azimuth": np.nan}, "azimuth"),
    ("intervisibility", {"azimuth": [1, 2]}, "azimuth"),
    *[("irradiance", {"albedo": a}, "albedo") for a in (-0.1, 1.1, np.nan, "x", np.zeros((7, 8)))],
    *[("irradiance", {"sky": s}, "sky") for s in (-1, np.nan, "a", np.zeros((3, 4)), [], np.zeros((0, 4, 3)))],
    ("irradiance", {"sky": lambda az, el: np.zeros(3)}, "sky"),
    ("irradiance", {"sky": lambda az, el: "blue"}, "sky"),
    ("irradiance", {"sky": [1, 2], "albedo": [0.1, 0.2, 0.3]}, "sky"),
    *[("irradiance", {"sun": s}, "sun") for s in (5, (1, 2), "abc")],
    *[("irradiance", {"sun": s}, "sun") for s in ((1, 5, 3), ("a", 0.5, 3), (1, 0.5, -3), (1, 0.5, "x"))],
    ("irradiance", {"emission": -1}, "emission"),
    *[("irradiance", {"bounces": b}, "bounces") for b in (-1, 1.5, "a", None)],
    ("irradiance", {"method": None}, "method"),
    ("to_mitsuba", {"path": "/nowhere/at/all.ply"}, None),
]


@pytest.mark.parametrize("method, arguments, name", CALLS)
def test_calls_refused(method, arguments, name):
    field = HeightField(np.random.default_rng(0).uniform(size=(8, 8)))
    with pytest.raises(InputError, match=f"'{name}[' ]" if name else None) as caught:
        getattr(field, method)(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 1)])
def test_no_mesh_without_a_triangle(shape):
    with pytest.raises(InputError, match="triangle"):
        HeightField(np.zeros(shape)).to_mitsuba()


def test_albedo_of_nought_and_one():
    field = HeightField(make("bowl", 24))
    direct = field.irradiance(albedo=0.3, bounces=0, azimuths=8)
    np.testing.assert_array_equal(field.irradiance(albedo=0, bounces=3, azimuths=8), direct)
    white = field.irradiance(albedo=1, bounces=3, azimuths=8)
    assert (white >= direct).all() and white.max() > 1.2 * direct.min()


def test_interrupted():
    """Whoever watches the progress may stop it; nothing is left behind in the field."""
    field = HeightField(make("fractal", 24))
    expected = field.horizons(6)

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    for method in (field.horizons, field.sky_view, field.irradiance):
        with pytest.raises(KeyboardInterrupt):
            method(azimuths=6, progress=stop)
    np.testing.assert_array_equal(field.horizons(6), expected)


def test_progress_counts_to_its_total():
    seen = []
    HeightField(make("sine", 16)).irradiance(emission=1.0, bounces=2, azimuths=4, progress=lambda *p: seen.append(p))
    assert [s[0] for s in seen] == list(range(1, seen[-1][1] + 1))


def test_a_report_of_every_method():
    h = np.zeros((8, 8))
    h[0, :3] = np.nan
    field = HeightField(h)
    field.horizons(3)
    assert field.report.wall_s > 0 and field.report.skipped["points without data"] == 3
