"""``intervis heightfield``: what it writes, and what it refuses."""

import os
import subprocess
import sys

import numpy as np
import pytest

from intervis.cli import main
from intervis.heightfield import HeightField, example, make
from intervis.images import read_exr, write_exr


def run(*words):
    return main(["heightfield", *(str(w) for w in words)])


def dem(path="dem.npz", size=24):
    heights = make("fractal", size, seed=1)
    np.savez(path, heights=heights, spacing=(2.0, 1.0))
    return HeightField(heights, (2.0, 1.0))


SUN = (np.radians(135.0), np.radians(30.0), 900.0)


def expected(field, product, k=6):
    return {
        "irradiance": lambda: field.irradiance(20.0, SUN, 0.4, bounces=1, azimuths=k)[..., 0],
        "skyview": lambda: field.sky_view(k),
        "horizons": lambda: field.horizons(k),
        "shadow": lambda: field.shadow(*SUN[:2]),
    }[product]()


LIGHT = ("--sun", "135,30,900", "--sky", 20, "--albedo", 0.4, "--bounces", 1, "--azimuths", 6)


@pytest.mark.parametrize("product", ["irradiance", "skyview", "horizons", "shadow"])
def test_products_are_those_of_the_python_side(here, product):
    field = dem()
    assert run("dem.npz", "--products", product, *LIGHT, "-o", "out.npz") == 0
    with np.load("out.npz") as data:
        found = data[product][..., 0] if product == "irradiance" else data[product]
        np.testing.assert_array_equal(found, expected(field, product))
        assert set(data) == {product, "spacing"} | ({"azimuths"} if product == "horizons" else set())


@pytest.mark.parametrize("suffix", [".exr", ".npz", ".tif", ".tiff"])
def test_every_product_in_every_format(here, capsys, suffix):
    field = dem()
    everything = "irradiance, skyview,horizons,shadow"
    assert run("dem.npz", "--products", everything, *LIGHT, "-o", f"out{suffix}") == 0
    share = expected(field, "skyview")
    if suffix == ".npz":
        with np.load("out.npz") as data:
            layers = dict(data)
    elif suffix == ".exr":
        layers, header = read_exr("out.exr")
        assert header["command"].startswith("intervis heightfield dem.npz --products") and header["azimuths"] == 6
    else:
        rasterio = pytest.importorskip("rasterio")
        with rasterio.open(f"out{suffix}") as file:
            layers = dict(zip(file.descriptions, file.read(), strict=True))
    np.testing.assert_array_equal(layers["skyview"], share)
    if suffix != ".npz":
        assert len(layers) == 9
        np.testing.assert_array_equal(layers["horizons.060.0"], expected(field, "horizons")[1])
    # The report tells the time of each, where it went, and how often each looked at the surface
    printed = capsys.readouterr().out
    for product in ("irradiance", "skyview", "horizons", "shadow"):
        assert f"{product}: " in printed and printed.count("by the naive method") == 4
    assert all(word in printed for word in ("time", "irradiance", "skyview", "horizons", "shadow", "MiB peak"))
    assert printed.rstrip().endswith(f"out{suffix}")


def test_default_names(here, capsys):
    """Here, not beside the input; a GeoTIFF's product is one too, and no product takes its own input's name."""
    (here / "data").mkdir()
    dem("data/dem.npz")
    assert run("data/dem.npz", "--products", "skyview", "--azimuths", 2) == 0
    assert run("sine", "--size", 8, "--products", "skyview", "--azimuths", 2) == 0
    write_exr("h.exr", {"heights": np.zeros((4, 5))})
    before = (here / "h.exr").read_bytes()
    assert run("h.exr", "--products", "skyview", "--azimuths", 2) == 0
    assert (here / "h.exr").read_bytes() == before
    assert {p.name for p in here.glob("*.*")} == {"dem.exr", "sine.exr", "h.exr", "h.light.exr"}
    rasterio = pytest.importorskip("rasterio")
    profile = {"count": 1, "height": 5, "width": 4, "dtype": "int16", "crs": "EPSG:32633"}
    place = rasterio.Affine(10, 0, 5e5, 0, -10, 5e6)
    with rasterio.open("dem.tif", "w", driver="GTiff", transform=place, **profile) as file:
        file.write(np.zeros((1, 5, 4), np.int16))
    assert run("dem.tif", "--azimuths", 2) == 0
    with rasterio.open("dem.light.tif") as file:
        assert file.crs.to_epsg() == 32633 and file.transform == place and file.descriptions == ("irradiance",)


