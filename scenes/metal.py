"""A rough metal floor under coloured lights."""

from __future__ import annotations

from typing import Any

from .figures import pawn, vase
from .meshes import join, move, rod, to_mitsuba
from .parts import ball, floor, matte, panel, positive, rgb, stage

__all__ = ["glossy"]


def glossy(
    roughness: float = 0.25, radiance: float = 3.2, width: int = 480, height: int = 270, spp: int = 64
) -> dict[str, Any]:
    """Mirror three coloured panels in a rough metal floor, with blockers between floor and lights.

    The integrand is peaked by the material and cut by visibility at once: the case for importance
    sampling and MIS. A disk light overhead shows the near sides of the blockers.

    Parameters
    ----------
    roughness : float
        GGX roughness α of the floor.
    radiance : float
        Scale of the panels' emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(roughness=roughness, radiance=radiance)
    metal = {"type": "roughconductor", "material": "Al", "distribution": "ggx", "alpha": roughness}
    glaze = {"type": "roughplastic", "diffuse_reflectance": rgb((0.10, 0.34, 0.46)), "alpha": 0.25}
    colours = ((1.0, 0.36, 0.12), (1.0, 0.86, 0.55), (0.14, 0.40, 1.0))
    panels = {
        f"panel{i}": panel((x, 2.7, 1.25), (0.75 * x, 0, 0.6), 1.7, 1.5, [radiance * c for c in colour])
        for i, (x, colour) in enumerate(zip((-2.1, 0.0, 2.1), colours, strict=True))
    }
    # Thin rods cut the panels' reflections into stripes, see-through for the floor before them.
    rods = [
        rod((x, 1.3, 0), (x, 1.3, 1.7), 0.035) for x in (-2.3, -1.9, -1.5, -0.45, 0.0, 0.45, 1.5, 1.9, 2.3)
    ]
    pawns = [move(pawn(), (x, y, 0), 0.85) for x, y in ((0.15, 0.1), (0.8, 0.55))]
    return stage(
        origin=(0, -5.2, 3.0),
        target=(0, 0.15, 0.2),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(metal),
        rods=to_mitsuba(join(rods), matte((0.55, 0.5, 0.45)), smooth=True, name="rods"),
        vase=to_mitsuba(
            move(vase(), (-1.0, -0.2, 0), 1.05), {"type": "twosided", "bsdf": glaze}, smooth=True
        ),
        pawns=to_mitsuba(join(pawns), matte((0.72, 0.62, 0.45)), smooth=True, name="pawns"),
        ball=ball((1.55, -0.45, 0.4), 0.4, matte((0.66, 0.16, 0.13))),
        overhead=panel((-0.6, -3.2, 4.6), (0, 0, 0.4), 1.6, 1.6, 8 * radiance, shape="disk"),
        **panels,
    )
