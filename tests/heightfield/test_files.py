"""Height maps read from files, products written to files and read back, and files that are no height maps."""

import numpy as np
import pytest

from intervis import InputError
from intervis.heightfield import HeightField
from intervis.heightfield import products as files
from intervis.heightfield.sources import read_map
from intervis.images import read_exr, write_exr

rasterio = pytest.importorskip("rasterio")
NORTH_UP = rasterio.Affine(10, 0, 500_000, 0, -20, 5_000_000)
HEIGHTS = np.random.default_rng(0).normal(size=(9, 12)).cumsum(0).cumsum(1).astype(np.float32)


def tif(path, values=HEIGHTS, crs="EPSG:32633", transform=NORTH_UP, **profile):
    """Write bands of a GeoTIFF as others do."""
    bands = np.atleast_3d(values.T).T if values.ndim == 2 else values
    shape = {"count": len(bands), "height": bands.shape[1], "width": bands.shape[2], "dtype": bands.dtype}
    scale = {k: profile.pop(k) for k in ("scales", "offsets", "units") if k in profile}
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=transform, **shape, **profile) as file:
        file.write(bands)
        for name, value in scale.items():
            setattr(file, name, (value,))
    return path


def png(path, pixels):
    import mitsuba as mi

    mi.Bitmap(np.ascontiguousarray(pixels)).write(str(path))
    return path


# --- Read ----------------------------------------------------------------------------------------------------------


def test_a_projected_geotiff(tmp_path):
    field = HeightField.from_file(tif(tmp_path / "dem.tif"))
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert field.spacing == (20, 10) and field.valid.all()
    assert field.georeference["crs"] == rasterio.CRS.from_epsg(32633) and field.georeference["transform"] == NORTH_UP


def test_a_geographic_geotiff_is_measured_in_metres(tmp_path):
    """On the WGS 84 ellipsoid at 60° north a degree is 111.412 km long from south to north, 55.800 km from west to east."""
    transform = rasterio.Affine(1 / 3600, 0, 10, 0, -1 / 3600, 60 + 4.5 / 3600)
    field = HeightField.from_file(tif(tmp_path / "dem.tiff", crs="EPSG:4326", transform=transform))
    assert field.spacing == pytest.approx((111_412 / 3600, 55_800 / 3600), rel=1e-4)


def test_feet_become_metres(tmp_path):
    """New York's grid counts US survey feet; heights are in feet where the band says so."""
    transform = rasterio.Affine(10, 0, 9e5, 0, -10, 2e5)
    field = HeightField.from_file(tif(tmp_path / "a.tif", crs="EPSG:2263", transform=transform))
    assert field.spacing == pytest.approx((10 * 1200 / 3937,) * 2)
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    field = HeightField.from_file(tif(tmp_path / "b.tif", units="ft"))
    np.testing.assert_allclose(field.heights, HEIGHTS * 0.3048, rtol=1e-6)


@pytest.mark.parametrize("dtype", ["int16", "uint8", "uint16", "int32", "float32", "float64"])
def test_nodata_of_any_type(tmp_path, dtype):
    values = np.arange(20, 128).reshape(9, 12).astype(dtype)
    values[2:4, 5] = 0
    field = HeightField.from_file(tif(tmp_path / "dem.tif", values, nodata=0))
    assert (field.valid == (values != 0)).all()
    np.testing.assert_array_equal(field.heights[field.valid], values[field.valid])
    # Another number for unknown points, asked for by the caller, counts too
    assert (~HeightField.from_file(tmp_path / "dem.tif", nodata=20).valid).sum() == 3


def test_stored_numbers_are_scaled(tmp_path):
    values = np.arange(108).reshape(9, 12).astype(np.int16)
    field = HeightField.from_file(tif(tmp_path / "dem.tif", values, nodata=7, scales=0.1, offsets=500.0))
    np.testing.assert_allclose(field.heights[field.valid], values[field.valid] * 0.1 + 500)
    assert (~field.valid).sum() == 1


