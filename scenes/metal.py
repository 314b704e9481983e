"""A rough metal floor under coloured lights."""

from __future__ import annotations

from typing import Any

from .figures import vase
from .meshes import box, join, move, to_mitsuba
from .parts import ball, floor, matte, panel, positive, stage

__all__ = ["glossy"]


def glossy(
    roughness: float = 0.3, radiance: float = 6.0, width: int = 480, height: int = 270, spp: int = 64
) -> dict[str, Any]:
    """Mirror three coloured lights in a rough metal floor, with blockers between floor and lights.

    The integrand is peaked by the material and cut by visibility at once: the case for importance
    sampling and MIS.

    Parameters
    ----------
    roughness : float
        GGX roughness α of the floor.
    radiance : float
        Scale of the lights' emitted radiance, W m⁻² sr⁻¹.
    width, height, spp : int
        Film size in pixels, and samples a pixel.
    """
    positive(roughness=roughness, radiance=radiance)
    metal = {"type": "roughconductor", "material": "Al", "distribution": "ggx", "alpha": roughness}
    glaze = {
        "type": "roughplastic",
        "diffuse_reflectance": {"type": "rgb", "value": [0.12, 0.30, 0.42]},
        "distribution": "ggx",
        "alpha": 0.25,
    }
    colours = ((1.0, 0.55, 0.25), (0.95, 0.95, 0.9), (0.3, 0.55, 1.0))
    lights = {
        f"light{i}": panel((x, 3.2, 2.3), (0.4 * x, -1.0, 0), 1.1, 1.6, [radiance * c for c in colour])
        for i, (x, colour) in enumerate(zip((-2.1, 0.0, 2.1), colours, strict=True))
    }
    posts = [box((x - 0.06, 1.2, 0), (x + 0.06, 1.32, 1.7)) for x in (-2.6, -1.3, 0.0, 1.3, 2.6)]
    return stage(
        origin=(0, -5.2, 2.2),
        target=(0, 0.4, 0.45),
        fov=42,
        width=width,
        height=height,
        spp=spp,
        floor=floor(metal),
        posts=to_mitsuba(join(posts), matte((0.6, 0.56, 0.5)), name="posts"),
        vase=to_mitsuba(move(vase(), (-0.9, -0.6, 0), 0.95), {"type": "twosided", "bsdf": glaze}, smooth=True),
        ball=ball((0.95, -0.5, 0.45), 0.45, glaze),
        **lights,
    )
