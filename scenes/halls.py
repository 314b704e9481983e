"""Rooms with many lights."""

from __future__ import annotations

from typing import Any

import numpy as np

from .figures import vase
from .meshes import Triangles, box, join, lathe, move, to_mitsuba
from .parts import count, floor, matte, panel, positive, stage

__all__ = ["manylights"]


def _column(height: float) -> Triangles:
    """Build a round column with a square foot and head."""
    shaft = [(0.24, 0.1), (0.24, 0.18), (0.19, 0.22), (0.16, height - 0.25), (0.24, height - 0.12)]
    slabs = [box((-0.27, -0.27, z), (0.27, 0.27, z + 0.12)) for z in (0.0, height - 0.12)]
    return join([lathe(shaft, 32), *slabs])


def manylights(
    rows: int = 6,
    columns: int = 3,
    light_size: float = 0.5,
    radiance: float = 24.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Light a colonnade by many ceiling panels of different colours and powers.

    Each point is in the full light of some, in the penumbra of some and behind a column for others.

    Parameters
    ----------
    rows, columns : int
        Panels along and across the hall (18 by default).
    light_size : float
        Side of a square panel.
    radiance : float
        Mean emitted radiance, W m⁻² sr⁻¹; single panels emit from a third to twice of it.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(rows=rows, columns=columns)
    positive(light_size=light_size, radiance=radiance)
    rng = np.random.default_rng(7)
    tints = np.array([(1.0, 0.70, 0.38), (0.45, 0.70, 1.0), (1.0, 0.40, 0.32), (0.45, 1.0, 0.62)])
    top = 2.8
    xs, ys = np.linspace(-1.9, 1.9, columns), np.linspace(-2.0, 7.5, rows)
    lights = {}
    for i, (y, x) in enumerate((y, x) for y in ys for x in xs):
        colour = radiance * np.geomspace(1 / 3, 2, 6)[rng.integers(6)] * tints[i % 4]
        lights[f"light{i:02d}"] = panel(
            (x, y, top - 0.01), (x, y, 0), light_size, light_size, colour.tolist()
        )
    pillars = [move(_column(top), (x, y, 0)) for y in (0.0, 2.0, 4.0, 6.0) for x in (-1.3, 1.3)]
    walls = [
        box((-3.2, -7, 0), (-3, 9, top)),
        box((3, -7, 0), (3.2, 9, top)),
        box((-3.2, 8.8, 0), (3.2, 9, top)),
        box((-3.2, -7, top), (3.2, 9, top + 0.1)),
    ]
    vases = [move(vase(), (x, y, 0), 0.8) for x, y in ((0.0, 1.0), (-0.5, 3.0), (0.5, 5.0))]
    return stage(
        origin=(0.0, -4.6, 1.9),
        target=(0, 2.5, 0.9),
        fov=58,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.62, 0.58, 0.54))),
        walls=to_mitsuba(join(walls), matte((0.72, 0.68, 0.60)), name="walls"),
        pillars=to_mitsuba(join(pillars), matte((0.78, 0.75, 0.70)), name="pillars"),
        vases=to_mitsuba(join(vases), matte((0.25, 0.42, 0.50)), smooth=True, name="vases"),
        **lights,
    )
