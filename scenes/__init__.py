"""A library of procedural scenes: each a function that returns a Mitsuba dict."""

from .bars import grating
from .catalog import describe, load, names, parameters
from .halls import manylights
from .metal import glossy
from .picket import fence
from .shadows import openfloor, penumbra

__all__ = [
    "describe",
    "fence",
    "glossy",
    "grating",
    "load",
    "manylights",
    "names",
    "openfloor",
    "parameters",
    "penumbra",
]