@pytest.mark.parametrize("turned", [(-1, 1), (1, -1), (-1, -1)])
def test_rows_from_the_south_and_columns_from_the_east(tmp_path, turned):
    """However a file runs, row 0 is north and column 0 west; products run as their file does."""
    a = rasterio.Affine(10 * turned[1], 0, 500_000, 0, -20 * turned[0], 5_000_000)
    field = HeightField.from_file(tif(tmp_path / "dem.tif", HEIGHTS[:: turned[0], :: turned[1]], transform=a))
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert field.spacing == (20, 10)
    files.write(tmp_path / "out.tif", {"skyview": HEIGHTS}, np.zeros(1), {}, field.spacing, field.georeference)
    with rasterio.open(tmp_path / "out.tif") as file:
        assert file.transform == a
        np.testing.assert_array_equal(file.read(1), HEIGHTS[:: turned[0], :: turned[1]])


def test_a_tif_without_a_place(tmp_path, recwarn):
    path = tif(tmp_path / "dem.tif", crs=None, transform=rasterio.Affine.identity())
    recwarn.clear()
    field = HeightField.from_file(path)
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert field.spacing == (1, 1) and not recwarn.list
    assert HeightField.from_file(path, spacing=5).spacing == (5, 5)
    files.write(tmp_path / "out.tif", {"skyview": HEIGHTS}, np.zeros(1), {}, field.spacing, field.georeference)
    assert not recwarn.list


def test_numpy_files(tmp_path):
    np.save(tmp_path / "a.npy", HEIGHTS)
    np.testing.assert_array_equal(HeightField.from_file(tmp_path / "a.npy").heights, HEIGHTS)
    np.savez(tmp_path / "b.npz", mask=HEIGHTS > 0, heights=HEIGHTS, spacing=(3.0, 2.0), nodata=HEIGHTS[1, 1])
    field = HeightField.from_file(str(tmp_path / "b.npz"))
    np.testing.assert_array_equal(field.heights[field.valid], HEIGHTS[field.valid])
    assert field.spacing == (3, 2) and not field.valid[1, 1] and field.valid.sum() == HEIGHTS.size - 1
    # The only array that can be one
    np.savez_compressed(tmp_path / "c.NPZ.npz", terrain=HEIGHTS, axis=HEIGHTS[0])
    np.testing.assert_array_equal(HeightField.from_file(tmp_path / "c.NPZ.npz").heights, HEIGHTS)


def test_openexr(tmp_path):
    for i, layers in enumerate(({"heights": HEIGHTS, "mask": HEIGHTS * 0}, {"Z": HEIGHTS}, {"only": HEIGHTS})):
        write_exr(tmp_path / f"{i}.exr", layers)
        field = HeightField.from_file(tmp_path / f"{i}.exr")
        np.testing.assert_array_equal(field.heights, HEIGHTS)
        assert field.spacing == (1, 1)
    write_exr(tmp_path / "grey.exr", {"rgb": np.repeat(HEIGHTS[..., None], 3, axis=2)}, {"spacing.y": 30.0, "spacing.x": 20})
    field = HeightField.from_file(tmp_path / "grey.exr")
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert field.spacing == (30, 20)


@pytest.mark.parametrize("dtype, channels", [("uint8", 1), ("uint16", 1), ("uint8", 2), ("uint8", 3), ("uint8", 4)])
def test_grey_png(tmp_path, dtype, channels):
    """Heights are the numbers stored, whatever the opacity."""
    values = (np.arange(108).reshape(9, 12) * (1 if dtype == "uint8" else 600)).astype(dtype)
    pixels = np.repeat(values[..., None], channels, axis=2)
    if channels in (2, 4):
        pixels[..., -1] = 255 - values
    np.testing.assert_array_equal(HeightField.from_file(png(tmp_path / "a.png", pixels)).heights, values)


# --- Written and read back -----------------------------------------------------------------------------------------

AZIMUTHS = np.arange(3) * 2 * np.pi / 3


def some_products():
    rng = np.random.default_rng(1)
    out = {
        "irradiance": rng.uniform(size=(9, 12, 3)),
        "skyview": rng.uniform(size=(9, 12)),
        "horizons": rng.normal(size=(3, 9, 12)),
        "shadow": rng.uniform(size=(9, 12)),
    }
    out = {k: v.astype(np.float32) for k, v in out.items()}
    out["skyview"][2, 3] = np.nan
    return out


def test_products_as_openexr_layers(tmp_path):
    out = some_products()
    files.write(tmp_path / "out.exr", out, AZIMUTHS, {"command": "x"}, (20.0, 10.0))
    layers, header = read_exr(tmp_path / "out.exr")
    horizons = {"horizons.000.0", "horizons.120.0", "horizons.240.0"}
    assert set(layers) == {"irradiance", "skyview", "shadow"} | horizons
    for name in ("irradiance", "skyview", "shadow"):
        np.testing.assert_array_equal(layers[name], out[name])
    np.testing.assert_array_equal(layers["horizons.120.0"], out["horizons"][1])
    assert (header["command"], header["spacing.y"], header["spacing.x"]) == ("x", 20, 10)


