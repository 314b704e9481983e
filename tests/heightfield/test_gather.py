"""Light that the surface sends, against float64 brute force: a ray for every elevation, stopped where it first hits."""

import numpy as np
import pytest

from intervis.heightfield import HeightField, make
from intervis.heightfield.faces import (
    MEETING,
    cornered,
    corners,
    facets,
    fit,
    planes,
    spots,
    triangle_normals,
)
from intervis.heightfield.gather import bends
from intervis.heightfield.surface import normals, refine
from intervis.heightfield.sweep import direction


def on_surface(values, y, x):
    """Values between samples, straight on the triangles (diagonals from north-west to south-east)."""
    r = np.clip(np.floor(y).astype(int), 0, values.shape[0] - 2)
    c = np.clip(np.floor(x).astype(int), 0, values.shape[1] - 2)
    f, g = y - r, x - c
    nw, ne, sw, se = values[r, c], values[r, c + 1], values[r + 1, c], values[r + 1, c + 1]
    return np.where(g >= f, nw + g * (ne - nw) + f * (se - ne), nw + f * (sw - nw) + g * (se - sw))


def gathered(field, radiance, azimuth, i, j, rays=4000):
    """Irradiance per radian of azimuth at a sample: midpoint rule over elevations, every ray followed to where it hits."""
    h, (dy, dx) = field.heights, field.spacing
    vx, vy = np.sin(azimuth) / dx, -np.cos(azimuth) / dy
    last = [reach(vx, h.shape[1], j), reach(vy, h.shape[0], i)]
    # Distances at which the ray crosses a column, a row or a diagonal: between them the surface is straight
    s = np.concatenate([np.arange(-200, 200) / v for v in (vx, vy, vx - vy) if abs(v) > 1e-12] + [[min(last)]])
    s = np.unique(s[(s > 1e-9) & (s <= min(last) + 1e-9)].round(9))
    if not len(s):
        return 0.0
    z = on_surface(h, *on_field(h, i + vy * s, j + vx * s)) - h[i, j]
    n = normals(h, field.spacing)[:, i, j]
    along = n[0] * np.sin(azimuth) + n[1] * np.cos(azimuth)
    floor = np.arctan(-along / n[2])
    top = np.arctan((z / s).max())
    if top <= floor:
        return 0.0
    e = floor + (np.arange(rays) + 0.5) / rays * (top - floor)
    first = (np.maximum.accumulate(z / s)[None, :] >= np.tan(e)[:, None]).argmax(1)
    # Where the straight stretch before the first crossing above the ray meets it
    s, z = np.append(0, s), np.append(0, z)
    under, over = (z[k] - s[k] * np.tan(e) for k in (first, first + 1))
    hit = s[first] + under / np.where(under == over, 1, under - over) * (s[first + 1] - s[first])
    values = on_surface(radiance, *on_field(h, i + vy * hit, j + vx * hit))
    return np.sum(values * (n[2] * np.sin(e) + along * np.cos(e)) * np.cos(e)) * (top - floor) / rays


def on_field(h, y, x):
    """Places without what rounding puts beyond the border."""
    return np.clip(y, 0, h.shape[0] - 1), np.clip(x, 0, h.shape[1] - 1)


def reach(v, size, at):
    """Distance to the border along one axis."""
    return np.inf if abs(v) < 1e-12 else ((size - 1 - at) if v > 0 else -at) / v