def test_built_in_fields(here):
    pytest.importorskip("matplotlib")
    heights, spacing = example()
    assert run("jacksboro", "--products", "shadow", "--sun", "100,20,1", "-o", "a.npz") == 0
    with np.load("a.npz") as data:
        np.testing.assert_array_equal(data["shadow"], HeightField(heights, spacing).shadow(*np.radians([100, 20])))
        assert tuple(data["spacing"]) == spacing
    assert run("jacksboro", "--products", "shadow", "--sun", "-260,20,1", "-o", "b.npz") == 0
    with np.load("a.npz") as a, np.load("b.npz") as b:
        np.testing.assert_allclose(a["shadow"], b["shadow"], atol=1e-3)
    assert run("blocks", "--size", 20, "--products", "skyview", "--azimuths", 3, "-o", "b.npz") == 0
    with np.load("b.npz") as data:
        np.testing.assert_array_equal(data["skyview"], HeightField(make("blocks", 20)).sky_view(3))


def test_options_of_the_field(here):
    heights = make("fractal", 20)
    heights[4:6, 5:9] = np.nan
    np.save("dem.npy", heights)
    common = ("--products", "horizons", "--azimuths", 4, "-o", "out.npz")
    for words, options in (
        (("--spacing", 3), {"spacing": 3.0}),
        (("--spacing", "3,0.5"), {"spacing": (3.0, 0.5)}),
        (("--nodata-policy", "block"), {"nodata_policy": "block"}),
        (("--nodata-policy", "transparent"), {"nodata_policy": "transparent"}),
        (("--radius", 4), {"radius": 4.0}),
        (("--nodata", heights[0, 0]), {"nodata": heights[0, 0]}),
        (("--nodata", "-9999"), {}),
        (("--nodata", "-3.4e38"), {}),
        (("--curvature", "--spacing", "9000"), {"curvature": True, "spacing": 9000.0}),
    ):
        assert run("dem.npy", *words, *common) == 0
        with np.load("out.npz") as data:
            np.testing.assert_array_equal(data["horizons"], HeightField(heights, **options).horizons(4))


def test_supersampling(here):
    field = dem(size=12)
    assert run("dem.npz", *LIGHT, "--supersampling", 2, "-o", "out.npz") == 0
    with np.load("out.npz") as data:
        expected = field.irradiance(20.0, SUN, 0.4, bounces=1, azimuths=6, supersampling=2)
        np.testing.assert_array_equal(data["irradiance"], expected)
        assert (expected != field.irradiance(20.0, SUN, 0.4, bounces=1, azimuths=6)).any()


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
def test_tiles(here, capsys, suffix):
    """A tile at a time, everything comes out as it does of the whole field, but for rounding."""
    heights = make("fractal", 50, seed=1)
    heights[30:, 38:] = np.nan
    np.save("dem.npy", heights)
    words = ("dem.npy", "--spacing", "2,1", "--radius", 6, "--products", "irradiance,skyview,horizons,shadow", *LIGHT)
    assert run(*words, "-o", "whole.npz") == 0
    assert "points without data 240" in capsys.readouterr().out
    before = set(here.iterdir())
    assert run(*words, "--tile", 20, "-o", f"tiled{suffix}") == 0
    assert set(here.iterdir()) - before == {here / f"tiled{suffix}"}
    printed = capsys.readouterr().out
    assert "points without data 240" in printed and printed.count("by the naive method") == 4
    with np.load("whole.npz") as whole:
        layers = {"irradiance": whole["irradiance"][..., 0], "skyview": whole["skyview"], "shadow": whole["shadow"]}
        layers |= {f"horizons.{60 * n:03d}.0": h for n, h in enumerate(whole["horizons"])}
    if suffix == ".npz":
        with np.load("tiled.npz") as data:
            found = {n: data[n] for n in ("skyview", "shadow")} | {"irradiance": data["irradiance"][..., 0]}
            found |= {f"horizons.{60 * n:03d}.0": h for n, h in enumerate(data["horizons"])}
    else:
        rasterio = pytest.importorskip("rasterio")
        with rasterio.open("tiled.tif") as file:
            found = dict(zip(file.descriptions, file.read(), strict=True))
    assert set(found) == set(layers)
    for name, values in layers.items():
        # A sun's disk is narrow: shadows are its rounding's two hundred times
        np.testing.assert_allclose(found[name], values, rtol=1e-4, atol=3e-5, err_msg=name)


