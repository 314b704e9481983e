"""The Cornell box, from the measured data."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .meshes import Triangles, quads, to_mitsuba
from .parts import matte, positive, rgb, stage

__all__ = ["cornell"]

# Quadrilaterals in millimetres as published by the Cornell University Program of Computer Graphics ("The
# Cornell Box", measured data): x to the left of the viewer, y up, z away from the viewer.
LIGHT = ((343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227))
FLOOR = ((552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2))
CEILING = ((556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0))
BACK = ((549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2))
RIGHT = ((0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2))
LEFT = ((552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0))
SHORT_BLOCK = (
    ((130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)),
    ((290, 0, 114), (290, 165, 114), (240, 165, 272), (240, 0, 272)),
    ((130, 0, 65), (130, 165, 65), (290, 165, 114), (290, 0, 114)),
    ((82, 0, 225), (82, 165, 225), (130, 165, 65), (130, 0, 65)),
    ((240, 0, 272), (240, 165, 272), (82, 165, 225), (82, 0, 225)),
)
TALL_BLOCK = (
    ((423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)),
    ((423, 0, 247), (423, 330, 247), (472, 330, 406), (472, 0, 406)),
    ((472, 0, 406), (472, 330, 406), (314, 330, 456), (314, 0, 456)),
    ((314, 0, 456), (314, 330, 456), (265, 330, 296), (265, 0, 296)),
    ((265, 0, 296), (265, 330, 296), (423, 330, 247), (423, 0, 247)),
)
# Camera of the published data: position, direction +z, film of 25 mm behind a lens of 35 mm.
CAMERA = (278, 273, -800)
FIELD_OF_VIEW = math.degrees(2 * math.atan(25 / 2 / 35))
# The measured spectra under RGB, rounded.
WHITE, GREEN, RED = (0.73, 0.71, 0.68), (0.14, 0.45, 0.09), (0.63, 0.06, 0.05)
EMISSION = (18.4, 14.0, 6.8)


def _ceiling() -> list[tuple[tuple[float, float, float], ...]]:
    """Build the ceiling around the opening that holds the light: four quadrilaterals."""
    (x1, y, z0), _, (x0, _, z1), _ = LIGHT
    right, left, back = 0.0, 556.0, 559.2
    return [
        ((left, y, 0), (left, y, back), (x1, y, back), (x1, y, 0)),
        ((x0, y, 0), (x0, y, back), (right, y, back), (right, y, 0)),
        ((x1, y, 0), (x1, y, z0), (x0, y, z0), (x0, y, 0)),
        ((x1, y, z1), (x1, y, back), (x0, y, back), (x0, y, z1)),
    ]


def _faces(*quadrilaterals: Any) -> Triangles:
    return quads(np.array(quadrilaterals, float))


def cornell(brightness: float = 1.0, width: int = 480, height: int = 270, spp: int = 64) -> dict[str, Any]:
    """Build the measured Cornell box: published vertices and camera, reflectances as RGB.

    The box is square: on a wide film the pixels at its sides look past it, at nothing.

    Parameters
    ----------
    brightness : float
        Scale of the light's emission.
    width, height, spp : int
        Film size in pixels, and samples a pixel.

    References
    ----------
    Cornell University Program of Computer Graphics, "The Cornell Box": measured geometry, reflectances and
    emission.
    """
    positive(brightness=brightness)
    emitter = {"type": "area", "radiance": rgb([brightness * e for e in EMISSION])}
    return stage(
        origin=CAMERA,
        target=(278, 273, 0),
        up=(0, 1, 0),
        fov=FIELD_OF_VIEW,
        fov_axis="smaller",
        width=width,
        height=height,
        spp=spp,
        shell=to_mitsuba(_faces(FLOOR, BACK, *_ceiling()), matte(WHITE), name="shell"),
        right=to_mitsuba(_faces(RIGHT), matte(GREEN), name="right"),
        left=to_mitsuba(_faces(LEFT), matte(RED), name="left"),
        short_block=to_mitsuba(_faces(*SHORT_BLOCK), matte(WHITE), name="short_block"),
        tall_block=to_mitsuba(_faces(*TALL_BLOCK), matte(WHITE), name="tall_block"),
        light=to_mitsuba(_faces(LIGHT), matte(0.78, two_sided=False), emitter=emitter, name="light"),
    )