@pytest.mark.parametrize(
    "name, spacing, cuts",
    [
        ("fractal", (1.0, 1.0), 1),
        ("fractal", (1.3, 0.8), 1),
        ("sine", (1.0, 1.0), 1),
        ("bowl", (2.0, 2.0), 1),
        ("fractal", (1.3, 0.8), 2),
        ("fractal", (1.0, 1.0), 3),
    ],
)
def test_light_from_the_surface(name, spacing, cuts):
    rng = np.random.default_rng(7)
    field = HeightField(make(name, 20, seed=3) * (1.5 if name == "fractal" else 1), spacing)
    # Light as uneven as it gets: a gather that takes it for constant over a triangle is far off
    radiance = rng.uniform(size=(20, 20)) ** 2 * 10
    azimuths = rng.uniform(0, 2 * np.pi, 5)
    found = field.irradiance(sky=0.0, emission=radiance, albedo=0.0, bounces=0, azimuths=azimuths, supersampling=cuts)[..., 0]
    places = [(i, j) for i in range(1, 20, 3) for j in range(1, 20, 3)]
    expected = np.array([sum(gathered(field, radiance, a, i, j) for a in azimuths) for i, j in places]) * 2 * np.pi / 5
    difference = np.array([found[p] for p in places]) - expected
    # Taken at the middle of what is seen of a triangle, not over all of it
    assert difference.std() < 0.02 / cuts**2 * expected.mean()
    assert abs(difference.mean()) < 0.005 / cuts**2 * expected.mean()
    assert expected.std() > 0.1 * expected.mean()


def test_triangles_of_a_cell():
    """One cell with its south-east corner raised: both triangles and their normals by hand."""
    heights = np.array([[0.0, 0.0], [0.0, 3.0]])
    n = triangle_normals(heights, (1.0, 1.0), 1)
    # South-west: rises by 3 to the east only; north-east: by 3 to the south only
    np.testing.assert_allclose(n[:, 0, 0, 0], np.array([-3, 0, 1]) / np.sqrt(10), rtol=1e-6)
    np.testing.assert_allclose(n[:, 1, 0, 0], np.array([0, 3, 1]) / np.sqrt(10), rtol=1e-6)


def test_bends():
    """Tangents of a straight wall from distance 1 to r, taken evenly: where they hit it on average, by brute force."""
    found = bends(np.array([0.5, 1.0, 1.5, 4.5, 4.5001]))
    t = (np.arange(10000) + 0.5) / 10000
    for n, r in ((1, 2), (2, 1.5), (3, 3)):
        # A wall of height s at distance 1 + s (r − 1), seen at share t of its last tangent, 1 / r
        s = t / (r - t * (r - 1))
        assert found[n] == pytest.approx(s.mean(), rel=1e-6)
    # On the surface itself, and from afar
    assert found[0] == pytest.approx(0, abs=1e-7) and found[4] == 0.5


@pytest.mark.parametrize("column, error", [(7, 0.04), (6, 0.03), (5, 0.02), (0, 0.01)])
def test_a_wall_that_is_darkest_at_its_foot(column, error):
    """From near, what a wall sends is not that of its middle: its foot fills more of the view, its top counts for more."""
    heights = np.where(np.arange(24) > 8, 5.0, 0.0) * np.ones((9, 1))
    options = dict(sky=0.0, emission=heights, albedo=0.0, bounces=0, azimuths=[np.pi / 2])
    field = HeightField(heights)
    # At share s of its height 5 and of its width 1 the wall is seen under t = 5 s / (d + s)
    d = 8 - column
    t = (np.arange(100000) + 0.5) / 100000 * 5 / (d + 1)
    expected = 2 * np.pi * np.mean(5 * t * d / (5 - t) * t / (1 + t**2) ** 2) * 5 / (d + 1)
    assert field.irradiance(**options)[4, column, 0] == pytest.approx(expected, rel=error)
    assert field.irradiance(points=[[4.0, column]], **options)[0, 0] == pytest.approx(expected, rel=error)


def test_corners_of_triangles():
    """What a grid point has for each of its six triangles comes to that triangle's corner."""
    # Of a grid of 2 × 2 points: 100 for each row, 10 for each column, and which of the point's triangles
    points = 100 * np.arange(2)[:, None] + 10 * np.arange(2) + np.arange(6)[:, None, None]
    # South-west of the diagonal: its north-western, south-western and south-eastern corners; then north-east of it
    np.testing.assert_array_equal(corners(points)[:, :, 0, 0], [[0, 105, 112], [1, 14, 113]])
    height = cornered(np.array([[0.0, 1.0], [2.0, 3.0]]))
    np.testing.assert_array_equal(height[:, :, 0, 0], [[0, 2, 3], [0, 1, 3]])


