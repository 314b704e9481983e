"""Lights over a height field: sky, sun, and the values that describe them, brought into one form."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from ..errors import InputError
from .check import listed, number, reals, shown
from .sweep import arctan

SUN_RADIUS = np.radians(0.2666)  # mean angular radius of the sun
BRIGHTEST = 1e30  # W/m²: light is float32
ROWS = 2048  # elevations at which a sky is sampled, as many as `gather` tabulates


@nb.njit(cache=True, parallel=True, error_model="numpy")
def add_cosine(tangents, normals, azimuth, total):
    """Add the cosine-weighted share of a uniform sky in one direction, above tangents; 1 for an open horizontal plane.

    ``tangents`` are (n,) float32, ``normals`` (3, n), ``total`` (n,) float64.
    """
    s, c = math.sin(azimuth), math.cos(azimuth)
    for i in nb.prange(len(tangents)):
        a, up = normals[0, i] * s + normals[1, i] * c, normals[2, i]
        # The receiver's own plane hides what is below it
        t = max(np.float64(tangents[i]), -a / up)
        # From e = arctan t to the zenith: ∫ (n_z sin + a cos) cos = n_z cos²e / 2 + a (π/2 − e − sin e cos e) / 2, over the
        # 1/2 of an open plane
        below = 1 / (1 + t * t)
        total[i] += max(up * below + a * (np.pi / 2 - arctan(np.float32(t)) - t * below), 0.0)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def add_solid_angle(tangents, total):
    """Add the share of the sky's solid angle in one direction, above tangents: below the horizontal there is no sky."""
    for i in nb.prange(len(tangents)):
        t = max(np.float64(tangents[i]), 0.0)
        total[i] += 1 - t / math.sqrt(1 + t * t)


def disk_share(horizon: np.ndarray, elevation: float, radius: float) -> np.ndarray:
    """Share of a disk at an elevation that stands above level horizons (all in radians)."""
    if radius == 0:
        return (horizon < elevation).astype(np.float64)
    # Area of a circle above a chord at signed distance x from its centre
    x = np.clip((horizon - elevation) / radius, -1, 1)
    return (np.arccos(x) - x * np.sqrt(1 - x * x)) / np.pi


def channels_of(sky, sun, lamps, **values) -> int:
    """Return how many channels the lights and the surface have; 1 and one other number may be mixed.

    ``lamps`` are as `points.lamps_of` returns them, ``values`` the surface's by name.
    """
    if sun is not None and (not listed(sun) or len(sun) not in (3, 4)):
        raise InputError(f"'sun' must be (azimuth, elevation, irradiance) or with a radius after that (got {shown(sun)})")
    if sun is not None:
        strength = reals("sun irradiance", sun[2])
        if strength.ndim > 1 or not strength.size:
            raise InputError(f"'sun irradiance' must be a number, or one a channel (got {shown(sun[2])})")
        positive("sun irradiance", strength)
    found = {}
    for name, v in {"sky": sky, "sun": sun[2] if sun is not None else 1.0, **values}.items():
        if callable(v) and name == "sky":
            found[name] = _called(v, np.zeros(1), np.ones(1)).shape[-1]
        else:
            shape = reals(name, v).shape
            if 0 in shape:
                raise InputError(f"'{name}' must not be empty (got shape {shape})")
            if len(shape) in (1, 3):
                found[name] = shape[-1]
    found |= {f"lamps[{n}]": len(intensity) for n, (*_, intensity) in enumerate(lamps)}
    found = {name: channels for name, channels in found.items() if channels > 1}
    if len(set(found.values())) > 1:
        names, got = ", ".join(f"'{name}'" for name in found), ", ".join(map(str, found.values()))
        raise InputError(f"{names} must have equally many channels, or one (got {got})")
    return next(iter(found.values()), 1)


def image(name: str, value, shape: tuple[int, int], channels: int) -> np.ndarray:
    """Return a constant, a spectrum or an image as a (channels, rows, columns) float32 array of finite values."""
    v = reals(name, value)
    if v.ndim == 2 and v.shape == shape:
        v = v[..., None]
    if v.ndim not in (0, 1, 3) or (v.ndim == 3 and v.shape[:2] != shape):
        raise InputError(
            f"'{name}' must be a number, one a channel, or an image of {shape[0]} × {shape[1]} (got shape {v.shape})"
        )
    positive(name, v)
    return np.array(np.moveaxis(np.broadcast_to(v, (*shape, channels)), -1, 0), dtype=np.float32)