def test_products_as_geotiff_keep_the_georeference(tmp_path):
    field = HeightField.from_file(tif(tmp_path / "dem.tif", nodata=-9999.0))
    out = some_products()
    files.write(tmp_path / "out.tif", out, AZIMUTHS, {"command": "x"}, field.spacing, field.georeference)
    with rasterio.open(tmp_path / "out.tif") as file:
        assert file.crs == rasterio.CRS.from_epsg(32633) and file.transform == NORTH_UP and np.isnan(file.nodata)
        assert file.tags()["command"] == "x"
        bands = dict(zip(file.descriptions, file.read(), strict=True))
        assert file.read(4, masked=True).mask.sum() == 1
    np.testing.assert_array_equal(bands["irradiance.G"], out["irradiance"][..., 1])
    np.testing.assert_array_equal(bands["skyview"], out["skyview"])
    np.testing.assert_array_equal(bands["horizons.240.0"], out["horizons"][2])
    assert len(bands) == 8


def test_a_geotiff_from_other_files_keeps_the_spacing(tmp_path):
    files.write(tmp_path / "out.tif", {"skyview": HEIGHTS}, AZIMUTHS, {}, (20.0, 10.0))
    field = HeightField.from_file(tmp_path / "out.tif")
    np.testing.assert_array_equal(field.heights, HEIGHTS)
    assert field.spacing == (20, 10)


def test_products_as_an_archive(tmp_path):
    out = some_products()
    # Two directions of three, as an interruption leaves them
    out["horizons"] = out["horizons"][:2]
    files.write(tmp_path / "out.npz", out, AZIMUTHS, {}, (20.0, 10.0))
    with np.load(tmp_path / "out.npz") as data:
        for name, values in out.items():
            np.testing.assert_array_equal(data[name], values)
        np.testing.assert_array_equal(data["azimuths"], AZIMUTHS[:2])
        assert data["spacing"].tolist() == [20, 10]


def test_no_layer_takes_another_ones_name():
    """Thousands of azimuths differ by less than a tenth of a degree; channels beyond colours are numbered."""
    k = 7200
    layers = files.layers_of({"horizons": np.zeros((k, 1, 1))}, np.arange(k) * 2 * np.pi / k)
    assert len(layers) == k and "horizons.359.95" in layers
    spectrum = files.layers_of({"irradiance": np.zeros((2, 2, 5))}, np.zeros(1))
    assert list(spectrum) == [f"irradiance.{c}" for c in range(5)]


def test_nothing_is_left_of_a_file_that_cannot_be_written(tmp_path):
    for name in ("a.tif", "a.exr", "a.npz"):
        (tmp_path / name).mkdir()
        with pytest.raises(InputError, match=name):
            files.write(tmp_path / name, {"skyview": HEIGHTS}, AZIMUTHS, {}, (1.0, 1.0))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.exr", "a.npz", "a.tif"]


@pytest.mark.parametrize("name", ["irradiance", "skyview", "horizons", "shadow"])
def test_previews(tmp_path, name):
    """What a preview shows brighter is more; unknown points are black."""
    import mitsuba as mi

    rising = np.linspace(0.1, 1, 12)[None, :].repeat(9, axis=0)
    values = {"irradiance": rising[..., None] * 500, "horizons": rising[None]}.get(name, rising.copy())
    values[(0, 4, 7) if name == "horizons" else (4, 7)] = np.nan
    files.write_preview(tmp_path / "a.png", {name: values})
    pixels = np.array(mi.Bitmap(str(tmp_path / "a.png")))
    assert pixels.shape == (9, 12, 3) and (pixels[4, 7] == 0).all() and (np.diff(pixels[0, :, 0].astype(int)) >= 0).all()
    assert np.ptp(pixels[0, :, 0].astype(int)) > 100


# --- No height maps ------------------------------------------------------------------------------------------------