@pytest.mark.parametrize("azimuth", np.arange(8) * np.pi / 4 + 0.1)
@pytest.mark.parametrize("s", [1, 2])
def test_facets_have_the_triangles_slopes(azimuth, s):
    """However the grid is turned, the edges of the six triangles around a point are found where they lie."""
    heights, spacing = np.random.default_rng(2).uniform(size=(5, 5)), (2.0, 3.0)
    d, fine, row, column = direction(azimuth, spacing), refine(heights, s), 2 * s, 2 * s
    laid = planes(d.lay(fine), s, 0.0)
    found = facets(d, s, 0, spacing)
    at = laid[tuple(np.moveaxis(found.edges + [0, 2, 2], -1, 0)[[0, 2, 1]])]
    east, south = (at[:, 1] - at[:, 0]) * found.per_east, (at[:, 3] - at[:, 2]) * found.per_south
    n = triangle_normals(heights, spacing, s)
    expected = np.array([n[:, kind, row - v, column - u] for kind, v, u in MEETING])
    np.testing.assert_allclose(east, -expected[:, 0] / expected[:, 2], rtol=1e-5)
    np.testing.assert_allclose(south, expected[:, 1] / expected[:, 2], rtol=1e-5)


@pytest.mark.parametrize("kind", [0, 1])
def test_shares_of_a_triangle(kind):
    """Shares that are straight over a triangle are found again at its corners; others keep their mean."""
    at = np.array(spots(kind, 4))
    assert ((at[:, 1] > at[:, 0]) == kind).all()
    nw, other, se = 0.1, 0.5, 0.3
    inner = other - nw if kind else se - other, se - other if kind else other - nw
    straight = nw + at[:, 1] * inner[0] + at[:, 0] * inner[1]
    np.testing.assert_allclose(fit(kind, 4) @ straight, [nw, other, se])
    half = (at[:, 0] > 0.5).astype(float)
    assert (fit(kind, 4) @ half).mean() == pytest.approx(half.mean())


@pytest.mark.parametrize("azimuths", [np.arange(4) * np.pi / 2, np.arange(4) * np.pi / 2 + np.pi / 4, 16])
def test_light_along_edges(azimuths):
    """Rays along rows, columns and diagonals see both sides: the gather does not depend on how the field is turned."""
    rng = np.random.default_rng(5)
    heights, glow = rng.uniform(0, 4, (9, 9)), rng.uniform(0, 1, (9, 9))
    options = dict(sky=1.0, albedo=0.7, bounces=2, azimuths=azimuths)
    found = HeightField(heights).irradiance(emission=glow, **options)[..., 0]
    # Turned by half a circle, cells are cut alike
    turned = HeightField(heights[::-1, ::-1]).irradiance(emission=glow[::-1, ::-1], **options)[::-1, ::-1, 0]
    np.testing.assert_allclose(found, turned, rtol=2e-5)


@pytest.mark.parametrize("azimuth", np.arange(4) * np.pi / 2)
def test_light_along_the_border(azimuth):
    """Along the outermost rows and columns a ray has triangles on one side only."""
    rng = np.random.default_rng(11)
    field, glow = HeightField(rng.uniform(0, 2, (10, 10))), np.add.outer(np.arange(10), 2 * np.arange(10)) / 27
    found = field.irradiance(sky=0.0, emission=glow, albedo=0.0, bounces=0, azimuths=[azimuth])[..., 0]
    for k in range(10):
        # East and west along the first and last rows, north and south along the columns
        for i, j in ((0, k), (9, k)) if round(azimuth / (np.pi / 2)) % 2 else ((k, 0), (k, 9)):
            assert found[i, j] == pytest.approx(gathered(field, glow, azimuth, i, j) * 2 * np.pi, rel=0.05, abs=2e-3)
