import numpy as np
import pytest
from scipy import stats

from intervis import InputError
from intervis.testing import assert_matches_reference, mean_and_variance, tiles


def fails(*args, **options):
    try:
        assert_matches_reference(*args, **options)
    except AssertionError:
        return True
    return False


def test_an_exact_image_passes_and_rounding_is_forgiven():
    ref = np.full((4, 4, 3), 0.7)
    zero = np.zeros_like(ref)
    assert_matches_reference(ref, zero, ref)
    assert_matches_reference(ref * (1 + 5e-6), zero, ref)
    with pytest.raises(AssertionError, match="48 of 48 values"):
        assert_matches_reference(ref * (1 + 2e-5), zero, ref)


def test_black_must_be_black():
    zero = np.zeros((2, 2))
    assert_matches_reference(zero, zero, zero)
    assert fails(zero + 1e-12, zero, zero)


def test_one_wrong_pixel_is_found_and_named():
    rng = np.random.default_rng(3)
    ref = np.ones((20, 30, 3))
    image = ref + 0.01 * rng.normal(size=ref.shape)
    image[7, 11, 1] += 0.1
    with pytest.raises(AssertionError) as caught:
        assert_matches_reference(image, np.full(ref.shape, 1e-4), ref, name="box")
    text = str(caught.value)
    assert text.startswith("box does not match") and "1 of 1,800 values differ" in text
    row, column, channel = text.splitlines()[2].split()[:3]
    assert (row, column, channel) == ("7", "11", "1")
    assert "biased" not in text


def test_a_bias_too_small_for_any_pixel_is_found_in_the_mean():
    rng = np.random.default_rng(4)
    ref = np.full((64, 64, 3), 0.5)
    image = ref + 0.1 * rng.normal(size=ref.shape)
    variance = np.full(ref.shape, 0.01)
    assert_matches_reference(image, variance, ref)
    image[:, :, 2] += 0.01
    with pytest.raises(AssertionError, match="channel 2: bias") as caught:
        assert_matches_reference(image, variance, ref)
    assert "channel 0" not in str(caught.value) and "values differ" not in str(caught.value)


@pytest.mark.parametrize("samples", [None, 4], ids=["known variance", "four samples"])
def test_a_right_image_fails_as_often_as_alpha_says(samples):
    rng = np.random.default_rng(5)
    ref = rng.uniform(0.5, 2.0, size=(6, 6, 1))
    sigma = rng.uniform(0.1, 1.0, size=ref.shape)
    count = 0
    for _ in range(500):
        if samples is None:
            image, variance = ref + sigma * rng.normal(size=ref.shape), sigma**2
        else:
            runs = iter(ref + sigma * rng.normal(size=(samples, *ref.shape)))
            image, variance = mean_and_variance(lambda _, runs=runs: next(runs), range(samples))
        count += fails(image, variance, ref, samples=samples, alpha=0.2)
    # Binomial(500, 0.2) leaves [68, 132] once in 2000 times; Student's mean test may only be too kind.
    assert 60 <= count <= 132


def test_a_variance_from_four_samples_taken_as_known_fails_too_often():
    rng = np.random.default_rng(6)
    ref = np.ones((16, 16))
    count = 0
    for _ in range(50):
        runs = iter(ref + 0.1 * rng.normal(size=(4, *ref.shape)))
        image, variance = mean_and_variance(lambda _, runs=runs: next(runs), range(4))
        count += fails(image, variance, ref, alpha=0.01)
    assert count > 25


def test_student_gives_the_p_of_scipy():
    # One pixel, one channel: two equal tests share alpha, so the limit on p is 1 − √(1 − α).
    image, variance, ref = np.array([[1.3]]), np.array([[0.01]]), np.array([[1.0]])
    p = 2 * stats.t.sf(3.0, df=4)
    alpha = 1 - (1 - p) ** 2
    assert fails(image, variance, ref, samples=5, alpha=alpha * 1.001)
    assert not fails(image, variance, ref, samples=5, alpha=alpha * 0.999)


def test_the_references_variance_counts():
    image, ref = np.full((3, 3), 1.2), np.ones((3, 3))
    variance = np.full((3, 3), 0.001)
    assert fails(image, variance, ref)
    assert not fails(image, variance, ref, reference_variance=np.full((3, 3), 0.1))


