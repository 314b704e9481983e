"""Light between the sky, lamps and the surface itself, over several bounces: sweeps of `gather`, added up (§10.1).

What the surface sends is known for each of its triangles, straight between their corners (`faces`); what it receives is first
found for those, a bounce at a time, and last for the grid points.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from . import device, light, pointlight, points
from .faces import cornered, corners, fit, inside, mean, spots, triangle_normals
from .passes import Passes
from .passes_device import DevicePasses
from .skylight import add_sky, sky_table
from .surface import normals, refine
from .sweep import packed

LAMP_PARTS = 2  # a side, into which a triangle is cut to look at lamps


def irradiance(
    field, sky, sun, lamps, albedo, emission, bounces, azimuths, tolerance, supersampling, sparse, method, progress, at=None
) -> np.ndarray:
    """Irradiance of every point of a field; parameters as `HeightField.irradiance` has them, checked but for the lights.

    Parameters
    ----------
    azimuths : (K,) array
        Radians clockwise from north.
    at : (n, 2) array, optional
        Rows and columns of the receivers, fractional; the grid points by default.

    Returns
    -------
    (channels, rows, columns) or (channels, n) float32 array
    """
    parts = {"albedo": albedo, "emission": 0.0 if emission is None else emission}
    lamps = points.lamps_of(() if lamps is None else lamps)
    channels = light.channels_of(sky, sun, lamps, **parts)
    albedo, emission = (light.image(n, v, field.heights.shape, channels) for n, v in parts.items())
    if albedo.max() > 1:
        raise InputError(f"'albedo' must be in [0, 1] (got {albedo.min():g} to {albedo.max():g})")
    n = normals(field.heights, field.spacing, field.valid).astype(np.float32)
    tables = [sky_table(c) for c in light.sky_columns(sky, azimuths, channels)]
    glows = bool((emission > 0).any())
    bounces = bounces if (albedo > 0).any() else 0
    # A strip one sample wide has no triangles
    passes = (glows or bounces > 0) * (1 + (bounces > 0) + bounces - (not glows)) if min(field.heights.shape) > 1 else 0
    # The last gather finds the horizons too, unless it may stop before it has
    apart = at is None and (not passes or tolerance > 0 or method == "tree")
    total, done = len(azimuths) * max(passes + apart, 1), 0

    def step():
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    # Direct light of the receivers
    if at is None:
        own, spots = n, np.stack([*np.indices(field.heights.shape), field.heights])
    else:
        own, spots = points.interpolated(at, field.valid, n)[1], points.standing(field.heights, at)
    e = np.zeros((channels, *own.shape[1:]), dtype=np.float32)
    if apart and sparse > 1:
        e += passes_of(field, n, 1, 0.0, sparse).gathered(False, azimuths, tables=tables, step=step)
    elif apart:
        tangents = field._tangents(azimuths, method)
        width = 2 * np.pi / len(azimuths)
        for az, table, t in zip(azimuths, tables, tangents, strict=True):
            toward = np.float32(np.sin(az)), np.float32(np.cos(az))
            add_sky(packed(t), n, toward, table, width, e)
            step()
    if sun is not None:
        e += light.sunlight(sun, lambda az, el, r: field._lit(az, el, r, method, at), own, channels)
    if lamps:
        e += points.lamplight(field.heights, field.spacing, lamps, spots, own, channels, field.curve)
    if not passes:
        return e if at is None else e + pointlight.arriving(field, spots, own, azimuths, tables, step=step)

    # Light of the triangles at their corners, a bounce at a time; what unknown points would send is left out
    s = supersampling
    facing = triangle_normals(field.heights - field.centre, field.spacing, s)
    triangles = passes_of(field, n, s, tolerance, sparse)
    known = mean(field.valid | (field.policy == "fill"), s)[:, None] > 1 - 1e-6

    def sent(image):
        return cornered(np.stack([refine(c, s).astype(np.float32) for c in image])) * known

    radiance = sent(emission) if glows else 0
    if bounces > 0:
        glow, share = radiance, sent(albedo / np.pi)
        direct = corners(triangles.gathered(True, azimuths, tables=tables, step=step))
        if sun is not None:
            direct += light.sunlight(sun, triangles.shadow, facing[:, :, None], channels)
        if lamps:
            direct += _lamplight(field, lamps, facing, channels, s)
    for b in range(int(bounces)):
        arriving = corners(triangles.gathered(True, azimuths, radiance, step=step)) if b or glows else 0
        radiance = share * (direct + arriving)
        radiance += glow
    if at is not None:
        return e + pointlight.arriving(field, spots, own, azimuths, tables, radiance, s, step)
    return e + triangles.gathered(False, azimuths, radiance, None if apart else tables, step)


def passes_of(field, n, s: int, *how) -> Passes:
    """Return `Passes`, on a GPU if there is one and the field is large enough; parameters as `Passes` has them."""
    backend = device.chosen(tuple(s * size for size in field.heights.shape))
    return Passes(field, n, s, *how) if backend is None else DevicePasses(backend, field, n, s, *how)


def _lamplight(field, lamps, facing, channels: int, s: int) -> np.ndarray:
    # Irradiance of the triangles at their corners, (channels, 2, 3, ...), straight over each: fitted to a few places in it
    fine = refine(field.heights, s)
    y, x = np.indices(facing.shape[2:])
    out = np.zeros((channels, 2, 3, *facing.shape[2:]), np.float32)
    for kind in (0, 1):
        for (v, u), weights in zip(spots(kind, LAMP_PARTS), fit(kind, LAMP_PARTS).T, strict=True):
            at = np.stack([(y + v) / s, (x + u) / s, inside(fine, kind, v, u)])
            lit = points.lamplight(field.heights, field.spacing, lamps, at, facing[:, kind], channels, field.curve)
            for corner, weight in enumerate(weights):
                out[:, kind, corner] += np.float32(weight) * lit
    return np.maximum(out, 0, out=out)
