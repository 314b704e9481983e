"""Figures to stand in scenes, from lathed and ellipsoidal pieces: a wooden mannequin, pawns, a vase."""

from __future__ import annotations

import numpy as np

from .meshes import Triangles, ellipsoid, join, lathe, limb

__all__ = ["mannequin", "pawn", "vase"]


def mannequin() -> tuple[Triangles, Triangles]:
    """Return a jointed artist's mannequin, 1.8 units tall, facing -y and waving.

    Returns
    -------
    wood, joints : Triangles
        Its limbs, and the balls and the stand between them.
    """
    hip, knee, ankle = (0.11, 0, 0.88), (0.14, -0.03, 0.49), (0.15, 0.02, 0.1)
    hip2, knee2, ankle2 = (-0.11, 0, 0.88), (-0.15, -0.07, 0.49), (-0.15, -0.02, 0.1)
    arm, elbow, wrist = (0.23, 0, 1.40), (0.42, -0.06, 1.22), (0.50, -0.16, 1.47)
    arm2, elbow2, wrist2 = (-0.23, 0, 1.40), (-0.34, 0.03, 1.13), (-0.37, -0.1, 0.88)
    wood = [
        ellipsoid((0, 0, 1.66), (0.105, 0.12, 0.145)),
        ellipsoid((0, 0, 1.29), (0.20, 0.125, 0.20)),
        ellipsoid((0, 0, 0.96), (0.155, 0.11, 0.125)),
        limb((0, 0, 1.44), (0, 0, 1.52), (0.05, 0.045)),
    ]
    for a, b, c in ((hip, knee, ankle), (hip2, knee2, ankle2)):
        wood += [limb(a, b, (0.065, 0.05), 0.025), limb(b, c, (0.05, 0.036), 0.022)]
        wood.append(ellipsoid((c[0], c[1] - 0.06, 0.045), (0.055, 0.12, 0.045)))
    for a, b, c in ((arm, elbow, wrist), (arm2, elbow2, wrist2)):
        wood += [limb(a, b, (0.048, 0.038), 0.014), limb(b, c, (0.038, 0.028), 0.012)]
    wood += [
        ellipsoid((0.53, -0.19, 1.56), (0.035, 0.025, 0.08)),
        ellipsoid((-0.38, -0.13, 0.79), (0.03, 0.04, 0.08)),
    ]
    balls = [(0, 0, 1.11, 0.085), (0, 0, 1.53, 0.05)]
    balls += [(*p, 0.065) for p in (hip, hip2)] + [(*p, 0.057) for p in (knee, knee2)]
    balls += [(*p, 0.055) for p in (arm, arm2)] + [(*p, 0.044) for p in (elbow, elbow2)]
    balls += [(*p, 0.036) for p in (wrist, wrist2, ankle, ankle2)]
    return join(wood), join([ellipsoid(b[:3], (b[3],) * 3, 20) for b in balls])


def pawn(segments: int = 48) -> Triangles:
    """Return a chess pawn, 1 unit tall, its foot of radius 0.3 on z = 0."""
    body = [(0, 0), (0.30, 0), (0.31, 0.05), (0.28, 0.11), (0.22, 0.14), (0.21, 0.17)]
    t = np.linspace(0, 1, 10)
    body += list(zip(0.20 - 0.12 * np.sin(t * np.pi / 2), 0.18 + 0.42 * t, strict=True))
    body += [(0.15, 0.62), (0.16, 0.645), (0.15, 0.67), (0.09, 0.69)]
    a = np.linspace(-0.9, np.pi / 2, 14)
    head = list(zip(0.17 * np.cos(a), 0.83 + 0.17 * np.sin(a), strict=True))
    head[-1] = (0.0, 1.0)
    return lathe([*body, *head], segments)


def vase(segments: int = 64) -> Triangles:
    """Return an open vase, 1 unit tall, on z = 0."""
    t = np.linspace(0, 1, 40)
    outer = 0.17 + 0.20 * np.sin(np.pi * t**0.8) ** 2 - 0.06 * t + 0.10 * t**10
    wall = 0.025
    inside = list(zip(outer[::-1] - wall, np.maximum(t[::-1], 0.04), strict=True))
    return lathe([(0, 0), *zip(outer, t, strict=True), *inside, (0, 0.04)], segments)