@pytest.mark.parametrize("south_up, east_left", [(False, False), (True, False), (True, True)])
def test_tiles_of_a_geotiff(here, south_up, east_left):
    """Read a tile at a time, however its rows and columns run, in metres; and written as they run."""
    rasterio = pytest.importorskip("rasterio")
    stored = np.arange(15 * 22).reshape(15, 22).astype(np.int16) ** 2 % 97
    place = rasterio.Affine(-10 if east_left else 10, 0, 5e5, 0, 10 if south_up else -10, 5e6)
    profile = {"count": 1, "height": 15, "width": 22, "dtype": "int16", "crs": "EPSG:32633", "nodata": stored[4, 5]}
    with rasterio.open("dem.tif", "w", driver="GTiff", transform=place, **profile) as file:
        file.write(stored[None])
        file.scales, file.offsets, file.units = [2.0], [100.0], ["ft"]
    words = ("dem.tif", "--radius", 35, "--products", "skyview", "--azimuths", 5)
    assert run(*words, "-o", "whole.tif") == 0 and run(*words, "--tile", 8, "-o", "tiled.tif") == 0
    with rasterio.open("whole.tif") as whole, rasterio.open("tiled.tif") as tiled:
        assert tiled.transform == place
        np.testing.assert_allclose(tiled.read(1), whole.read(1), atol=2e-6)


