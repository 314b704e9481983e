"""A figure behind a picket fence."""

from __future__ import annotations

from typing import Any

import numpy as np

from .figures import mannequin
from .meshes import Triangles, box, join, move, prism, to_mitsuba
from .parts import count, floor, matte, panel, positive, stage

__all__ = ["fence"]


def _fence(pickets: int, period: float, height: float) -> Triangles:
    """Build pointed pickets along x at y = 0, on two rails."""
    half = 0.29 * period
    outline = [(-half, 0.05), (half, 0.05), (half, height - 0.12), (0, height), (-half, height - 0.12)]
    picket = prism(outline, 0.025)
    length = pickets * period / 2
    x = (np.arange(pickets) + 0.5) * period - length
    rails = [box((-length, 0.025, z), (length, 0.06, z + 0.08)) for z in (0.25 * height, 0.72 * height)]
    return join([move(picket, (xi, 0, 0)) for xi in x] + rails)


def fence(
    pickets: int = 27,
    period: float = 0.25,
    light_size: float = 1.2,
    radiance: float = 54.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Stand a figure behind a picket fence, both in front of a large light (the kind of the paper's Fig. 13).

    Behind the fence the light is partly visible through the gaps, on curved limbs and on the ground.

    Parameters
    ----------
    pickets : int
        Number of pickets.
    period : float
        Distance of neighbouring pickets; each fills 58 % of it.
    light_size : float
        Side of the square light, on the far side of the fence from the figure.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(pickets=pickets)
    positive(period=period, light_size=light_size, radiance=radiance)
    wood, joints = (move(p, (0.0, 0.6, 0), turn=0.7) for p in mannequin())
    return stage(
        origin=(4.4, -1.7, 3.2),
        target=(0.15, 0.5, 0.75),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.46, 0.58, 0.36))),
        fence=to_mitsuba(_fence(pickets, period, 0.95), matte((0.85, 0.84, 0.80)), name="fence"),
        figure=to_mitsuba(wood, matte((0.76, 0.56, 0.34)), smooth=True, name="figure"),
        joints=to_mitsuba(joints, matte((0.42, 0.26, 0.14)), smooth=True, name="joints"),
        light=panel((0.2, -3.6, 2.4), (0.1, 0.7, 0.6), light_size, light_size, radiance),
    )