def positive(name: str, values: np.ndarray) -> None:
    """Check that light, or what reflects it, is not negative and has room in float32."""
    low, high = values.min(), values.max()
    if not (low >= 0 and high <= BRIGHTEST):
        raise InputError(f"'{name}' must be finite, >= 0 and <= {BRIGHTEST:g} (got {low:g} to {high:g})")


def sky_columns(sky, azimuths: np.ndarray, channels: int) -> list[np.ndarray]:
    """Return the sky's radiance over elevation for each azimuth, as `skylight.sky_table` takes it."""
    e = np.linspace(-np.pi / 2, np.pi / 2, ROWS)
    if not callable(sky):
        sky = reals("sky", sky)
    if callable(sky):
        columns = [_called(sky, np.full(ROWS, az), e) for az in azimuths]
    elif np.ndim(sky) == 3:
        positive("sky", sky)
        columns = _map_columns(sky, azimuths, e)
    elif np.ndim(sky) <= 1:
        columns = [sky.reshape(1, -1)] * len(azimuths)
    else:
        raise InputError(f"'sky' must be a number, one a channel, a function or an environment map (got shape {sky.shape})")
    for c in columns:
        if c.shape[-1] not in (1, channels):
            raise InputError(f"'sky' must have 1 or {channels} channels (got {c.shape[-1]})")
        positive("sky", c)
    return [np.broadcast_to(c, (len(c), channels)) for c in columns]


def _called(sky, azimuths, elevations):
    # Radiance that a function gives, (directions, channels)
    try:
        value = reals("sky", sky(azimuths, elevations))
    except TypeError as e:
        raise InputError(f"'sky' as a function must take arrays of azimuths and elevations: {e}") from e
    if value.ndim == 0 or value.shape[0] != len(azimuths):
        raise InputError(f"'sky' must return a row for each of {len(azimuths)} directions (got shape {value.shape})")
    return value.reshape(len(azimuths), -1)


def _map_columns(pixels, azimuths, elevations):
    # Means over each sector and step of elevation: a bright sun between two of them must not be lost. As in Mitsuba, rows
    # stand at 0 to π from the zenith, ends included, and columns at the middle of their share of the circle
    height, width, _ = pixels.shape
    half = np.pi / (len(elevations) - 1) / 2
    ends = ((np.pi / 2 - np.clip(elevations + d, -np.pi / 2, np.pi / 2)) / np.pi * (height - 1) for d in (half, -half))
    rows = (
        np.swapaxes(_means(pixels, *ends), 0, 1) if height > 1 else np.repeat(np.swapaxes(pixels, 0, 1), len(elevations), 1)
    )
    # Three times around, so that no sector is cut
    round_ = np.concatenate([rows] * 3 + [rows[:1]])
    half = np.pi / len(azimuths)
    first = np.mod(azimuths - half, 2 * np.pi) / (2 * np.pi) * width - 0.5 + width
    return list(_means(round_, first, first + width / len(azimuths)))


def _means(values, begin, end):
    # Means of the straight lines through values at 0, 1, 2 …, from positions ``begin`` to ``end``
    whole = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum((values[1:] + values[:-1]) / 2, axis=0)])

    def integral(x):
        k = np.clip(x.astype(int), 0, len(values) - 2)
        t = (x - k).reshape(-1, *[1] * (values.ndim - 1))
        return whole[k] + t * values[k] + t * t / 2 * (values[k + 1] - values[k])

    return (integral(end) - integral(begin)) / (end - begin).reshape(-1, *[1] * (values.ndim - 1))


def sunlight(sun, shadow, n: np.ndarray, channels: int) -> np.ndarray:
    """Return direct irradiance from a sun, (channels, ...) float32.

    ``shadow(azimuth, elevation, radius)`` gives the share of its disk that each receiver sees; ``n`` (3, ...): unit normals.
    """
    azimuth, elevation = number("sun azimuth", sun[0]), number("sun elevation", sun[1], -np.pi / 2, np.pi / 2)
    strength = np.broadcast_to(reals("sun irradiance", sun[2]).ravel(), (channels,))
    if not np.isfinite(strength).all() or strength.min() < 0:
        raise InputError(f"'sun' irradiance must be finite and >= 0 (got {sun[2]!r})")
    lit = shadow(azimuth, elevation, number("sun radius", sun[3], 0, np.pi / 2) if len(sun) == 4 else SUN_RADIUS)
    to = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    cosine = np.maximum(np.tensordot(to, n, axes=1), 0) * np.nan_to_num(lit)
    return (strength.reshape(-1, *[1] * cosine.ndim) * cosine).astype(np.float32)