def test_a_geotiff_cut_short(here, capsys):
    rasterio = pytest.importorskip("rasterio")
    profile = {"count": 1, "height": 90, "width": 90, "dtype": "float32", "transform": rasterio.Affine(5, 0, 0, 0, -5, 0)}
    with rasterio.open("dem.tif", "w", driver="GTiff", blockysize=1, **profile) as file:
        file.write(np.random.default_rng(0).uniform(size=(1, 90, 90)).astype(np.float32))
    whole = (here / "dem.tif").read_bytes()
    (here / "dem.tif").write_bytes(whole[: len(whole) * 3 // 4])
    before = set(here.iterdir())
    for words in ((), ("--tile", 20)):
        assert run("dem.tif", "--radius", 3, "--products", "skyview", "--azimuths", 2, *words) == 2
        printed = capsys.readouterr().err
        assert "damaged or cut short" in printed and printed.count("\n") == 1 and set(here.iterdir()) == before


def test_a_tile_without_data(here):
    heights = make("fractal", 40, seed=1)
    heights[:, 15:] = np.nan
    np.save("dem.npy", heights)
    words = ("dem.npy", "--radius", 3, "--products", "skyview", "--azimuths", 4)
    assert run(*words, "-o", "whole.npz") == 0 and run(*words, "--tile", 10, "-o", "tiled.npz") == 0
    with np.load("whole.npz") as whole, np.load("tiled.npz") as tiled:
        np.testing.assert_allclose(tiled["skyview"], whole["skyview"], atol=2e-6)


def test_a_preview(here, capsys):
    import mitsuba as mi

    dem()
    assert run("dem.npz", *LIGHT, "--preview", "p.png") == 0
    pixels = np.array(mi.Bitmap("p.png"))
    light = read_exr("dem.exr")[0]["irradiance"]
    assert pixels.shape == (24, 24, 3) and np.corrcoef(pixels[..., 0].ravel(), light.ravel())[0, 1] > 0.9
    assert capsys.readouterr().out.splitlines()[-1].endswith("p.png")


def test_counts_of_all_directions_are_printed(here, capsys, monkeypatch):
    """What methods count adds up over directions and products; points without data are the same ones every time."""
    heights = np.zeros((6, 6))
    heights[0, 0] = np.nan
    np.save("dem.npy", heights)
    real = HeightField.horizons

    def counted(self, *args, **kw):
        out = real(self, *args, **kw)
        self.report.skipped["samples"] = 1000
        return out

    monkeypatch.setattr(HeightField, "horizons", counted)
    assert run("dem.npy", "--products", "skyview,horizons", "--azimuths", 5) == 0
    printed = capsys.readouterr().out
    assert "samples 5,000" in printed and "points without data 1" in printed


REFUSED = [
    (("missing.tif",), "does not exist"),
    (("folder.tif",), "is a folder"),
    (("poem.tif",), "cannot be read as a height map"),
    (("nowhere",), "'jacksboro' or one of fractal"),
    (("poem.txt",), "must end in one of"),
    (("dem.npz", "--products", "light"), "'products' must be one of"),
    (("dem.npz", "--products", ""), "'products' must be one of"),
    (("dem.npz", "--products", "shadow"), "--sun"),
    *[(("dem.npz", "--azimuths", k), "azimuths") for k in ("0", "-3", "2.5", "many", "1000000000")],
    *[(("dem.npz", "--bounces", b), "bounces") for b in ("-1", "0.5", "x", "1001")],
    *[(("dem.npz", "--supersampling", s), "supersampling") for s in ("0", "1.5", "17")],
    *[(("dem.npz", "--albedo", a), "albedo") for a in ("-0.1", "1.1", "nan", "grey")],
    *[
        (("dem.npz", "--sun", s), "sun")
        for s in ("1,2", "a,b,c", "1,2,3,4", "0,91,5", "0,30,-5", "nan,30,5", "", "0,30,1e39")
    ],
    *[(("dem.npz", "--sky", s), "sky") for s in ("-1", "nan", "inf", "1e39", "blue", "poem.hdr", "")],
    (("dem.npz", "--sky", "missing.exr"), "does not exist"),
    (("dem.npz", "--sky", "poem.exr"), "OpenEXR"),
    *[(("dem.npz", "--spacing", s), "spacing") for s in ("0", "-1", "a", "1,2,3", "1,", "inf", "1e-300")],
    (("dem.npz", "--nodata", "none"), "nodata"),
    (("dem.npz", "--nodata-policy", "ignore"), "'nodata_policy' must be one of fill, transparent, block"),
    *[(("dem.npz", "--radius", r), "radius") for r in ("0", "-2", "nan", "far")],
    *[(("dem.npz", "--radius", "5", "--tile", n), "tile") for n in ("0", "-1", "2.5", "x")],
    (("dem.npz", "--tile", "8"), "add --radius"),
    (("dem.npz", "--radius", "-5", "--tile", "8"), "radius"),
    (("dem.npz", "--radius", "5", "--tile", "8", "--nodata-policy", "ignore"), "nodata_policy"),
    *[(("sine", "--size", n), "must be|size") for n in ("0", "-4", "x")],
    *[(("dem.npz", "-o", o), "'output' must end in") for o in ("out", "out.jpg", "out.npy")],
    (("dem.npz", "-o", "folder.tif"), "'output' must be a file"),
    (("dem.npz", "-o", "no/such/folder.exr"), "cannot write into the folder"),
    (("dem.npz", "-o", "dem.npz"), "'output' must not be a file that is read"),
    (("dem.npz", "--sky", "sky.exr", "-o", "sky.exr"), "'output' must not be a file that is read"),
    (("dem.npz", "--preview", "p.jpg"), "'preview' must end in .png"),
    (("grey.png", "--preview", "grey.png"), "'preview' must not be a file that is read"),
    (("dem.npz", "-o", "n" * 300 + ".exr"), "File name too long"),
    (("dem.npz", "--preview", "n" * 300 + ".png"), "File name too long"),
    ((), "DEM"),
    (("dem.npz", "--colour", "red"), "--colour"),
]


@pytest.mark.parametrize("words, message", REFUSED, ids=lambda x: " ".join(x) if isinstance(x, tuple) else "")
def test_a_wrong_word_costs_one_sentence(here, capsys, words, message):
    """Exit code 2, one line on stderr that says which, and every file as it was."""
    import re

    import mitsuba as mi

    (here / "folder.tif").mkdir()
    dem()
    for name in ("poem.tif", "poem.txt", "poem.exr", "dem.exr", "out.exr"):
        (here / name).write_text("This is no height map.")
    write_exr("sky.exr", {"rgb": np.ones((2, 4, 3))})
    mi.Bitmap(np.zeros((4, 4, 1), np.uint8)).write("grey.png")

    def files():
        return {p: p.read_bytes() if p.is_file() else None for p in here.rglob("*")}

    before = files()
    assert run(*words) == 2
    printed = capsys.readouterr()
    assert files() == before and not printed.out
    assert re.search(message, printed.err) and printed.err.startswith("intervis: ") and printed.err.count("\n") == 1


def test_too_much_for_the_memory(here, capsys, monkeypatch):
    def full(*_, **__):
        raise MemoryError("Unable to allocate 150. GiB")

    monkeypatch.setattr(HeightField, "sky_view", full)
    dem()
    assert run("dem.npz", "--products", "skyview") == 2
    assert capsys.readouterr().err == "intervis: not enough memory: Unable to allocate 150. GiB\n"


def test_a_reader_that_leaves_early(here):
    """The report goes into a pipe that nobody reads any more: files are whole, and nobody sees a traceback."""
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "intervis.cli", "heightfield", "sine", "--size", "8", "--products", "skyview"]
    process = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (process.returncode, process.stderr) == (0, "")
    assert read_exr("sine.exr")[0]["skyview"].shape == (8, 8)


@pytest.mark.parametrize("name", ["OUT.NPZ", "OUT.EXR", "OUT.TIF", "n" * 250 + ".npz"])
def test_names_in_capitals_and_as_long_as_they_may_be(here, name):
    dem()
    assert run("dem.npz", "--products", "skyview", *LIGHT, "-o", name) == 0
    assert sorted(p.name for p in here.iterdir()) == sorted(["dem.npz", name])
