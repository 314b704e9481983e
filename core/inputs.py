"""What the user named on the command line, made into Mitsuba objects or refused in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import llvm
from .errors import InputError, mitsuba_errors, suggest

# Integrators of this package: they need a JIT variant without polarisation.
OWN = ("visdirect", "vispath")


def set_variant(variant: str, integrator: str) -> None:
    """Activate a Mitsuba variant for an integrator, or raise `InputError` if that cannot work."""
    import drjit as dr
    import mitsuba as mi

    if variant not in mi.variants():
        raise InputError(f"variant '{variant}' is unknown{suggest(variant, mi.variants())}")
    if integrator in OWN and (variant.startswith("scalar") or variant.endswith("polarized")):
        kind = "scalar" if variant.startswith("scalar") else "polarised"
        raise InputError(f"'{integrator}' cannot render in the {kind} variant '{variant}': use llvm_ad_rgb")
    if variant.startswith("llvm") and (problem := llvm.problem(dr.detail.llvm_version())):
        raise InputError(problem)
    mi.set_log_level(mi.LogLevel.Error)
    with mitsuba_errors(f"variant '{variant}' does not work here (see `intervis doctor`): "):
        mi.set_variant(variant)


def parse_settings(settings: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split ``KEY=VALUE`` words into parameters of the integrator and, for ``scene.KEY``, of the scene.

    Values become bool, int, float or str, whichever they look like first.
    """
    integrator: dict[str, Any] = {}
    scene: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key or key == "scene.":
            raise InputError(f"'--set' must look like key=value or scene.key=value (got '{setting}')")
        if key == "type":
            raise InputError("'--set' cannot change the integrator's type: use --integrator")
        target, name = (scene, key[len("scene.") :]) if key.startswith("scene.") else (integrator, key)
        target[name] = _typed(text)
    return integrator, scene


def load_scene(name: str, parameters: dict[str, Any]) -> Any:
    """Load a built-in scene by its name, or a Mitsuba XML file.

    Parameters
    ----------
    name : str
        A name from ``intervis.scenes.names()``, or the path of an XML file.
    parameters : dict
        Parameters of the scene's function, or the values of ``$key`` in the XML file.

    Returns
    -------
    mitsuba.Scene
        With at least one sensor.

    Raises
    ------
    InputError
        If there is no such scene or file, it cannot be parsed, or a parameter is unknown.
    """
    import mitsuba as mi

    from . import scenes

    check_scene(name)
    if name in scenes.names():
        with mitsuba_errors(f"scene '{name}': "):
            return mi.load_dict(scenes.load(name, **parameters))
    with mitsuba_errors():
        scene = mi.load_file(name, **{k: _text(v) for k, v in parameters.items()})
    if not isinstance(scene, mi.Scene):
        raise InputError(f"{name}: must hold a <scene> (got a {type(scene).__name__})")
    if not scene.sensors():
        raise InputError(f"{name}: the scene has no sensor, so there is nothing to render: add one")
    return scene


def check_scene(name: str) -> None:
    """Raise `InputError` unless `name` is a built-in scene or an XML file, without loading it."""
    from . import scenes

    known, path = scenes.names(), Path(name)
    if name in known:
        return
    if not path.suffix and not path.exists() and path.name == name:
        hint = suggest(name, known) or f": built in are {', '.join(known)}"
        raise InputError(f"scene '{name}' is neither a file nor built in{hint}")
    if not path.is_file():
        raise InputError(f"{name}: {'is a folder' if path.is_dir() else 'file does not exist'}")
    if path.suffix.lower() != ".xml":
        raise InputError(f"{name}: must be a Mitsuba XML file, ending in .xml")


def load_integrator(name: str, parameters: dict[str, Any]) -> Any:
    """Return the Mitsuba integrator of this plugin name, or raise `InputError`."""
    import mitsuba as mi

    with mitsuba_errors():
        integrator = mi.load_dict({"type": name, **parameters})
    if not isinstance(integrator, mi.Integrator):
        raise InputError(f"'{name}' must be an integrator (it is a {type(integrator).__name__})")
    return integrator


def _typed(text: str) -> bool | int | float | str:
    """Return text as the bool, int or float it spells, else as it is."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _text(value: object) -> str:
    """Return a value as Mitsuba's XML spells it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
