"""Horizons, sky view and shadow: closed forms, then brute force in float64 on the stated surface."""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import drjit as dr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intervis.heightfield import HeightField, make


def surface(h, y, x):
    """Height of the triangulated grid (diagonals from north-west to south-east) at fractional rows and columns."""
    r = np.clip(np.floor(y).astype(int), 0, h.shape[0] - 2)
    c = np.clip(np.floor(x).astype(int), 0, h.shape[1] - 2)
    f, g = y - r, x - c
    nw, ne, sw, se = h[r, c], h[r, c + 1], h[r + 1, c], h[r + 1, c + 1]
    return np.where(g >= f, nw + g * (ne - nw) + f * (se - ne), nw + f * (sw - nw) + g * (se - sw))


def brute(h, azimuth, i, j, spacing=(1.0, 1.0)):
    """Highest elevation along the ray, sampled where it crosses any edge, in float64."""
    dy, dx = spacing
    vx, vy = np.sin(azimuth) / dx, -np.cos(azimuth) / dy
    ends = [((h.shape[1] - 1 - j) if v > 0 else -j) / v for v in [vx] if abs(v) > 1e-12]
    ends += [((h.shape[0] - 1 - i) if v > 0 else -i) / v for v in [vy] if abs(v) > 1e-12]
    reach = min(ends)
    # Distances at which x, y or x − y is a whole number
    s = [np.arange(-3000, 3000) / v for v in (vx, vy, vx - vy) if abs(v) > 1e-12]
    s = [t - (o / v) for t, o, v in zip(s, [0, 0, 0], [1, 1, 1], strict=False)]
    s = np.concatenate([*s, [reach]])
    s = s[(s > 1e-6) & (s <= reach + 1e-9)]
    if not len(s):
        return -np.pi / 2
    y, x = np.clip(i + vy * s, 0, h.shape[0] - 1), np.clip(j + vx * s, 0, h.shape[1] - 1)
    return np.arctan(np.max((surface(h, y, x) - h[i, j]) / s))


# Not a hair off the grid's axes: what runs along the border to within rounding counts as on it
AZIMUTHS = st.one_of(st.floats(0, 2 * np.pi).map(lambda a: round(a, 4)), st.sampled_from(list(np.arange(8) * np.pi / 4)))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10**6),
    AZIMUTHS,
    st.sampled_from(["rough", "smooth", "spiky", "bowl", "dome", "flat"]),
    st.tuples(st.integers(2, 24), st.integers(2, 24)),
    st.sampled_from([(1.0, 1.0), (30.0, 20.0), (0.01, 0.05)]),
)
def test_marching_equals_brute_force(seed, azimuth, kind, shape, spacing):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    r2 = (y - shape[0] / 2) ** 2 + (x - shape[1] / 2) ** 2
    h = {
        "rough": rng.normal(size=shape),
        "smooth": np.sin(0.3 * x + 0.2 * y) * 3,
        "spiky": np.where(rng.uniform(size=shape) < 0.05, 20.0, 0.0),
        "bowl": 0.1 * r2 + 0.2 * (x % 2),
        "dome": -0.1 * r2,
        "flat": np.zeros(shape),
    }[kind] * spacing[0]
    field = HeightField(h, spacing)
    found = field.horizons([azimuth], method="march")[0]
    for i, j in zip(rng.integers(0, shape[0], 5), rng.integers(0, shape[1], 5), strict=True):
        assert found[i, j] == pytest.approx(brute(h, azimuth, i, j, spacing), abs=2e-5)


@pytest.mark.parametrize("name", ["fractal", "blocks", "bowl", "random", "walls", "rim"])
def test_shared_lines_find_the_horizon(name):
    """Within 0.05° of marching at 99 % of the points, never above it, and equal along rows and the cells' diagonals."""
    if name in ("walls", "rim"):
        # Rays cross walls that are one sample wide, and leave over a rim, between two columns
        h = np.random.default_rng(1).normal(size=(100, 128)) * 0.2
        for line in (h[40], h[80]) if name == "walls" else (h[0], h[-1], h[:, 0], h[:, -1]):
            line[:] = 9.0
    else:
        h = make(name, 128, seed=3)
    field = HeightField(h)
    azimuths = np.array([0.0, 3 * np.pi / 4, 0.3, 1.1, 2.5, 4.0, 5.9])
    exact, fast = field.horizons(azimuths, method="march"), field.horizons(azimuths, method="tree")
    np.testing.assert_allclose(fast[:2], exact[:2], atol=1e-5)
    assert (fast <= exact + 1e-5).all()
    assert np.percentile(np.degrees(exact - fast), 99) < 0.05
    assert np.degrees(exact - fast).mean() < 0.01


def test_large_fields_have_kernels_of_their_own():
    """Lines' hulls lie in local memory, whose size alone makes no other kernel to Dr.Jit 1.5: a dome's would overflow."""
    kernels = []
    for columns in (40, 400):
        y, x = np.mgrid[:40, :columns]
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            HeightField(-0.01 * (x * x + y * y)).horizons([1.3], method="tree")
            kernels.append({k["hash"] for k in dr.kernel_history([dr.KernelType.JIT])})
    assert kernels[1] - kernels[0]


@pytest.mark.parametrize("azimuth", [0.0, 0.4, np.pi / 4, 2.0, 3.5, 5.5])
@pytest.mark.parametrize("facing", [0.0, 1.0, 2.5])
def test_a_ramp(azimuth, facing):
    """The horizon of an infinite ramp is its slope in the direction looked at."""
    y, x = np.mgrid[:40, :50]
    h = 0.5 * (x * 2.0 * np.sin(facing) - y * 3.0 * np.cos(facing)) + 8000
    found = HeightField(h, (3.0, 2.0)).horizons([azimuth])[0][10:30, 10:40]
    np.testing.assert_allclose(found, np.arctan(0.5 * np.cos(azimuth - facing)), atol=2e-4)


