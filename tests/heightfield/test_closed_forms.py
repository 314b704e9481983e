"""Stairs, the V-groove's interreflection, and visibility that goes both ways."""

import numpy as np
import pytest

from intervis.heightfield import HeightField, make


@pytest.mark.parametrize("method", ["auto", "march"])
@pytest.mark.parametrize("azimuth", [90.0, 60.0, 130.0])
def test_horizons_on_stairs(method, azimuth):
    """Upstairs the next edge is the horizon; downstairs one's own tread, or from its edge all the edges below at once."""
    wide, high, oblique = 5, 2.0, np.sin(np.radians(azimuth))
    x = np.arange(60)
    field = HeightField(np.broadcast_to(high * (x // wide), (161, 60)))
    up, down = field.horizons(np.radians([azimuth, azimuth + 180]), method=method)[:, 80]
    at = x % wide
    inside = np.s_[15:45]
    atol = 2e-5 if method == "march" else 1e-3
    np.testing.assert_allclose(up[inside], np.arctan(high / (wide - at) * oblique)[inside], atol=atol)
    expected = np.where(at == 0, np.arctan(-high / wide * oblique), 0)
    np.testing.assert_allclose(down[inside], expected[inside], atol=atol)


def test_interreflection_in_a_v_groove():
    """Irradiance on a wall of an endless 90° groove, against the float64 solution of its integral equation.

    A point at distance s from the edge sees the strip of the other wall between 0 and t with the form factor
    (1 − s / √(s² + t²)) / 2 (crossed strings); its derivative in t is the kernel of the interreflection.
    """
    half = 24
    field = HeightField(np.broadcast_to(np.abs(np.arange(2 * half + 1.0) - half), (401, 2 * half + 1)))
    albedos = (0.3, 0.8)
    both = field.irradiance(sky=1.0, albedo=albedos, bounces=2, azimuths=64)[200]
    # Distances in units of the wall; the kernel is sharp at the edge, so nodes are dense there
    node, weight = np.polynomial.legendre.leggauss(400)
    u = (node + 1) / 2
    t, dt = u**3, weight / 2 * 3 * u**2
    sky = np.pi * (1 + t / np.hypot(t, 1)) / 2
    kernel = t[:, None] * t / (2 * np.hypot(t[:, None], t) ** 3)
    wall = np.abs(np.arange(2 * half + 1) - half) / half
    # At the very edge normals are smooth, and the last sample is the groove's end
    inside = (wall > 3.5 / half) & (wall < 1)
    direct = np.interp(wall, t, sky)[inside]
    for albedo, found in zip(albedos, both.T, strict=True):
        e = sky
        for _ in range(2):
            e = sky + albedo * kernel @ (dt * e)
        expected = np.interp(wall, t, e)[inside]
        np.testing.assert_allclose(found[inside], expected, rtol=0.015)
        np.testing.assert_allclose(found, found[::-1], rtol=1e-4)
        # Bounces matter here: direct light alone is far off
        assert (expected > direct * (1 + 0.05 * albedo)).all() and expected.mean() > direct.mean() * (1 + 0.2 * albedo)


def seen_pairs(field, azimuth, step):
    """All (receiver, sample it sees) along grid-aligned lines, rebuilt from the local horizons."""
    h = field.heights
    offsets, distances, _ = field.intervisibility(azimuth)
    metre = np.hypot(step[0] * field.spacing[0], step[1] * field.spacing[1])
    pairs = set()
    for i, j in np.ndindex(h.shape):
        n = i * h.shape[1] + j
        best, near = -np.inf, 1
        for end in np.rint(distances[offsets[n] : offsets[n + 1]] / metre).astype(int):
            # Between two horizons all that rises above the nearer one is seen
            for k in range(near, end + 1):
                r, c = i + k * step[0], j + k * step[1]
                if (h[r, c] - h[i, j]) / k > best:
                    pairs.add(((i, j), (r, c)))
            best, near = (h[r, c] - h[i, j]) / end, end + 1
    return pairs


@pytest.mark.parametrize("azimuth, step", [(0, (-1, 0)), (90, (0, 1)), (45, (-1, 1)), (135, (1, 1))])
@pytest.mark.parametrize("kind", ["fractal", "random", "few heights", "bowl"])
def test_who_sees_is_seen(azimuth, step, kind):
    """If a sees b along a line then b sees a along the opposite one, ties included."""
    # Whole heights of mean 0: what is equal stays so when the field is centred
    half = np.random.default_rng(6).integers(-2, 3, (10, 20)).astype(float)
    field = HeightField(np.vstack([half, -half]) if kind == "few heights" else make(kind, 20, seed=6))
    there = seen_pairs(field, np.radians(azimuth), step)
    back = seen_pairs(field, np.radians(azimuth + 180), (-step[0], -step[1]))
    assert len(there) > 300
    assert there == {(b, a) for a, b in back}