def test_pixels_that_share_samples_need_the_variance_of_the_mean():
    # All pixels move together: the mean has the variance of one pixel, not a hundredth of it.
    ref = np.ones((10, 10, 3))
    image, variance = ref + 0.08, np.full(ref.shape, 0.01)
    assert fails(image, variance, ref)
    assert not fails(image, variance, ref, mean_variance=np.full(3, 0.01))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_no_number_fails(bad):
    ref = np.ones((3, 3, 3))
    image = ref.copy()
    image[1, 2, 0] = bad
    with pytest.raises(AssertionError, match="1 values are not finite, .* row 1, column 2, channel 0"):
        assert_matches_reference(image, np.ones_like(ref), ref)


def test_the_difference_picture_shows_where_and_which_way(tmp_path, variant_llvm):
    import mitsuba as mi

    ref = np.ones((8, 8, 3))
    image = ref.copy()
    image[1, 2] += 1.0
    image[5, 6] -= 1.0
    path = tmp_path / "diff.png"
    with pytest.raises(AssertionError, match="diff.png"):
        assert_matches_reference(image, np.full(ref.shape, 1e-4), ref, diff=path)
    pixels = np.array(mi.Bitmap(str(path))).astype(int)
    assert pixels[1, 2, 0] > pixels[1, 2, 2] + 100
    assert pixels[5, 6, 2] > pixels[5, 6, 0] + 100
    assert (pixels[0, 0] == 255).all()


def test_no_picture_is_written_of_a_match(tmp_path):
    assert_matches_reference(np.ones((2, 2)), np.ones((2, 2)), np.ones((2, 2)), diff=tmp_path / "diff.png")
    assert list(tmp_path.iterdir()) == []


def test_mean_and_variance_by_hand():
    # Values 1, 2, 6: mean 3, sample variance 7, of the mean 7/3.
    values = {10: 1.0, 20: 2.0, 30: 6.0}
    mean, variance = mean_and_variance(lambda seed: np.full((2, 2), values[seed]), values)
    np.testing.assert_allclose(mean, np.full((2, 2), 3.0))
    np.testing.assert_allclose(variance, np.full((2, 2), 7.0 / 3.0))


def test_mean_and_variance_of_constants_is_exactly_zero():
    mean, variance = mean_and_variance(lambda seed: np.full((2,), 0.1, np.float32), range(7))
    assert (variance == 0).all() and (mean == np.float32(0.1)).all()


def test_tiles_by_hand():
    image = np.arange(20.0).reshape(4, 5)
    np.testing.assert_allclose(tiles(image, 2), [[3.0, 5.0], [13.0, 15.0]])
    assert tiles(np.zeros((9, 8, 3)), 4).shape == (2, 2, 3)


def test_a_render_matches_another_with_other_seeds_and_not_a_brighter_one(variant_llvm):
    import mitsuba as mi

    box = mi.cornell_box()
    box["sensor"]["film"] |= {"width": 16, "height": 16, "rfilter": {"type": "box"}}
    box["integrator"] = {"type": "direct"}
    scene = mi.load_dict(box)

    def render(seed):
        return np.array(mi.render(scene, spp=16, seed=seed))

    image, variance = mean_and_variance(render, range(16))
    ref, ref_variance = mean_and_variance(lambda seed: render(1000 + seed), range(48))
    # Tiles, since single pixels at edges are far from normal.
    small = [tiles(a, 4) for a in (image, variance / 16, ref, ref_variance / 16)]
    options = {"reference_variance": small[3], "samples": 16}
    assert_matches_reference(small[0], small[1], small[2], **options)
    with pytest.raises(AssertionError):
        assert_matches_reference(1.03 * small[0], small[1], small[2], **options)


def test_wrong_arguments_are_refused():
    one = np.ones((2, 2))
    for arguments, options, message in [
        ((one, one[:1], one), {}, "'variance' must have the shape"),
        ((one, -one, one), {}, "must not be negative"),
        ((one, one, one * np.nan), {}, "'reference' must be finite"),
        ((one, one, one), {"alpha": 0.0}, "'alpha'"),
        ((one, one, one), {"samples": 1}, "'samples' must be >= 2"),
        ((one[0], one[0], one[0]), {}, "'image' must have shape"),
    ]:
        with pytest.raises(InputError, match=message):
            assert_matches_reference(*arguments, **options)
    with pytest.raises(InputError, match="'seeds'"):
        mean_and_variance(lambda seed: one, [1])
    with pytest.raises(InputError, match="'size'"):
        tiles(one, 3)
