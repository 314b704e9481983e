"""Whatever is passed for whatever parameter: it works, or one short sentence says what is wrong with it."""

import warnings
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from intervis import InputError
from intervis.heightfield import HeightField, make, tiles

SIDE = 6


class Sized:
    """Has a length, but holds nothing."""

    def __len__(self):
        return 3


class Failing:
    """Fails when it is asked for its numbers, at length."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("first line\nsecond line")


class Frame:
    """Gives an array on request, as tables and labelled arrays of other packages do."""

    def __array__(self, dtype=None, copy=None):
        return np.ones((SIDE, SIDE))


ODD = [
    *(None, True, -1, 3, 1.5, np.nan, np.inf, 1e300, 10**400, 1j, Fraction(1, 2), np.float32(2), np.array(2.0)),
    *("", "x", "1", "nan", b"x", Path("x"), np.array("x"), np.datetime64("2020"), memoryview(b"abc")),
    *([], (), {}, {"a": 1}, {1}, range(3), iter([1]), [None], [[]], [1, 2, 3], [[1, 2], [3]], [1e308, 1e308]),
    *(np.ma.masked, np.ma.array([1.0, 2.0], mask=[0, 1]), np.array(None), np.array([1 + 2j]), np.zeros(0), np.zeros((0, 0))),
    *(np.zeros((2, 2, 2)), np.full((SIDE, SIDE), np.nan), np.ones((SIDE, SIDE, 0)), np.ones((SIDE, SIDE, 3))),
    *(object(), Sized(), Failing(), Frame(), lambda *_: 1, int, float, slice(3), ...),
]


def light(**parameters):
    return HeightField(make("fractal", SIDE)).irradiance(**{"azimuths": 2, "bounces": 0, **parameters})


def seen(name, *args, **parameters):
    return getattr(HeightField(make("fractal", SIDE)), name)(*args, **parameters)


HEIGHTS = np.zeros((SIDE, SIDE))
CALLS = {
    "heights": lambda v: HeightField(v),
    "spacing": lambda v: HeightField(HEIGHTS, v),
    "nodata": lambda v: HeightField(HEIGHTS, nodata=v),
    "nodata_policy": lambda v: HeightField(HEIGHTS, nodata_policy=v),
    "curvature": lambda v: HeightField(HEIGHTS, curvature=v),
    "radius": lambda v: HeightField(HEIGHTS, radius=v),
    "file": lambda v: HeightField.from_file(v),
    "azimuths": lambda v: seen("horizons", v),
    "method": lambda v: seen("horizons", 2, method=v),
    "points": lambda v: seen("horizons", 2, points=v),
    "progress": lambda v: seen("horizons", 2, progress=v),
    "weighting": lambda v: seen("sky_view", 2, weighting=v),
    "view points": lambda v: seen("sky_view", 2, points=v),
    "shadow azimuth": lambda v: seen("shadow", v, 0.3),
    "shadow elevation": lambda v: seen("shadow", 1, v),
    "shadow radius": lambda v: seen("shadow", 1, 0.3, radius=v),
    "azimuth": lambda v: seen("intervisibility", v),
    "line method": lambda v: seen("intervisibility", 1, method=v),
    "bsdf": lambda v: seen("to_mitsuba", v),
    "sky": lambda v: light(sky=v),
    "sun": lambda v: light(sun=v),
    "sun azimuth": lambda v: light(sun=(v, 0.3, 3)),
    "sun elevation": lambda v: light(sun=(1, v, 3)),
    "sun irradiance": lambda v: light(sun=(1, 0.3, v)),
    "sun radius": lambda v: light(sun=(1, 0.3, 3, v)),
    "albedo": lambda v: light(albedo=v, bounces=1),
    "emission": lambda v: light(emission=v),
    "bounces": lambda v: light(bounces=v),
    "lamps": lambda v: light(lamps=v),
    "lamp": lambda v: light(lamps=[v]),
    "lamp x": lambda v: light(lamps=[(v, 1, 1, 1)]),
    "lamp intensity": lambda v: light(lamps=[(1, 1, 9, v)]),
    "tolerance": lambda v: light(tolerance=v),
    "supersampling": lambda v: light(supersampling=v),
    "tiles": lambda v: list(tiles(v, radius=3)),
    "tile spacing": lambda v: next(tiles(HEIGHTS, v, radius=3)),
    "tile radius": lambda v: list(tiles(HEIGHTS, radius=v)),
    "tile size": lambda v: list(tiles(HEIGHTS, radius=3, size=v)),
    "field": lambda v: make(v, 4),
    "field size": lambda v: make("sine", v),
    "field seed": lambda v: make("fractal", 4, v),
}


@pytest.mark.parametrize("parameter", list(CALLS))
def test_odd_values(parameter):
    refused = 0
    for value in ODD:
        # A warning is no sentence either
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                CALLS[parameter](value)
            except InputError as error:
                refused += 1
                assert "\n" not in str(error) and 20 < len(str(error)) < 250
    assert refused > len(ODD) / 2


def test_what_other_packages_call_arrays():
    """Tables and labelled arrays say what they hold when asked."""
    assert HeightField(Frame()).heights.shape == (SIDE, SIDE)
    pytest.importorskip("pandas")
    import pandas

    table = pandas.DataFrame(make("fractal", SIDE))
    np.testing.assert_array_equal(HeightField(table).heights, table.to_numpy())
    at = pandas.DataFrame({"row": [1.5, 2.0], "column": [0.5, 3.0]})
    np.testing.assert_array_equal(HeightField(table).sky_view(4, points=at), HeightField(table).sky_view(4, points=at.values))


def test_paths_of_any_kind(tmp_path):
    np.save(tmp_path / "dem.npy", HEIGHTS)
    for path in (tmp_path / "dem.npy", str(tmp_path / "dem.npy"), bytes(tmp_path / "dem.npy")):
        assert HeightField.from_file(path).heights.shape == (SIDE, SIDE)
    with pytest.raises(InputError, match="is a folder"):
        (tmp_path / "folder.npy").mkdir()
        HeightField.from_file(tmp_path / "folder.npy")


def test_masked_receivers_are_refused():
    with pytest.raises(InputError, match="'points' must lie on the field"):
        seen("horizons", 2, points=np.ma.array([[1.0, 2.0]], mask=[[True, False]]))
