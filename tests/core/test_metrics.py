import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from intervis import InputError, metrics

X = np.array([[[1.0, 2.0, 0.0], [0.5, 0.5, 0.5]]])
REF = np.array([[[1.0, 1.0, 0.1], [0.5, 0.3, 0.5]]])


def test_by_hand():
    # Differences: 1 at ref 1, −0.1 at ref 0.1, 0.2 at ref 0.3; three of six values are equal.
    assert metrics.mse(X, REF) == pytest.approx((1.0 + 0.01 + 0.04) / 6)
    assert metrics.mae(X, REF) == pytest.approx((1.0 + 0.1 + 0.2) / 6)
    assert metrics.relmse(X, REF) == pytest.approx((1.0 / 1.01 + 0.01 / 0.02 + 0.04 / 0.10) / 6)
    assert metrics.psnr(X, REF) == pytest.approx(10 * np.log10(6 / 1.05))


def test_equal_images():
    assert metrics.relmse(X, X) == metrics.mse(X, X) == metrics.mae(X, X) == 0.0
    assert metrics.psnr(X, X) == np.inf
    assert metrics.flip(np.ones((16, 16, 3)), np.ones((16, 16, 3))) == pytest.approx(0.0, abs=1e-6)


def test_relmse_is_relative_to_the_second_image():
    assert metrics.relmse(np.full((1, 1), 2.0), np.full((1, 1), 1.0)) == pytest.approx(1 / 1.01)
    assert metrics.relmse(np.full((1, 1), 1.0), np.full((1, 1), 2.0)) == pytest.approx(1 / 4.01)


@given(arrays(np.float64, (3, 4), elements=st.floats(-100, 100)), st.floats(0.1, 10))
def test_scaling_an_error_scales_the_metrics(error, factor):
    ref = np.ones((3, 4))
    for metric, power in ((metrics.mse, 2), (metrics.mae, 1), (metrics.relmse, 2)):
        once = metric(ref + error, ref)
        assert metric(ref + factor * error, ref) == pytest.approx(factor**power * once, rel=1e-6)


def test_flip_of_black_and_white_is_one_and_of_less_less():
    black, white = np.zeros((64, 64, 3)), np.ones((64, 64, 3))
    far, near = metrics.flip(white, black), metrics.flip(0.9 * white, white)
    assert far == pytest.approx(1.0, abs=0.05)
    assert 0.0 < near < 0.2


def test_flip_map_points_at_the_difference():
    ref = np.full((32, 32, 3), 0.2)
    image = ref.copy()
    image[20:24, 8:12] = 0.8
    where = metrics.flip_map(image, ref)
    assert where.shape == (32, 32)
    row, column = np.unravel_index(where.argmax(), where.shape)
    assert 19 <= row <= 24 and 7 <= column <= 12


def test_flip_takes_luminance_and_no_other_channels():
    grey = np.linspace(0, 1, 256).reshape(16, 16)
    rgb = np.repeat(grey[:, :, None], 3, axis=2)
    assert metrics.flip(grey, grey[::-1]) == metrics.flip(rgb, rgb[::-1])
    with pytest.raises(InputError, match="1 or 3 channels"):
        metrics.flip(np.zeros((8, 8, 2)), np.zeros((8, 8, 2)))


@pytest.mark.parametrize("metric", metrics.METRICS.values(), ids=metrics.METRICS)
def test_what_cannot_be_compared_is_refused(metric):
    with pytest.raises(InputError, match="same size and channels"):
        metric(np.zeros((2, 2, 3)), np.zeros((2, 3, 3)))
    with pytest.raises(InputError, match="same size and channels"):
        metric(np.zeros((2, 2, 3)), np.zeros((2, 2)))
    holed = np.zeros((2, 2, 3))
    holed[1, 0, 2] = np.nan
    with pytest.raises(InputError, match="'image' must be finite .got 1 .* row 1, column 0"):
        metric(holed, np.zeros((2, 2, 3)))
    with pytest.raises(InputError, match="'reference' must be finite"):
        metric(np.zeros((2, 2, 3)), holed)
    with pytest.raises(InputError, match="shape"):
        metric(np.zeros(3), np.zeros(3))
