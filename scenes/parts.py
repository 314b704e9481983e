"""The parts that the scenes share: camera and film, floor, lights, materials, checks of parameters."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from typing import Any

import mitsuba as mi

from ..errors import InputError


def require_variant() -> None:
    """Raise InputError unless a Mitsuba variant is set (transforms and meshes exist only inside one)."""
    if mi.variant() is None:
        raise InputError(
            "no Mitsuba variant is set: call mitsuba.set_variant('llvm_ad_rgb') before making a scene"
        )


def positive(**values: float) -> None:
    """Raise InputError unless every value is a finite number above zero."""
    for name, value in values.items():
        if not (isinstance(value, numbers.Real) and math.isfinite(value) and value > 0):
            raise InputError(f"'{name}' must be > 0 (got {value!r})")


def count(minimum: int = 1, **values: int) -> None:
    """Raise InputError unless every value is an integer of at least `minimum`."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < minimum:
            raise InputError(f"'{name}' must be an integer >= {minimum} (got {value!r})")


def stage(
    *,
    origin: Sequence[float],
    target: Sequence[float],
    fov: float,
    width: int,
    height: int,
    spp: int,
    up: Sequence[float] = (0, 0, 1),
    fov_axis: str = "x",
    **contents: Any,
) -> dict[str, Any]:
    """Return a scene dict: a perspective camera with the library's film, and the given contents.

    Parameters
    ----------
    origin, target, up : sequence of 3 float
        Camera position, point looked at and up direction, in scene units.
    fov : float
        Field of view in degrees along `fov_axis`.
    width, height : int
        Film size in pixels: float32 RGB with a box filter.
    spp : int
        Samples a pixel of the sensor's (independent) sampler.
    **contents
        Shapes and lights, by name.

    Returns
    -------
    dict
        Ready for ``mitsuba.load_dict``; holds no integrator.

    Raises
    ------
    InputError
        If no variant is set, or a size or count is not a positive integer.
    """
    require_variant()
    count(width=width, height=height, spp=spp)
    sensor = {
        "type": "perspective",
        "fov": fov,
        "fov_axis": fov_axis,
        "near_clip": 1e-3 * math.dist(origin, target),
        "far_clip": 1e3 * math.dist(origin, target),
        "to_world": facing(origin, target, up),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": spp},
    }
    # Mitsuba puts the emitters of a dict in a new order each time, but keeps the order of objects: with
    # several lights only those make the same picture from the same seed.
    lights = [key for key, value in contents.items() if isinstance(value, dict) and "emitter" in value]
    if len(lights) > 1:
        contents |= {key: mi.load_dict({**contents[key], "id": key}) for key in lights}
    return {"type": "scene", "sensor": sensor, **contents}


def facing(origin: Sequence[float], target: Sequence[float], up: Sequence[float] = (0, 0, 1)) -> Any:
    """Return the rigid transform that puts a shape's +z axis at `origin` pointing to `target`."""
    require_variant()
    direction = [t - o for o, t in zip(origin, target, strict=True)]
    # `up` parallel to the direction leaves the roll free: take the y axis then.
    crossed = math.dist((0, 0, 0), _cross(direction, up))
    if crossed < 1e-6 * math.dist((0, 0, 0), direction):
        up = (0, 1, 0)
    return mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def rgb(value: float | Sequence[float]) -> dict[str, Any]:
    """Return a colour (one number is a grey) as a Mitsuba spectrum dict."""
    return {"type": "rgb", "value": [float(value)] * 3 if isinstance(value, numbers.Real) else list(value)}


def matte(colour: float | Sequence[float], two_sided: bool = True) -> dict[str, Any]:
    """Return a diffuse material of this reflectance, on both sides unless told otherwise."""
    bsdf = {"type": "diffuse", "reflectance": rgb(colour)}
    return {"type": "twosided", "bsdf": bsdf} if two_sided else bsdf


def checker(dark: Sequence[float], bright: Sequence[float], squares: float) -> dict[str, Any]:
    """Return a diffuse checkerboard with `squares` squares along each side of a rectangle."""
    require_variant()
    texture = {
        "type": "checkerboard",
        "color0": rgb(dark),
        "color1": rgb(bright),
        "to_uv": mi.ScalarTransform4f().scale([squares / 2, squares / 2, 1]),
    }
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}


def floor(bsdf: dict[str, Any], half_size: float = 12.0, z: float = 0.0) -> dict[str, Any]:
    """Return a horizontal square of side ``2 half_size`` at height `z`, facing up."""
    require_variant()
    to_world = mi.ScalarTransform4f().translate([0, 0, z]).scale([half_size, half_size, 1])
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def panel(
    origin: Sequence[float],
    target: Sequence[float],
    width: float,
    height: float,
    radiance: float | Sequence[float],
    shape: str = "rectangle",
) -> dict[str, Any]:
    """Return a flat area light at `origin` that faces `target`.

    Parameters
    ----------
    origin, target : sequence of 3 float
        Centre of the light, and the point its emitting side faces.
    width, height : float
        Extents in scene units (diameters for a disk).
    radiance : float or sequence of 3 float
        Emitted radiance, W m⁻² sr⁻¹.
    shape : {'rectangle', 'disk'}
        Mitsuba's shape; both emit along their +z normal.
    """
    return {
        "type": shape,
        "to_world": facing(origin, target) @ mi.ScalarTransform4f().scale([width / 2, height / 2, 1]),
        "bsdf": matte(0.0, two_sided=False),
        "emitter": {"type": "area", "radiance": rgb(radiance)},
    }


def ball(center: Sequence[float], radius: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Return a sphere of this centre and radius."""
    return {"type": "sphere", "center": list(center), "radius": radius, "bsdf": bsdf}
