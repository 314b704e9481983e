"""A tree of leaf quads between light and ground."""

from __future__ import annotations

from typing import Any

import numpy as np

from .meshes import Triangles, join, limb, quads, to_mitsuba
from .parts import count, floor, matte, panel, positive, stage

__all__ = ["foliage"]

_GREENS = ((0.22, 0.46, 0.12), (0.36, 0.56, 0.14), (0.56, 0.58, 0.16))


def _branches(rng: np.random.Generator) -> tuple[list[Triangles], np.ndarray]:
    """Grow a trunk and two generations of branches: their limbs, and the tips (N, 3) that carry leaves."""
    fork = np.array([0.05, 0.0, 1.25])
    limbs = [limb((0, 0, -0.02), fork, (0.15, 0.10))]
    tips = []
    for k in range(7):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 7
        reach, rise = rng.uniform(0.55, 0.95), rng.uniform(0.5, 1.05)
        end = fork + [reach * np.cos(angle), reach * np.sin(angle), rise]
        limbs.append(limb(fork, end, (0.07, 0.035), segments=12))
        for _ in range(6):
            twig = end + rng.normal(0, 0.3, 3) + [0.2 * np.cos(angle), 0.2 * np.sin(angle), 0.12]
            limbs.append(limb(end, twig, (0.03, 0.012), segments=8))
            tips.append(twig)
    return limbs, np.array(tips)


def _leaves(rng: np.random.Generator, tips: np.ndarray, leaves: int, size: float) -> np.ndarray:
    """Scatter kite-shaped quads (leaves, 4, 3) in clouds about the tips."""
    center = tips[rng.integers(len(tips), size=leaves)] + rng.normal(0, 0.19, (leaves, 3))
    along = rng.normal(0, 1, (leaves, 3)) + [0, 0, -0.4]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, rng.normal(0, 1, (leaves, 3)) * [0.6, 0.6, 1.5])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    length = size * rng.uniform(0.7, 1.3, (leaves, 1))
    stem, side = center - 0.5 * length * along, center - 0.1 * length * along
    return np.stack(
        [stem, side + 0.28 * length * across, center + 0.5 * length * along, side - 0.28 * length * across], 1
    )


def foliage(
    leaves: int = 4500,
    leaf_size: float = 0.15,
    light_size: float = 1.3,
    radiance: float = 220.0,
    seed: int = 1,
    width: int = 480,
    height: int = 270,
    spp: int = 64,
) -> dict[str, Any]:
    """Stand a tree between a disk light and the ground: dappled shade under thousands of leaf quads.

    Visibility without structure: small gaps everywhere, no edge to follow.

    Parameters
    ----------
    leaves : int
        Number of leaves, two triangles each.
    leaf_size : float
        Mean length of a leaf.
    light_size : float
        Diameter of the disk light, about 6 units from the tree.
    radiance : float
        Emitted radiance, W m⁻² sr⁻¹.
    seed : int
        Seed of branches and leaves; the same seed makes the same tree.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    count(leaves=leaves)
    count(0, seed=seed)
    positive(leaf_size=leaf_size, light_size=light_size, radiance=radiance)
    rng = np.random.default_rng(seed)
    limbs, tips = _branches(rng)
    corners = _leaves(rng, tips, leaves, leaf_size)
    shades = np.array_split(corners, len(_GREENS))
    crown = {
        f"leaves{i}": to_mitsuba(quads(part), matte(green), name=f"leaves{i}")
        for i, (part, green) in enumerate(zip(shades, _GREENS, strict=True))
        if len(part)
    }
    return stage(
        origin=(1.0, -7.4, 5.8),
        target=(0.65, 0.2, 1.45),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(matte((0.62, 0.56, 0.44))),
        wood=to_mitsuba(join(limbs), matte((0.34, 0.24, 0.16)), smooth=True, name="wood"),
        light=panel((-3.0, -3.4, 6.6), (0, 0, 1.2), light_size, light_size, radiance, shape="disk"),
        **crown,
    )
