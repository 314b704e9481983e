"""Irradiance against Mitsuba's path tracing of the same surface at the same points."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from intervis.images import read_exr

SCRIPT = runpy.run_path(str(Path(__file__).parent / "make_references.py"))
FOLDER, LIGHT, fields = SCRIPT["FOLDER"], SCRIPT["LIGHT"], SCRIPT["fields"]


# What is left is light that varies within triangles, most of it on domes of eight samples, and the references' noise
@pytest.mark.parametrize("name, limit", [("sine", 0.004), ("fractal", 0.0015), ("jacksboro", 0.001)])
def test_irradiance_equals_path_tracing(name, limit):
    pytest.importorskip("matplotlib")
    layers, header = read_exr(FOLDER / f"{name}.exr")
    reference = layers["irradiance"]
    sun = (*LIGHT["sun"], 0.0)
    found = fields()[name].irradiance(**{**LIGHT, "sun": sun})[..., 0]
    error = np.sqrt(np.mean((found - reference) ** 2)) / np.sqrt(np.mean(reference**2))
    assert error < limit
    assert found.mean() == pytest.approx(reference.mean(), rel=limit)


def test_fewer_azimuths_are_worse():
    """Error falls with the number of azimuths: the references are no accident."""
    pytest.importorskip("matplotlib")
    reference = read_exr(FOLDER / "jacksboro.exr")[0]["irradiance"]
    field = fields()["jacksboro"]
    errors = []
    for k in (3, 5, 64):
        found = field.irradiance(**{**LIGHT, "sun": (*LIGHT["sun"], 0.0)}, azimuths=k)[..., 0]
        errors.append(np.sqrt(np.mean((found - reference) ** 2)))
    assert errors[0] > 1.1 * errors[1] > 1.1 * errors[2]
