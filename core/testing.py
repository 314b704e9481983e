"""Image-error tests that know the noise: a z-test of every pixel and of the mean, corrected for their number.

For the regression tests of your own scenes, plugins and edits. A test of this kind fails when an image is
wrong by more than its noise explains, and a correct renderer passes it whatever its seeds: with `alpha` 0.01
about one run in a hundred fails by chance, however many pixels the image has.

Example
-------
Render with 32 seeds, and compare with a converged reference that was kept as an EXR::

    import mitsuba as mi
    import numpy as np
    import intervis
    from intervis.images import read_exr
    from intervis.testing import assert_matches_reference, mean_and_variance

    def test_my_scene():
        mi.set_variant("llvm_ad_rgb")
        scene = mi.load_file("my_scene.xml")
        reference = read_exr("my_scene.exr")[0]

        def render(seed):
            return np.array(mi.render(scene, spp=16, seed=seed))

        image, variance = mean_and_variance(render, seeds=range(32))
        assert_matches_reference(
            image, variance, reference["rgb"], reference_variance=reference["variance"],
            samples=32, diff="my_scene.diff.png",
        )

Pixels that seldom change (a wire crossing a light, a firefly) need many samples before a variance estimated
from the same runs is true. Average them over tiles first, which also helps where pixels share samples::

    image, variance = mean_and_variance(lambda seed: tiles(render(seed), 8), seeds=range(32))
    assert_matches_reference(image, variance, tiles(reference["rgb"], 8), samples=32)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable

import numpy as np

from .errors import InputError

# Differences below this, relative to the reference, are float32 rounding and no bias.
ROUNDING = 1e-5
WORST = 5


def assert_matches_reference(
    image: np.ndarray,
    variance: np.ndarray,
    reference: np.ndarray,
    *,
    reference_variance: np.ndarray | None = None,
    samples: int | None = None,
    mean_variance: np.ndarray | None = None,
    alpha: float = 0.01,
    diff: str | os.PathLike | None = None,
    name: str = "image",
) -> None:
    """Fail if an image differs from a reference by more than noise explains.

    Two things are tested, each at half of `alpha`: every value, with z = (image − reference) /
    √(variance + reference_variance) and Šidák's correction α' = 1 − (1 − α)^(1/n) for n values; and the mean
    of each channel, which sees a bias too small for any single pixel. A value without any variance must
    equal the reference up to float rounding, 1e-5 relative. A NaN or an infinity fails.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, C)
        A render, or the mean of renders with several seeds.
    variance : ndarray, the shape of `image`
        Variance of `image` itself: of the mean, not of one seed.
    reference : ndarray, the shape of `image`
        What the image should be.
    reference_variance : ndarray, the shape of `image`, optional
        Variance of `reference`; zero if it is exact.
    samples : int, optional
        Number of independent renders behind `variance`, if it was estimated from few: the test is then
        Student's, with Welch's degrees of freedom. Without it the variance is taken as known.
    mean_variance : ndarray, shape (C,) or (), optional
        Variance of the mean of `image` over pixels, for each channel, behind which are `samples` too. Needed
        when pixels share samples (a wide reconstruction filter, a shared pilot): without it they count as
        independent. `mean_and_variance` of a function that returns ``render(seed).mean((0, 1))`` gives it.
    alpha : float
        Probability that a correct image fails.
    diff : path-like, optional
        PNG written on failure: red where the image is too bright, blue where it is too dark, in units of z.
    name : str
        What to call the image in the message.

    Raises
    ------
    AssertionError
        If the image differs; the message tells how many values, the five worst, and the bias of the mean.
    InputError
        If shapes differ, a variance is negative, or `alpha` or `samples` is out of range.
    """
    x, v, ref, ref_v = _checked(image, variance, reference, reference_variance, samples, alpha)
    failures: list[str] = []

    # What is not a number cannot be tested, and is wrong.
    bad = ~np.isfinite(x) | ~np.isfinite(v)
    if bad.any():
        row, column, channel = np.argwhere(bad)[0]
        first = f"row {row}, column {column}, channel {channel}"
        failures.append(f"{bad.sum():,} values are not finite, the first at {first}")
        x, v = np.where(bad, ref, x), np.where(bad, 0.0, v)

    # Two families of tests share alpha, so that a correct image fails with this probability in all.
    share = 1.0 - np.sqrt(1.0 - alpha)

    # Every value against its own noise.
    freedom = np.inf if samples is None else samples - 1.0
    z, p = _test(x - ref, v, ref_v, ref, freedom)
    limit = _sidak(share, z.size)
    wrong = p < limit
    if wrong.any():
        failures.append(
            f"{wrong.sum():,} of {z.size:,} values differ by more than noise (p < {limit:.2g}), the worst:"
        )
        failures += _worst(x, ref, z, p)

    # The mean over pixels, a channel at a time, since the channels of a pixel are not independent.
    n = z[..., 0].size
    if mean_variance is None:
        # Many pixels' variances make a sum that is known better than each of them (Satterthwaite).
        mean_v = v.sum((0, 1)) / n**2
        total, squares = v.sum((0, 1)), (v**2).sum((0, 1))
        freedom = freedom * np.divide(total**2, squares, out=np.ones_like(squares), where=squares > 0)
    else:
        mean_v = np.broadcast_to(mean_variance, x.shape[2:])
    mean_ref = ref.mean((0, 1))
    bias = x.mean((0, 1)) - mean_ref
    mean_z, mean_p = _test(bias, mean_v, ref_v.sum((0, 1)) / n**2, mean_ref, freedom)
    biased = np.flatnonzero(mean_p < _sidak(share, mean_p.size))
    if len(biased):
        failures.append("the mean over the image is biased:")
        failures += [
            f"  channel {c}: bias {bias[c]:+.3g} of {mean_ref[c]:.4g} ({_percent(bias[c], mean_ref[c])}), "
            f"z {mean_z[c]:+.1f}, p {mean_p[c]:.2g}"
            for c in biased
        ]

    if failures:
        if diff is not None:
            _write_difference(diff, z, bad)
            failures.append(f"difference picture: {os.fspath(diff)}")
        raise AssertionError(f"{name} does not match its reference (alpha {alpha:g}): " + "\n".join(failures))


def mean_and_variance(
    render: Callable[[int], np.ndarray], seeds: Iterable[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of renders over seeds, and the variance of that mean.

    Parameters
    ----------
    render : callable
        Takes a seed, returns an array, always of one shape. Seeds must give independent images.
    seeds : iterable of int
        At least two; give their number to `assert_matches_reference` as `samples`.

    Returns
    -------
    mean, variance : ndarray of float64
        Of the shape that `render` returns; one image at a time is held in memory.

    Raises
    ------
    InputError
        If there are fewer than two seeds.
    """
    # Welford's recurrence: exact for constant pixels, and no cancellation for bright ones.
    count, mean, squares = 0, 0.0, 0.0
    for count, seed in enumerate(seeds, start=1):
        x = np.asarray(render(seed), dtype=np.float64)
        delta = x - mean
        mean = mean + delta / count
        squares = squares + delta * (x - mean)
    if count < 2:
        raise InputError(f"'seeds' must hold at least 2 seeds to estimate a variance (got {count})")
    return mean, squares / (count - 1) / count


