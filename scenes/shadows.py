"""One light and one solid blocker: the open floor, the wide penumbra and the nearly hard shadow."""

from __future__ import annotations

from typing import Any

import numpy as np

from .figures import pawn
from .meshes import blob, join, move, to_mitsuba
from .parts import checker, floor, matte, panel, positive, stage

__all__ = ["openfloor", "penumbra", "smalllight"]


def openfloor(
    light_size: float = 1.5, radiance: float = 13.0, width: int = 480, height: int = 270, spp: int = 64
) -> dict[str, Any]:
    """Nothing but a Lambertian floor under one square light: every pixel sees all of it.

    For the closed form: an integrator that knows the light is fully visible renders it without light noise.

    Parameters
    ----------
    light_size : float
        Side of the square light, 3 units above the floor.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(light_size=light_size, radiance=radiance)
    return stage(
        origin=(0, -5.2, 3.2),
        target=(0, 0.1, 0),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.72, 0.72, 0.70))),
        light=panel((0, 0, 3), (0, 0, 0), light_size, light_size, radiance),
    )


def _bumps(d: np.ndarray) -> np.ndarray:
    """Raise low, smooth hills on the unit sphere."""
    x, y, z = d.T
    return 0.13 * np.sin(3.1 * x + 0.7) * np.cos(2.3 * y - 0.4) + 0.09 * np.sin(4.2 * z + 2 * x) * np.cos(
        3 * y
    )


def penumbra(
    light_size: float = 1.5,
    blob_radius: float = 0.58,
    blob_height: float = 1.05,
    radiance: float = 14.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Cast a wide soft shadow: a smooth solid blob hovering over a floor, under a square light.

    The plain case of adaptive light sampling: a decided majority, and one connected penumbra.

    Parameters
    ----------
    light_size : float
        Side of the square light, 3 units above the floor.
    blob_radius, blob_height : float
        Mean radius of the blob, and height of its centre above the floor.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(light_size=light_size, blob_radius=blob_radius, blob_height=blob_height, radiance=radiance)
    shape = blob(blob_radius, _bumps)
    shape = shape._replace(vertices=shape.vertices + [0, 0, blob_height])
    return stage(
        origin=(0, -5.0, 3.7),
        target=(0.35, 0.2, 0.4),
        fov=38,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.72, 0.70, 0.66))),
        blob=to_mitsuba(shape, matte((0.66, 0.26, 0.16)), smooth=True, name="blob"),
        light=panel((-1.0, -0.9, 3.0), (0, 0, 0), light_size, light_size, radiance),
    )


def smalllight(
    light_size: float = 0.15, radiance: float = 40000.0, width: int = 480, height: int = 270, spp: int = 64
) -> dict[str, Any]:
    """Light pawns on a board from a tiny, distant square: shadows that are hard almost everywhere.

    Nearly every pixel is decided by one ray; penumbrae are a pixel or two wide.

    Parameters
    ----------
    light_size : float
        Side of the square light, 15 units away.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(light_size=light_size, radiance=radiance)
    light, dark = (
        ((-1.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (1.5, 1.5)),
        ((-1.5, 1.5), (0.5, 1.5), (1.5, 0.5), (-0.5, 2.5)),
    )
    pawns = [join([move(pawn(), (x, y, 0)) for x, y in side]) for side in (light, dark)]
    return stage(
        origin=(-0.6, -5.6, 3.6),
        target=(0.1, 0.45, 0.25),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(checker((0.36, 0.22, 0.14), (0.76, 0.66, 0.50), 24), 12.0),
        light_pawns=to_mitsuba(pawns[0], matte((0.80, 0.74, 0.62)), smooth=True, name="light_pawns"),
        dark_pawns=to_mitsuba(pawns[1], matte((0.26, 0.19, 0.17)), smooth=True, name="dark_pawns"),
        light=panel((-9.5, -6.0, 10.0), (0, 0, 0), light_size, light_size, radiance),
    )
