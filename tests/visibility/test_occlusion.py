import numpy as np
import pytest

import intervis
from intervis.visibility.occlusion import correct_self_occlusion, disc_overlap, self_visibility


def test_disc_overlap_closed_forms():
    lens = 2 / 3 - np.sqrt(3) / (2 * np.pi)  # discs through each other's centre
    np.testing.assert_allclose(disc_overlap([0, 1, 2, 5], 1.0), [1, lens, 0, 0], atol=1e-12)
    np.testing.assert_allclose(disc_overlap(30, 30.0), lens)


def test_disc_overlap_equals_counting():
    y, x = (np.indices((800, 800)) + 0.5) / 200 - 2
    for d in (0.3, 0.9, 1.6):
        inside = np.hypot(x, y) < 1
        common = inside & (np.hypot(x - d, y) < 1)
        assert disc_overlap(d, 1.0) == pytest.approx(common.sum() / inside.sum(), abs=2e-3)


def test_two_discs():
    lens = disc_overlap(1, 1.0)
    for m in (1, 2, 5):
        np.testing.assert_allclose(self_visibility([(0, 0), (1, 0)], [1, 2], 1.0, m), [1, 1 - lens])


def test_stacked_discs_are_subtracted_once():
    # Three discs in one place: the second hides the third, but it is hidden itself
    v = self_visibility([(0, 0)] * 3, [1, 2, 3], 1.0, iterations=2)
    np.testing.assert_allclose(v, [1, 0, 0])
    # A lens that two discs behind each other both cover is subtracted once, not twice
    lens = disc_overlap(1, 1.0)
    v = self_visibility([(0, 0), (0, 0), (1, 0)], [1, 2, 3], 1.0, iterations=2)
    np.testing.assert_allclose(v, [1, 0, 1 - lens])


def test_converges_to_what_is_visible():
    # Non-overlapping blockers before a disc: exact, and equal depths do not hide each other
    p, d = [(0, 0), (1.2, 0), (-1.2, 0), (0, 0)], [2, 1, 1, 2]
    v = self_visibility(p, d, 1.0, 4)
    np.testing.assert_allclose(v, [1 - 2 * disc_overlap(1.2, 1.0), 1, 1, 1 - 2 * disc_overlap(1.2, 1.0)])


def test_correction():
    p, d = [(0, 0), (1, 0), (0, 0)], [1, 2, 3]
    lens = disc_overlap(1, 1.0)
    # A cluster seen as much as its own object lets it is fully visible; a hidden one says nothing
    got = correct_self_occlusion([1, 1 - lens, 0], p, d, 1.0)
    np.testing.assert_allclose(got, [1, 1, np.nan])
    half = correct_self_occlusion([0.5, (1 - lens) / 2, 0], p, d, 1.0)
    np.testing.assert_allclose(half, [0.5, 0.5, np.nan])


@pytest.mark.parametrize(
    "arguments",
    [([(0, 0)], [1, 2], 1.0), ([0, 1], [1, 2], 1.0), ([(0, 0)], [1], 0.0), ([(0, 0)], [1], float("nan"))],
)
def test_wrong_input(arguments):
    with pytest.raises(intervis.InputError):
        self_visibility(*arguments)


def test_wrong_fractions():
    with pytest.raises(intervis.InputError, match="fractions"):
        correct_self_occlusion([1, 1], [(0, 0)], [1], 1.0)
