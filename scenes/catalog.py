"""The scenes by name."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable
from typing import Any

from ..errors import InputError
from .bars import grating, wires
from .canopy import foliage
from .halls import manylights
from .lamps import meshlight, spheres
from .measured import cornell
from .metal import glossy
from .picket import fence
from .shadows import openfloor, penumbra, smalllight

_SCENES: dict[str, Callable[..., dict[str, Any]]] = {
    scene.__name__: scene
    for scene in (
        openfloor,
        penumbra,
        smalllight,
        grating,
        wires,
        fence,
        foliage,
        manylights,
        glossy,
        spheres,
        meshlight,
        cornell,
    )
}


def names() -> list[str]:
    """Return the names of the built-in scenes, in alphabetical order."""
    return sorted(_SCENES)


def describe(name: str) -> str:
    """Return the first sentence of a scene's documentation.

    Raises
    ------
    InputError
        If no scene has this name.
    """
    return inspect.getdoc(_find(name)).split("\n", 1)[0]


def parameters(name: str) -> dict[str, Any]:
    """Return the parameters of a scene and their defaults.

    Raises
    ------
    InputError
        If no scene has this name.
    """
    return {p.name: p.default for p in inspect.signature(_find(name)).parameters.values()}


def load(name: str, **values: Any) -> dict[str, Any]:
    """Make a built-in scene for the active Mitsuba variant.

    Parameters
    ----------
    name : str
        One of `names()`.
    **values
        Parameters of the scene function; every scene has ``width``, ``height`` and ``spp``.

    Returns
    -------
    dict
        For ``mitsuba.load_dict``: a sensor, shapes and lights, no integrator. Meshes in it belong to the
        variant that is active now.

    Raises
    ------
    InputError
        If no scene has this name, a parameter is unknown or wrong, or no variant is set.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("llvm_ad_rgb")
    >>> import intervis.scenes
    >>> scene = mi.load_dict(intervis.scenes.load("penumbra", width=96, height=54))
    >>> scene.sensors()[0].film().crop_size()
    [96, 54]
    """
    make = _find(name)
    known = parameters(name)
    for key in values:
        if key not in known:
            raise InputError(f"scene '{name}' has no parameter '{key}'{_closest(key, known)}")
    return make(**values)


def _find(name: str) -> Callable[..., dict[str, Any]]:
    if name not in _SCENES:
        raise InputError(f"there is no scene '{name}'{_closest(name, names())}")
    return _SCENES[name]


def _closest(word: str, known: Iterable[str]) -> str:
    """Name the nearest of the known words, if one is near, and list them all."""
    near = difflib.get_close_matches(str(word), known, 1, 0.5)
    hint = f" (did you mean '{near[0]}'?)" if near else ""
    return f"{hint}: choose one of {', '.join(known)}"
