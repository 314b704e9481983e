"""Blockers made of bars: the grating that sweeps period against light size."""

from __future__ import annotations

from typing import Any

import numpy as np

from .meshes import box, join, to_mitsuba
from .parts import count, floor, matte, panel, positive, stage

__all__ = ["grating"]


def grating(
    bars: int = 28,
    finest: float = 0.05,
    coarsest: float = 0.55,
    light_size: float = 1.5,
    radiance: float = 20.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Sweep bar period against light size: an upright grating with the light behind it.

    The period grows from left to right, and the light's image through the bars grows from the bars' feet
    towards the camera, so one picture holds every ratio of the two.

    Parameters
    ----------
    bars : int
        Number of bars.
    finest, coarsest : float
        Period at the left and at the right end; a bar fills half of it.
    light_size : float
        Side of the square light, 4 units up and 3.5 units behind the grating.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(bars=bars)
    positive(finest=finest, coarsest=coarsest, light_size=light_size, radiance=radiance)
    period = np.geomspace(finest, coarsest, bars)
    left = np.concatenate([[0], np.cumsum(period)])
    left = left - left[-1] / 2
    parts = [box((x, 0, 0), (x + p / 2, 0.05, 1.8)) for x, p in zip(left[:-1], period, strict=True)]
    return stage(
        origin=(0, -6.5, 4.2),
        target=(0, -1.1, 0.3),
        fov=48,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.74, 0.72, 0.68))),
        bars=to_mitsuba(join(parts), matte((0.20, 0.36, 0.52)), name="bars"),
        light=panel((0, 3.5, 4), (0, -1.0, 0), light_size, light_size, radiance),
    )
