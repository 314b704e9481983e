"""A library of procedural scenes: each a function that returns a Mitsuba dict."""

from .bars import grating, wires
from .canopy import foliage
from .catalog import describe, load, names, parameters
from .halls import manylights
from .lamps import meshlight, spheres
from .measured import cornell
from .metal import glossy
from .picket import fence
from .shadows import openfloor, penumbra, smalllight

__all__ = [
    "cornell",
    "describe",
    "fence",
    "foliage",
    "glossy",
    "grating",
    "load",
    "manylights",
    "meshlight",
    "names",
    "openfloor",
    "parameters",
    "penumbra",
    "smalllight",
    "spheres",
    "wires",
]
