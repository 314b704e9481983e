"""Blockers made of bars: the grating that sweeps period against light size, and the thin-wire trap."""

from __future__ import annotations

from typing import Any

import numpy as np

from .meshes import box, join, rod, to_mitsuba
from .parts import count, floor, matte, panel, positive, stage

__all__ = ["grating", "wires"]


def grating(
    bars: int = 28,
    finest: float = 0.05,
    coarsest: float = 0.55,
    light_size: float = 1.5,
    radiance: float = 62.0,
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
        origin=(0, -5.6, 5.0),
        target=(0, -1.25, 0.1),
        fov=48,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.74, 0.72, 0.68))),
        bars=to_mitsuba(join(parts), matte((0.20, 0.36, 0.52)), name="bars"),
        light=panel((0, 3.5, 4), (0, -1.0, 0), light_size, light_size, radiance),
    )


def wires(
    strands: int = 7,
    thinnest: float = 0.0006,
    thickest: float = 0.0024,
    light_size: float = 1.5,
    radiance: float = 14.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Set the thin-wire trap: wires that hide 0.2 to 2 % of the light from the floor below them.

    A few pilot rays agree that the light is visible; an estimate that stops there is too bright. The wires
    are eight-sided prisms.

    Parameters
    ----------
    strands : int
        Number of wires, strung along x between two posts half-way up to the light.
    thinnest, thickest : float
        Radii of the first and the last wire.
    light_size : float
        Side of the square light, 3.2 units above the floor.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(strands=strands)
    positive(thinnest=thinnest, thickest=thickest, light_size=light_size, radiance=radiance)
    span, up = 2.3, 1.5
    ys = np.linspace(-0.7, 1.3, strands)
    radii = np.geomspace(thinnest, thickest, strands)
    strung = [rod((-span, y, up), (span, y, up), r, 8) for y, r in zip(ys, radii, strict=True)]
    # Each post carries a cross-arm that the wires end in.
    frame = []
    for x in (-span, span):
        frame += [
            rod((x, 0.3, 0), (x, 0.3, up), 0.04),
            box((x - 0.03, -0.85, up - 0.03), (x + 0.03, 1.45, up + 0.03)),
        ]
    return stage(
        origin=(0.6, -5.4, 4.4),
        target=(0.05, 0.0, 0.6),
        fov=48,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.70, 0.70, 0.66))),
        wires=to_mitsuba(join(strung), matte((0.25, 0.22, 0.20)), name="wires"),
        posts=to_mitsuba(join(frame), matte((0.52, 0.36, 0.22)), name="posts"),
        light=panel((0, 0, 3.2), (0, 0, 0), light_size, light_size, radiance),
    )
