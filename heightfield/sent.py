"""What the surface sends: the radiance of its triangles, from the light that reaches them over several bounces (§10.1).

Seen from afar it is straight between a triangle's corners. Shadows of sun and lamps are sharp, though, and of the triangles
on which a receiver stands it sees the very spot where it stands: what they send from there is found apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import device, light, pointlight, points
from .faces import cornered, corners, cut, fit, inside, joined, mean, meeting, outer, spots, triangle_normals
from .passes import Passes
from .passes_device import DevicePasses
from .surface import refine

LAMP_PARTS = 2  # a side, into which a triangle is cut to look at lamps


class Lights(NamedTuple):
    """Sun and lamps, as `HeightField.irradiance` takes them, checked; the number of channels; how sun and sky are looked at.

    Attributes
    ----------
    sun : tuple or None
    lamps : list of (x, y, z, intensity)
    channels : int
    method : str
    """

    sun: tuple | None
    lamps: list
    channels: int
    method: str

    def on(self, field, places, n, at=None) -> np.ndarray:
        """Irradiance of places from sun and lamps, with sharp shadows.

        Parameters
        ----------
        field : HeightField
        places : (3, ...) array
            Rows, columns and heights in metres.
        n : (3, [k,] ...) array
            Their unit normals, of which each may have several.
        at : (n, 2) array, optional
            The places' rows and columns; the grid points by default.

        Returns
        -------
        (channels, [k,] ...) float32 array
            W/m².
        """
        e = self.of_lamps(field, places, n)
        if self.sun is not None:
            e += light.sunlight(self.sun, lambda az, el, r: field._lit(az, el, r, self.method, at), n, self.channels)
        return e

    def of_lamps(self, field, places, n) -> np.ndarray:
        """Irradiance of places from lamps alone, as `on` has it."""
        return points.lamplight(field.heights, field.spacing, self.lamps, places, n, self.channels, field.curve)


class Sent(NamedTuple):
    """Radiance of a field's triangles at their corners.

    Attributes
    ----------
    parts : (channels, 2, 3, s · (rows − 1), s · (columns − 1)) float32 array
        Of cells cut ``s`` times a side, as seen from afar.
    near : (channels, 2, 3, rows − 1, columns − 1) float32 array or None
        Of whole triangles, as who stands on their corner sees it; None if that makes no difference.
    there : (channels, 8, n) float32 array or None
        Of the triangles around chosen receivers (see `pointlight.around`), as these see them where they stand.
    """

    parts: np.ndarray
    near: np.ndarray | None
    there: np.ndarray | None


def sent(
    field, lights: Lights, albedo, emission, bounces: int, azimuths, tables, fine: Passes, whole: Passes, step, chosen
) -> Sent:
    """Return what the surface sends after so many reflections.

    Parameters
    ----------
    field : HeightField
    lights : Lights
    albedo, emission : (channels, rows, columns) float32 array
    bounces : int
        Reflections, not counting that at the receiver.
    azimuths : (K,) array
    tables : K arrays
        The sky's.
    fine, whole : Passes
        Of the cells' parts, and of whole cells; the same if cells are not cut.
    step : callable
        Called after each direction.
    chosen : (n, 2) array and (3, n) array, or None
        Chosen receivers, and their rows, columns and heights.

    Returns
    -------
    Sent
    """
    s = fine.s
    # What unknown points would send is left out
    known = mean(field.valid | (field.policy == "fill"), 1)[:, None] > 1 - 1e-6
    glow, share = (cornered(image) * known for image in (emission, albedo / np.float32(np.pi)))
    if not bounces:
        return Sent(cut(glow, s), None, None)
    # Direct light of parts is for the receivers; whole triangles exchange the straight fit to it
    normal = triangle_normals(field.heights - field.centre, field.spacing, 1)
    direct = corners(fine.gathered(True, azimuths, tables=tables, step=step))
    sharp = lights.sun is not None or lights.lamps
    close = sky = outer(direct, s) if sharp else None
    if sharp:
        direct += _fitted(field, lights, s, fine)
        close = sky + _cornered(field, lights, normal)
    even = joined(direct, s)
    np.maximum(even, 0, out=even)
    arriving = np.float32(0)
    for b in range(bounces):
        if b or emission.any():
            far = glow + share * (even + arriving) if b else glow
            near = glow + share * (close + arriving) if b and sharp else None
            arriving = corners(whole.gathered(True, azimuths, far, near, step=step))
    del even
    direct += cut(arriving, s) if np.ndim(arriving) else arriving
    direct *= cut(share, s)
    direct += cut(glow, s)
    if not sharp:
        return Sent(direct, None, None)
    near, there = glow + share * (close + arriving), None
    if chosen is not None:
        at, places = chosen
        around = pointlight.around(places, normal.shape[2:])
        own = lights.on(field, places, normal[(slice(None), *around)], at)
        there = pointlight.within(glow + share * (sky + arriving), around, places)
        there += pointlight.within(share, around, places) * own
    return Sent(direct, near, there)


def passes_of(field, n, s: int, *how) -> Passes:
    """Return `Passes`, on a GPU if there is one and the field is large enough; parameters as `Passes` has them."""
    backend = device.chosen(tuple(s * size for size in field.heights.shape))
    return Passes(field, n, s, *how) if backend is None else DevicePasses(backend, field, n, s, *how)


def _fitted(field, lights: Lights, s: int, passes: Passes) -> np.ndarray:
    # Irradiance of parts of triangles from sun and lamps at their corners, straight over each: fitted to a few places in it
    facing = triangle_normals(field.heights - field.centre, field.spacing, s)
    out = np.zeros((lights.channels, 2, 3, *facing.shape[2:]), np.float32)
    if lights.lamps:
        heights = refine(field.heights, s)
        y, x = np.indices(facing.shape[2:])
        for kind in (0, 1):
            for (v, u), weights in zip(spots(kind, LAMP_PARTS), fit(kind, LAMP_PARTS).T, strict=True):
                at = np.stack([(y + v) / s, (x + u) / s, inside(heights, kind, v, u)])
                lit = lights.of_lamps(field, at, facing[:, kind])
                for corner, weight in enumerate(weights):
                    out[:, kind, corner] += np.float32(weight) * lit
        np.maximum(out, 0, out=out)
    if lights.sun is not None:
        out += light.sunlight(lights.sun, passes.shadow, facing[:, :, None], lights.channels)
    return out


def _cornered(field, lights: Lights, normal) -> np.ndarray:
    # Irradiance of triangles from sun and lamps at the very corners, (channels, 2, 3, ...)
    def shadow(azimuth, elevation, radius):
        return cornered(field._lit(azimuth, elevation, radius, lights.method))

    out = np.float32(0)
    if lights.sun is not None:
        out = light.sunlight(lights.sun, shadow, normal[:, :, None], lights.channels)
    if lights.lamps:
        grid = np.stack([*np.indices(field.heights.shape), field.heights])
        out = out + corners(lights.of_lamps(field, grid, meeting(normal)))
    return out
