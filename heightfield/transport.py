"""Light between the sky, lamps and the surface itself, over several bounces: sweeps of `gather`, added up (§10.1)."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from . import gather, light, points
from .surface import normals
from .sweep import direction, packed


def irradiance(field, sky, sun, lamps, albedo, emission, bounces, azimuths, tolerance, tangents, progress) -> np.ndarray:
    """Irradiance of every point of a field; parameters as `HeightField.irradiance` has them, checked but for the lights.

    Parameters
    ----------
    azimuths : (K,) array
        Radians clockwise from north.
    tangents : iterator of (rows, columns) arrays
        Of the horizons, an azimuth at a time.

    Returns
    -------
    (channels, rows, columns) float32 array
    """
    parts = {"albedo": albedo, "emission": 0.0 if emission is None else emission}
    lamps = () if lamps is None else lamps
    channels = light.channels_of(sky, sun, *parts.values())
    albedo, emission = (light.image(n, v, field.heights.shape, channels) for n, v in parts.items())
    if albedo.max() > 1:
        raise InputError(f"'albedo' must be in [0, 1] (got {albedo.min():g} to {albedo.max():g})")
    lamps = points.lamps_of(lamps, channels)
    n = normals(field.heights, field.spacing, field.valid)
    columns = light.sky_columns(sky, azimuths, channels)
    glows = (emission > 0).any()
    total, done = len(azimuths) * (1 + bounces + glows), 0

    def step():
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    # Direct light: sky above the horizons, the sun, the lamps
    direct = np.zeros((channels, *field.heights.shape), dtype=np.float32)
    width = np.float32(2 * np.pi / len(azimuths))
    for az, column, t in zip(azimuths, columns, tangents, strict=True):
        a = n[0] * np.sin(az) + n[1] * np.cos(az)
        floor = np.maximum(t, light.tangent_plane(n, az)).astype(np.float32)
        gather.add_sky(floor, n[2], a, gather.sky_table(column), width, direct)
        step()
    if sun is not None:
        direct += light.sunlight(field, sun, n, channels)
    if lamps:
        direct += points.lamplight(field.heights, field.spacing, lamps, n, channels, field.curve)

    def bounce(radiance):
        out = np.zeros_like(radiance)
        known = np.where(field.valid | (field.policy == "fill"), radiance, 0).astype(np.float32)
        for az in azimuths:
            d = direction(az, field.spacing)
            plane = light.tangent_plane(n, az)
            seen = gather.surface(d, field._turned, known, n, az, field.curve, field._reach(d), plane, tolerance)
            for channel, share in zip(out, seen, strict=True):
                channel += packed(d.back(share)) * width
            step()
        return out

    if glows:
        direct = direct + bounce(emission)
    e = direct
    for _ in range(int(bounces)):
        e = direct + bounce(e * albedo * np.float32(1 / np.pi))
    return e