def cut(path):
    """Keep the first two thirds of a file."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    return path


def saved(path, **arrays):
    np.savez(path, **arrays)
    return path


def text(path, content="This is no height map.\nIt is a poem.\n"):
    path.write_text(content)
    return path


LARGE = np.random.default_rng(2).normal(size=(60, 70)).astype(np.float32)
BAD = {
    **{f"missing.{s}": (lambda p: p, "does not exist") for s in ("tif", "npz", "npy", "exr", "png")},
    **{f"empty.{s}": (lambda p: text(p, ""), "empty|cannot be read|not an") for s in ("tif", "npz", "npy", "exr", "png")},
    **{f"text.{s}": (text, "cannot be read|not an") for s in ("tif", "npz", "npy", "exr", "png")},
    "unknown.xyz": (text, "must end in"),
    "noending": (text, "must end in"),
    "cut.tif": (lambda p: cut(tif(p, LARGE)), "damaged"),
    "cut.npz": (lambda p: cut(saved(p, heights=LARGE)), "cannot be read"),
    "cut.png": (lambda p: cut(png(p, (LARGE * 40).astype(np.uint8)[..., None])), "cannot be read"),
    "coloured.png": (lambda p: png(p, np.arange(54, dtype=np.uint8).reshape(3, 6, 3)), "colours"),
    "coloured.tif": (lambda p: tif(p, np.zeros((3, 4, 5), np.uint8)), "one band"),
    "complex.tif": (lambda p: tif(p, HEIGHTS.astype(np.complex64)), "real numbers"),
    "rotated.tif": (lambda p: tif(p, transform=rasterio.Affine(10, 1, 5e5, 1, -10, 5e6)), "north up"),
    "unknown.tif": (lambda p: tif(p, HEIGHTS * 0 - 9999, nodata=-9999), "at least one known height"),
    "many.npz": (lambda p: saved(p, a=HEIGHTS, b=HEIGHTS), "'heights' .got a, b"),
    "none.npz": (lambda p: saved(p), "got nothing"),
    "lines.npz": (lambda p: saved(p, heights=HEIGHTS[0]), "two-dimensional"),
    "spacing.npz": (lambda p: saved(p, heights=HEIGHTS, spacing="wide"), "'spacing'"),
    "objects.npz": (lambda p: saved(p, heights=np.array([[None]])), "save it as an array of numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_no_height_map(tmp_path, name):
    make, message = BAD[name]
    make(tmp_path / name)
    with pytest.raises(InputError, match=message) as caught:
        HeightField.from_file(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_more_files_that_are_no_height_maps(tmp_path, capfd):
    (tmp_path / "folder.tif").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        HeightField.from_file(tmp_path / "folder.tif")
    np.save(tmp_path / "deep.npy", np.zeros((2, 3, 4)))
    with pytest.raises(InputError, match="two-dimensional"):
        HeightField.from_file(tmp_path / "deep.npy")
    np.save(tmp_path / "objects.npy", np.array([[None]]))
    with pytest.raises(InputError, match="save it as an array of numbers"):
        HeightField.from_file(tmp_path / "objects.npy")
    np.save(tmp_path / "cut.npy", LARGE)
    with pytest.raises(InputError, match="cannot be read"):
        HeightField.from_file(cut(tmp_path / "cut.npy"))
    write_exr(tmp_path / "many.exr", {"irradiance": HEIGHTS, "skyview": HEIGHTS})
    write_exr(tmp_path / "coloured.exr", {"rgb": np.random.default_rng(3).uniform(size=(4, 5, 3))})
    for name in ("many", "coloured"):
        with pytest.raises(InputError, match="one channel"):
            HeightField.from_file(tmp_path / f"{name}.exr")
    write_exr(tmp_path / "cut.exr", {"heights": LARGE})
    with pytest.raises(InputError, match="cannot be read"):
        HeightField.from_file(cut(tmp_path / "cut.exr"))


def test_environment_maps(tmp_path):
    rgb = np.random.default_rng(4).uniform(size=(4, 8, 3)).astype(np.float32)
    write_exr(tmp_path / "rgb.exr", {"rgb": rgb})
    np.testing.assert_array_equal(read_map(tmp_path / "rgb.exr"), rgb)
    write_exr(tmp_path / "grey.exr", {"Y": rgb[..., 0]})
    assert read_map(tmp_path / "grey.exr").shape == (4, 8, 1)
    write_exr(tmp_path / "other.exr", {"depth": rgb[..., 0]})
    for name, message in (("other", "channels R, G, B or Y"), ("missing", "does not exist")):
        with pytest.raises(InputError, match=message):
            read_map(tmp_path / f"{name}.exr")