def test_a_pyramid_is_not_over_predicted():
    """From the plain, diagonally, a 45° pyramid's edge rises at 35.26°, not more."""
    y, x = np.mgrid[:101, :101] - 50
    field = HeightField(np.maximum(30.0 - np.maximum(np.abs(x), np.abs(y)), 0))
    azimuths = np.arange(15.0, 76.0)
    found = np.degrees(field.horizons(np.radians(azimuths))[:, 50 + 31, 50 - 31])
    # One cell before its foot: a little less than the edge's own 35.26°
    assert azimuths[found.argmax()] == 45
    assert found.max() == pytest.approx(np.degrees(np.arctan(30 / (31 * np.sqrt(2)))), abs=0.01)


def test_a_wall():
    h = np.zeros((5, 40))
    h[:, 30] = 10.0
    east, west = HeightField(h).horizons([np.pi / 2, 3 * np.pi / 2])
    np.testing.assert_allclose(east[2, :30], np.arctan(10 / (30 - np.arange(30))), atol=1e-5)
    np.testing.assert_allclose(east[2, 31:39], 0, atol=1e-6)
    assert east[2, 39] == pytest.approx(-np.pi / 2) and west[2, 0] == pytest.approx(-np.pi / 2)


def test_azimuths_turn_clockwise_from_north():
    h = np.zeros((21, 21))
    h[2, 10] = h[10, 18] = 5.0
    north, east, south, west = HeightField(h).horizons(4)[:, 10, 10]
    assert north == pytest.approx(np.arctan(5 / 8)) and east == pytest.approx(np.arctan(5 / 8))
    assert south == 0 and west == 0


def test_mirrored_fields_have_mirrored_horizons():
    """A mirror along the diagonal keeps the triangulation; east and south trade places."""
    h = make("fractal", 64)
    a = HeightField(h).horizons([np.pi / 2, 0.3], method="march")
    b = HeightField(h.T).horizons([np.pi, 1.5 * np.pi - 0.3], method="march")
    np.testing.assert_allclose(a[0], b[0].T, atol=1e-5)
    np.testing.assert_allclose(a[1], b[1].T, atol=1e-4)


def test_raising_the_terrain_raises_horizons():
    h = make("fractal", 64)
    higher = h.copy()
    higher[20:30, 40:44] += 10
    before, after = (HeightField(x).horizons([0.7, 1.6], method="march") for x in (h, higher))
    same = np.ones(h.shape, bool)
    same[20:30, 40:44] = False
    assert (after[:, same] >= before[:, same] - 1e-6).all() and (after > before + 0.01).any()


def test_sky_view_of_a_groove_and_a_plain():
    """At the bottom of a 45° groove an upward receiver sees cos 45° of the sky, its walls half of it."""
    assert HeightField(np.zeros((9, 9))).sky_view(8)[4, 4] == pytest.approx(1)
    seen = HeightField(np.broadcast_to(np.abs(np.arange(81.0) - 40), (801, 81))).sky_view(90)[400]
    assert seen[40] == pytest.approx(np.sqrt(0.5), abs=0.01)
    assert seen[39] == pytest.approx(0.5, abs=0.02)


def test_sky_view_at_the_bottom_of_a_bowl():
    """Looking up from a hemisphere's lowest point, the rim stands at 45°."""
    h = make("bowl", 201)
    rim = np.arctan(0.45 * 201 / (0.45 * 201))
    field = HeightField(h)
    assert field.sky_view(30, weighting="solid_angle")[100, 100] == pytest.approx(1 - np.sin(rim), abs=0.01)
    assert field.sky_view(30)[100, 100] == pytest.approx(np.cos(rim) ** 2, abs=0.01)


def test_shadow_of_a_wall():
    h = np.zeros((3, 60))
    h[:, 50] = 10.0
    lit = HeightField(h).shadow(np.pi / 2, np.arctan(0.5), radius=0.0)[1]
    # The shadow is 20 m long
    np.testing.assert_array_equal(lit[:30], 1)
    np.testing.assert_array_equal(lit[31:50], 0)
    soft = HeightField(h).shadow(np.pi / 2, np.arctan(0.5), radius=np.radians(2))[1]
    assert soft[30] == pytest.approx(0.5, abs=0.02)
    assert 0 < soft[29] < 1 and 0 < soft[31] < soft[29]
    assert HeightField(h).shadow(np.pi / 2, -0.2, radius=0.0)[1, :50].max() == 0


def test_curvature_lowers_far_mountains():
    h = np.zeros((2, 401))
    h[:, 400] = 1000.0
    flat, curved, dry = (HeightField(h, 250.0, curvature=c).horizons([np.pi / 2])[0, 0, 0] for c in (False, True, 0.0))
    d, earth = 100_000.0, 6_371_000.0
    assert flat == pytest.approx(np.arctan(1000 / d), rel=1e-5)
    assert dry == pytest.approx(np.arctan(1000 / d - d / (2 * earth)), rel=1e-4)
    assert curved == pytest.approx(np.arctan(1000 / d - 0.87 * d / (2 * earth)), rel=1e-4)


def test_a_radius_ends_the_view():
    h = np.zeros((2, 100))
    h[:, 90] = 50.0
    near = HeightField(h, radius=20.0).horizons([np.pi / 2])[0, 0]
    assert near[0] == 0 and near[80] == pytest.approx(np.arctan(5.0))
