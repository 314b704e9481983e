"""Reports: how often methods look at the surface, beside a count of all there is."""

import numpy as np
import pytest

from intervis.heightfield import HeightField, make

ROWS, COLUMNS = 9, 14


def crossings_on_the_field(azimuth):
    """Count, ray by ray, the edges of the triangulation that rays from all grid points cross on a field of square cells."""
    east, south = np.sin(azimuth), -np.cos(azimuth)
    count = 0
    for i, j in np.ndindex(ROWS, COLUMNS):
        times = set()
        for speed, start, most in ((south, i, ROWS), (east, j, COLUMNS), (east - south, j - i, ROWS + COLUMNS)):
            if abs(speed) > 1e-12:
                times |= {round((v - start) / speed, 9) for v in range(-most, most + 1)}
        for t in times:
            y, x = i + t * south, j + t * east
            count += t > 1e-6 and -1e-6 < y < ROWS - 1 + 1e-6 and -1e-6 < x < COLUMNS - 1 + 1e-6
    return count


@pytest.mark.parametrize("azimuth", [0.0, np.pi / 2, 0.4, 1.9, 2.2, 3.5, 4.4, 6.0, np.pi / 4, 3 * np.pi / 4])
def test_the_naive_count_is_every_crossing(azimuth):
    field = HeightField(make("random", 20)[:ROWS, :COLUMNS])
    field.horizons([azimuth], method="march")
    assert field.tally.naive == crossings_on_the_field(azimuth) and field.tally.rays == ROWS * COLUMNS


def test_a_wall_at_the_far_end_has_all_looked_at():
    """Nobody may stop before the highest point: the marcher looks at everything, and skips nothing."""
    heights = np.zeros((12, 40))
    heights[:, -1] = 100.0
    field = HeightField(heights)
    field.horizons([np.pi / 2], method="march")
    assert field.tally.looked == field.tally.naive == 12 * 40 * 39 // 2
    assert field.report.skipped["crossings"] == 0


def test_hulls_look_at_a_share_of_it():
    field = HeightField(make("fractal", 160, seed=2))
    field.horizons(4, method="tree")
    ours = field.tally.looked
    assert 0 < ours < 0.5 * field.tally.naive and field.tally.rays == 4 * 160**2
    assert field.report.skipped["crossings"] == field.tally.naive - ours
    # Every sample beyond the marched ones is pushed on some line, and each point's column looked into
    assert ours > 4 * 160**2


def test_light_counts_all_of_its_sweeps():
    """Triangles' corners, which are grid points, receive once for the sky and once a further bounce, the points last."""
    size, k = 64, 3
    field = HeightField(make("fractal", size, seed=2))
    field.irradiance(bounces=2, azimuths=k)
    assert field.tally.rays == k * 3 * size**2
    assert 0 < field.tally.looked <= field.tally.naive  # both count either side of the rays along edges
    assert f"{field.tally.looked / field.tally.rays:.3g} iterations a point and direction" in str(field.report)


def test_products_report_themselves_alone():
    field = HeightField(make("sine", 30))
    field.horizons(5)
    field.shadow(1.0, 0.2)
    assert field.tally.rays == 900
    field.sky_view(3)
    assert field.tally.rays == 2700
    field.intervisibility(1.0)
    assert field.tally.rays == 900
