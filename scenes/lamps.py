"""Lights that are not flat: glowing spheres, and a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from .figures import mannequin, pawn, vase
from .meshes import Triangles, join, move, to_mitsuba, tube
from .parts import ball, checker, count, floor, matte, positive, rgb, stage

__all__ = ["meshlight", "spheres"]


def spheres(
    light_radius: float = 0.17, radiance: float = 22.0, width: int = 480, height: int = 270, spp: int = 64
) -> dict[str, Any]:
    """Set three glowing globes among pawns, a vase and balls: sphere lights close to what they light.

    Parameters
    ----------
    light_radius : float
        Radius of the largest globe; the others have 0.8 and 0.65 of it.
    radiance : float
        Emitted radiance of the largest globe, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(light_radius=light_radius, radiance=radiance)
    places = ((-0.55, 0.15, 1.05), (1.25, -0.25, 0.80), (0.35, 1.50, 1.0))
    colours = ((1.0, 0.72, 0.40), (0.40, 0.66, 1.0), (1.0, 0.46, 0.38))
    globes = {}
    for i, (place, colour, scale) in enumerate(zip(places, colours, (1.0, 0.8, 1.1), strict=True)):
        globe = ball(place, scale * light_radius, matte(0.0, two_sided=False))
        globe["emitter"] = {"type": "area", "radiance": rgb([radiance / scale**2 * c for c in colour])}
        globes[f"globe{i}"] = globe
    white = [move(pawn(), p, 0.8) for p in ((-1.5, -0.2, 0), (-0.9, 0.95, 0), (0.35, -0.55, 0))]
    black = [move(pawn(), p, 0.8) for p in ((1.75, 0.5, 0), (1.0, 1.2, 0), (2.0, -0.75, 0))]
    return stage(
        origin=(0.2, -5.0, 3.0),
        target=(0.2, 0.2, 0.35),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(checker((0.34, 0.30, 0.27), (0.70, 0.66, 0.60), 30), 12.0),
        white=to_mitsuba(join(white), matte((0.78, 0.72, 0.60)), smooth=True, name="white"),
        black=to_mitsuba(join(black), matte((0.20, 0.16, 0.15)), smooth=True, name="black"),
        vase=to_mitsuba(
            move(vase(), (0.35, 0.75, 0), 0.9), matte((0.25, 0.50, 0.48)), smooth=True, name="vase"
        ),
        ball=ball((-0.55, -0.75, 0.26), 0.26, matte((0.72, 0.20, 0.16))),
        **globes,
    )


def _knot(points: int, segments: int) -> Triangles:
    """Build a trefoil knot of height 1 about the origin, its axis along y."""
    t = 2 * np.pi * np.arange(points) / points
    r = 0.34 + 0.13 * np.cos(3 * t)
    path = np.stack([r * np.cos(2 * t), 0.15 * np.sin(3 * t), r * np.sin(2 * t)], -1)
    return tube(path, 0.05, segments)


def meshlight(
    points: int = 120,
    segments: int = 8,
    radiance: float = 18.0,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Greet a glowing trefoil knot, a light of some two thousand triangles.

    The light shadows itself, and its triangles face every way: most cannot reach a given point.

    Parameters
    ----------
    points, segments : int
        Vertices along the knot and around its tube: ``2 points segments`` triangles, no vertex normals.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(8, points=points)
    count(3, segments=segments)
    positive(radiance=radiance)
    knot = move(_knot(points, segments), (0.85, -0.15, 1.02), 1.1)
    wood, joints = (move(p, (-0.65, 0.15, 0), turn=0.9) for p in mannequin())
    glow = {"type": "area", "radiance": rgb((radiance, 0.78 * radiance, 0.48 * radiance))}
    pawns = [move(pawn(), p, 0.6) for p in ((0.15, -0.75, 0), (1.9, 0.1, 0), (1.1, 1.0, 0), (-1.5, -0.35, 0))]
    return stage(
        origin=(0.2, -5.0, 2.9),
        target=(0.15, 0.1, 0.78),
        fov=43,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.55, 0.56, 0.60))),
        figure=to_mitsuba(wood, matte((0.76, 0.56, 0.34)), smooth=True, name="figure"),
        joints=to_mitsuba(joints, matte((0.42, 0.26, 0.14)), smooth=True, name="joints"),
        pawns=to_mitsuba(join(pawns), matte((0.30, 0.45, 0.55)), smooth=True, name="pawns"),
        knot=to_mitsuba(knot, matte(0.0, two_sided=False), emitter=glow, name="knot"),
    )
