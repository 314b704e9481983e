import os
import subprocess
import sys

import numpy as np
import pytest

from intervis import InputError
from intervis.images import check_writable, read_exr, srgb, write_exr, write_png


@pytest.fixture
def layers():
    rng = np.random.default_rng(1)
    shapes = {"rgb": (5, 7, 3), "visibility.class": (5, 7), "rays.shadow": (5, 7), "error": (5, 7, 3)}
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}


def test_layers_and_header_come_back(tmp_path, layers):
    header = {"command": "intervis render — ü", "seconds": 1 / 3, "seed": 7, "rays.camera": 2**40, "spp": -1}
    write_exr(tmp_path / "a.exr", layers, header)
    read, attributes = read_exr(tmp_path / "a.exr")
    assert read.keys() == layers.keys()
    for name, layer in layers.items():
        assert read[name].dtype == np.float32
        np.testing.assert_array_equal(read[name], layer)
    assert attributes == header


def test_channels_have_the_names_that_viewers_know(tmp_path, layers):
    import OpenEXR

    write_exr(tmp_path / "a.exr", {"": layers["rgb"], "error": layers["error"], "Z": layers["rays.shadow"]})
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert sorted(file.channels()) == ["B", "G", "R", "Z", "error.B", "error.G", "error.R"]
        np.testing.assert_array_equal(file.channels()["error.G"].pixels, layers["error"][:, :, 1])


def test_mitsuba_reads_what_is_written(tmp_path, layers, variant_llvm):
    import mitsuba as mi

    write_exr(tmp_path / "a.exr", {"rgb": layers["rgb"]})
    np.testing.assert_array_equal(np.array(mi.Bitmap(str(tmp_path / "a.exr"))), layers["rgb"])


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, layers, monkeypatch):
    write_exr(tmp_path / "a.exr", layers)
    before = (tmp_path / "a.exr").read_bytes()

    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        write_exr(tmp_path / "a.exr", {"rgb": layers["rgb"]})
    assert (tmp_path / "a.exr").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize(
    "bad",
    [
        {},
        {"rgb": np.zeros((2, 2, 4))},
        {"": np.zeros((2, 2))},
        {"rgb": np.zeros((2, 2, 3)), "x": np.zeros((2, 3))},
        {"x": np.zeros((0, 3))},
    ],
    ids=["none", "four channels", "no name", "two sizes", "no pixels"],
)
def test_layers_that_make_no_image_are_refused(tmp_path, bad):
    with pytest.raises(InputError):
        write_exr(tmp_path / "a.exr", bad)
    assert list(tmp_path.iterdir()) == []


def test_a_reserved_header_key_is_refused(tmp_path, layers):
    with pytest.raises(InputError, match="'compression' is reserved"):
        write_exr(tmp_path / "a.exr", layers, {"compression": "none"})


def test_files_that_are_no_exr_are_refused(tmp_path):
    (tmp_path / "a.exr").write_text("nothing")
    with pytest.raises(InputError, match="not an OpenEXR"):
        read_exr(tmp_path / "a.exr")
    with pytest.raises(InputError, match="does not exist"):
        read_exr(tmp_path / "b.exr")


def test_a_link_stays_and_leads_to_the_new_file(tmp_path, layers):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.exr").symlink_to("there/a.exr")
    write_exr(tmp_path / "link.exr", layers)
    assert (tmp_path / "link.exr").is_symlink()
    assert read_exr(tmp_path / "there" / "a.exr")[0].keys() == layers.keys()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a.exr", "link.exr", "there"]


def test_a_truncated_exr_is_refused(tmp_path, layers, capfd):
    write_exr(tmp_path / "a.exr", layers)
    whole = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "b.exr").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="damaged or cut short"):
        read_exr(tmp_path / "b.exr")
    assert capfd.readouterr() == ("", "")


def test_srgb_by_the_standards_own_numbers():
    # IEC 61966-2-1: linear below 0.0031308, 1.055 x^(1/2.4) − 0.055 above.
    linear = np.array([0.0, 0.002, 0.18, 0.5, 1.0, 2.0, -1.0, np.nan], dtype=np.float32)
    expected = [0.0, 12.92 * 0.002, 1.055 * 0.18 ** (1 / 2.4) - 0.055, 0.7353570, 1.0, 1.0, 0.0, 0.0]
    np.testing.assert_allclose(srgb(linear), expected, atol=1e-6)


def test_png_holds_the_encoded_bytes(tmp_path, variant_llvm):
    import mitsuba as mi

    rgb = np.zeros((2, 3, 3))
    rgb[0, 1] = (0.5, 1.0, 7.0)
    rgb[1, 2] = np.nan
    write_png(tmp_path / "a.png", rgb)
    pixels = np.array(mi.Bitmap(str(tmp_path / "a.png")))
    assert pixels.shape == (2, 3, 3) and pixels.dtype == np.uint8
    assert pixels[0, 1].tolist() == [188, 255, 255]
    assert pixels.sum() == 188 + 255 + 255


def test_png_of_a_wrong_shape_is_refused(tmp_path):
    with pytest.raises(InputError, match="shape"):
        write_png(tmp_path / "a.png", np.zeros((2, 2, 2)))


def test_outputs_are_checked_before_there_is_anything_to_write(tmp_path):
    assert check_writable(tmp_path / "a.exr", ".exr") == tmp_path / "a.exr"
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "b.exr").mkdir()
    (tmp_path / "file").write_text("")
    for path, message in [
        ("a.png", "must end in .exr"),
        ("b.exr", "the folder"),
        ("none/a.exr", "cannot write into"),
        ("file/a.exr", "cannot write into"),
    ]:
        with pytest.raises(InputError, match=message):
            check_writable(tmp_path / path, ".exr")


def test_pictures_leave_numpy_printing_as_it_was():
    """Importing colour sets NumPy's legacy print mode, in which numbers lose digits."""
    code = (
        "import intervis, numpy as np; from intervis.images import srgb;"
        "srgb(np.zeros((1, 1, 3))); print(str(np.float64(1 / 3)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(out) == 1 / 3