def tiles(image: np.ndarray, size: int) -> np.ndarray:
    """Return the means of tiles of `size` × `size` pixels, without incomplete tiles at the right and bottom.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, C)
        At least one tile large.
    size : int
        Side of a tile in pixels.

    Returns
    -------
    ndarray of float64, shape (H // size, W // size) or (H // size, W // size, C)

    Raises
    ------
    InputError
        If `size` is below 1 or larger than the image.
    """
    x = np.asarray(image, dtype=np.float64)
    if x.ndim not in (2, 3) or not 1 <= size <= min(x.shape[:2]):
        raise InputError(f"'size' must be from 1 to the smaller side (got {size} for shape {x.shape})")
    h, w = x.shape[0] // size, x.shape[1] // size
    return x[: h * size, : w * size].reshape(h, size, w, size, *x.shape[2:]).mean((1, 3))


def _checked(image, variance, reference, reference_variance, samples, alpha) -> tuple[np.ndarray, ...]:
    """Return the four arrays in float64 with a channel axis, or raise `InputError`."""
    if not 0.0 < alpha < 1.0:
        raise InputError(f"'alpha' must be between 0 and 1 (got {alpha})")
    if samples is not None and samples < 2:
        raise InputError(f"'samples' must be >= 2, the renders behind 'variance' (got {samples})")
    shape = np.shape(image)
    if len(shape) not in (2, 3) or 0 in shape:
        raise InputError(f"'image' must have shape (H, W) or (H, W, C) (got {shape})")
    given = {"image": image, "variance": variance, "reference": reference}
    given["reference_variance"] = np.zeros(shape) if reference_variance is None else reference_variance
    arrays = []
    for name, value in given.items():
        array = np.asarray(value, dtype=np.float64)
        if array.shape != shape:
            raise InputError(f"'{name}' must have the shape of 'image', {shape} (got {array.shape})")
        if name.endswith("variance") and (array < 0).any():
            raise InputError(f"'{name}' must not be negative (got {array.min():g})")
        if name.startswith("reference") and not np.isfinite(array).all():
            count = (~np.isfinite(array)).sum()
            raise InputError(f"'{name}' must be finite (got {count} NaN or infinite values)")
        arrays.append(array if array.ndim == 3 else array[:, :, None])
    return tuple(arrays)


