"""Light of the sky, of sun and lamps and of the surface itself, as grid points or chosen receivers get it (§10.1).

What the surface sends is known for each of its triangles (`sent`); what it receives is first found for those, a bounce at a
time, and last for the receivers.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from . import light, pointlight, points
from .sent import Lights, passes_of, sent
from .skylight import add_sky, sky_table
from .surface import normals
from .sweep import packed


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
    lights = Lights(sun, lamps, channels, method)
    e += lights.on(field, spots, own, at)
    if not passes:
        return e if at is None else e + pointlight.arriving(field, spots, own, azimuths, tables, step=step)

    # What the triangles send, and what of it the receivers get
    fine = passes_of(field, n, supersampling, tolerance, sparse)
    whole = fine if supersampling == 1 else passes_of(field, n, 1, tolerance, sparse)
    chosen = None if at is None else (at, spots)
    parts, near, there = sent(field, lights, albedo, emission, int(bounces), azimuths, tables, fine, whole, step, chosen)
    if at is not None:
        return e + pointlight.arriving(field, spots, own, azimuths, tables, parts, supersampling, there, step)
    return e + fine.gathered(False, azimuths, parts, near, None if apart else tables, step)
