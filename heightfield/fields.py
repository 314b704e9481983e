"""Procedural height fields, and one of real terrain that Matplotlib ships."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from .check import choice, number


def _grid(size):
    return np.mgrid[:size, :size].astype(np.float64) / size


def fractal(size: int = 256, seed: int = 0) -> np.ndarray:
    """Terrain of spectral noise, amplitude ∝ 1 / frequency²; slopes of about 20° at 256 samples."""
    f = np.fft.fftfreq(size)
    k = np.hypot(f[:, None], f[None, :])
    k[0, 0] = np.inf
    noise = np.fft.fft2(np.random.default_rng(seed).normal(size=(size, size)))
    h = np.fft.ifft2(noise / k**2).real
    return h / max(h.std(), 1e-30) * 0.04 * size


def brick(size: int = 256, seed: int = 0) -> np.ndarray:
    """Bricks in a running bond, each a little higher or lower than the next, over mortar with a fine grain."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    high, wide = max(size // 16, 2), max(size // 8, 4)
    course = y // high
    number_of = (x + (course % 2) * (wide // 2)) // wide
    joint = max(size // 128, 1)
    inside = (y % high >= joint) & ((x + (course % 2) * (wide // 2)) % wide >= joint)
    level = rng.uniform(0.7, 1.0, (course.max() + 1, number_of.max() + 1))[course, number_of]
    return (np.where(inside, level, 0.2) + rng.uniform(0, 0.02, (size, size))) * 0.02 * size


def sine(size: int = 256, seed: int = 0) -> np.ndarray:
    """A grid of sine domes, eight a side."""
    y, x = _grid(size)
    return 0.02 * size * np.sin(16 * np.pi * x) * np.sin(16 * np.pi * y)


def blocks(size: int = 256, seed: int = 0) -> np.ndarray:
    """Flat-topped blocks of random height on a plain, like a town."""
    rng = np.random.default_rng(seed)
    h = np.zeros((size, size))
    for _ in range(60):
        w, d = rng.integers(max(size // 32, 1), max(size // 10, 2), 2)
        r, c = rng.integers(0, max(size - max(w, d), 1), 2)
        h[r : r + w, c : c + d] = rng.uniform(0.02, 0.15) * size
    return h


def random(size: int = 256, seed: int = 0) -> np.ndarray:
    """Independent heights, uniform in [0, 1)."""
    return np.random.default_rng(seed).uniform(size=(size, size))


def bowl(size: int = 256, seed: int = 0) -> np.ndarray:
    """A hemispherical bowl in a plain; every point inside sees every other."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    r = 0.45 * size
    return -np.sqrt(np.maximum(r * r - x * x - y * y, 0))


def groove(size: int = 256, seed: int = 0) -> np.ndarray:
    """A V-shaped valley that runs north to south, its walls at 45°."""
    return np.broadcast_to(np.abs(np.arange(size) - (size - 1) / 2), (size, size)).copy()


FIELDS = {f.__name__: f for f in (fractal, brick, sine, blocks, random, bowl, groove)}


def make(name: str, size: int = 256, seed: int = 0) -> np.ndarray:
    """Make a procedural field by name.

    Parameters
    ----------
    name : str
        One of ``FIELDS``.
    size : int
        Rows and columns.
    seed : int
        For those that are random.

    Returns
    -------
    (size, size) float64 array
        Metres, for samples 1 m apart.
    """
    choice("name", name, FIELDS)
    size, seed = number("size", size, 1, 1 << 20, whole=True), number("seed", seed, 0, 1 << 53, whole=True)
    return FIELDS[name](int(size), int(seed))


def example() -> tuple[np.ndarray, tuple[float, float]]:
    """Heights and spacing of the terrain around Jacksboro, Tennessee (344 × 403, 3″), as Matplotlib ships it.

    Returns
    -------
    heights : (344, 403) float64 array
        Metres, north up.
    spacing : (float, float)
        Metres between rows and between columns.
    """
    try:
        from matplotlib import cbook
    except ImportError:
        raise InputError("the field 'jacksboro' comes with Matplotlib: install it with `pip install matplotlib`") from None
    with np.load(cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)) as data:
        heights = data["elevation"].astype(np.float64)
        latitude = float(np.mean(data["ymin"] + data["ymax"]) / 2)
        dy, dx = float(data["dy"]), float(data["dx"])
    return heights, metres(dy, dx, latitude)


def metres(dy: float, dx: float, latitude: float) -> tuple[float, float]:
    """Length of steps of ``dy`` and ``dx`` degrees at a latitude in degrees, on the WGS 84 ellipsoid, in metres."""
    phi, e2, a = np.radians(latitude), 0.00669437999014, 6_378_137.0
    w = 1 - e2 * np.sin(phi) ** 2
    meridian, normal = a * (1 - e2) / w**1.5, a / np.sqrt(w)
    return abs(float(np.radians(dy) * meridian)), abs(float(np.radians(dx) * normal * np.cos(phi)))