def _sidak(alpha: float, n: int) -> float:
    """Return the level of each of `n` independent tests whose family has level `alpha`."""
    return float(-np.expm1(np.log1p(-alpha) / n))


def _test(difference, v, ref_v, ref, freedom) -> tuple[np.ndarray, np.ndarray]:
    """Return z and the two-sided p of each difference; equal up to rounding has p = 1."""
    from scipy import special

    total = v + ref_v
    rounding = np.abs(difference) <= ROUNDING * np.abs(ref)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(rounding & (total == 0), 0.0, difference / np.sqrt(total))
        # Welch: only `v` is estimated, so its share of the noise sets the degrees of freedom of the sum.
        freedom = np.where(v > 0, freedom * (total / v) ** 2, np.inf)
        student = special.stdtr(np.minimum(freedom, 1e8), -np.abs(z))
        p = 2.0 * np.where(freedom < 1e8, student, special.ndtr(-np.abs(z)))
    return z, np.where(rounding, 1.0, p)


def _worst(x, ref, z, p) -> list[str]:
    """Return a table of the values with the smallest p."""
    order = np.lexsort((-np.abs(z).ravel(), p.ravel()))[:WORST]
    rows = [f"  {'row':>5} {'col':>5} {'channel':>7} {'image':>12} {'reference':>12} {'z':>8}"]
    for row, column, channel in zip(*np.unravel_index(order, z.shape), strict=True):
        at = row, column, channel
        rows.append(f"  {row:5} {column:5} {channel:7} {x[at]:12.6g} {ref[at]:12.6g} {z[at]:+8.1f}")
    return rows


def _percent(bias: float, mean: float) -> str:
    """Return a bias relative to a mean as text."""
    return f"{100 * bias / mean:+.3g} %" if mean else "the reference is black"


def _write_difference(path: str | os.PathLike, z: np.ndarray, bad: np.ndarray) -> None:
    """Write the largest z of each pixel: white is none, red too bright, blue too dark, black not finite."""
    from .images import write_png

    index = np.abs(z).argmax(axis=2, keepdims=True)
    worst = np.take_along_axis(z, index, axis=2)[..., 0]
    # Full colour at 6: beyond any correction that an image's number of pixels asks for.
    t = np.clip(worst / 6.0, -1.0, 1.0)[..., None]
    red, blue, white = np.array([0.7, 0.0, 0.0]), np.array([0.0, 0.05, 0.7]), np.ones(3)
    rgb = np.where(t > 0, white + t * (red - white), white - t * (blue - white))
    write_png(path, np.where(bad.any(axis=2)[..., None], 0.0, rgb))
