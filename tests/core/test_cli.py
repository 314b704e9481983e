import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from intervis import Report, scenes
from intervis.cli import main
from intervis.images import read_exr, write_exr

SCENE = """<scene version="3.0.0">
  <default name="width" value="12"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <sampler type="independent"><integer name="sample_count" value="3"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="$width"/> <integer name="height" value="8"/>
      <string name="pixel_format" value="FORMAT"/>
    </film>
  </sensor>
  <shape type="sphere">
    <point name="center" x="0" y="0" z="5"/>
    <emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter>
  </shape>
</scene>
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, variant_llvm):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.xml").write_text(SCENE.replace("FORMAT", "rgb"))
    return tmp_path


@pytest.fixture
def counting():
    """Register an integrator that brings layers and a report of its own, as this package's do."""
    import mitsuba as mi

    class Counting(mi.SamplingIntegrator):
        def __init__(self, props):
            super().__init__(props)
            self.fault = props.get("fault", "")
            self.report = None

        def sample(self, scene, sampler, ray, medium=None, active=True):
            if self.fault == "interrupt":
                os.kill(os.getpid(), signal.SIGINT)
            if self.fault == "error":
                raise ValueError("the light\nis out")
            rays, skipped = {"camera": 7, "pilot": 2}, {"missed": 3}
            self.report = Report(wall_s=1.5, rays=rays, skipped=skipped, error=0.25)
            return mi.Spectrum(0.5), mi.Bool(True), [mi.Float(2.0), mi.Float(64.0)] + 3 * [mi.Float(0.1)]

        def aov_names(self):
            return ["visibility.class", "rays.shadow", "error.R", "error.G", "error.B"]

    mi.register_integrator("counting", Counting)
    return "counting"


def refused(capsys, *argv):
    """Run a command that must fail on its input; return the sentence it printed."""
    before = sorted(os.listdir())
    assert main(list(argv)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("intervis: ") and captured.err.count("\n") == 1
    assert "Traceback" not in captured.err and captured.out == ""
    assert sorted(os.listdir()) == before
    return captured.err


def test_render_of_an_xml_file(capsys):
    assert main(["render", "ball.xml", "--integrator", "direct", "--spp", "4", "--seed", "9"]) == 0
    layers, header = read_exr("ball.exr")
    assert list(layers) == ["rgb"] and layers["rgb"].shape == (8, 12, 3)
    # The ball fills the middle of the picture, with the radiance the file says.
    np.testing.assert_allclose(layers["rgb"][4, 6], [1, 2, 3], rtol=1e-4)
    assert header["command"] == "intervis render ball.xml --integrator direct --spp 4 --seed 9"
    assert (header["spp"], header["seed"], header["variant"]) == (4, 9, "llvm_ad_rgb")
    assert header["rays.camera"] == 4 * 8 * 12 and header["seconds"] > 0
    assert header["mitsuba"] and header["intervis"] and header["drjit"]
    report = capsys.readouterr().out
    assert "camera 384" in report and "ball.exr" in report


def test_the_files_own_sample_count_is_the_default(capsys):
    assert main(["render", "ball.xml", "--integrator", "direct"]) == 0
    assert read_exr("ball.exr")[1]["spp"] == 3


def test_render_of_a_built_in_scene_with_parameters():
    size = ["--set", "scene.width=32", "--set", "scene.height=18"]
    command = ["render", "penumbra", "--integrator", "direct", "--spp", "1", *size, "-o", "p.exr", "--png"]
    assert main(command) == 0
    assert read_exr("p.exr")[0]["rgb"].shape == (18, 32, 3)
    assert sorted(p for p in os.listdir() if p.startswith("p.")) == ["p.exr", "p.png"]


def test_pictures_are_checked_before_rendering(folder, capsys):
    (folder / "p.class.png").mkdir()
    assert "the folder p.class.png" in refused(capsys, "render", "ball.xml", "--aovs", "-o", "p.exr", "--png")
    assert "is a folder" in refused(capsys, "render", str(folder))
    # Without layers no map is drawn
    assert main(["render", "ball.xml", "--integrator", "direct", "-o", "p.exr", "--png"]) == 0


def test_render_with_an_xml_files_own_parameter():
    assert main(["render", "ball.xml", "--integrator", "direct", "--set", "scene.width=20"]) == 0
    assert read_exr("ball.exr")[0]["rgb"].shape == (8, 20, 3)


@pytest.mark.parametrize(
    ("pixel_format", "names"),
    [("rgba", {"rgb", "A"}), ("luminance", {"Y"}), ("luminance_alpha", {"Y", "A"})],
)
def test_other_films_keep_their_channels(folder, pixel_format, names):
    (folder / "ball.xml").write_text(SCENE.replace("FORMAT", pixel_format))
    assert main(["render", "ball.xml", "--integrator", "direct", "--png"]) == 0
    layers, _ = read_exr("ball.exr")
    assert set(layers) == names
    if "A" in names:
        assert layers["A"][4, 6] == 1 and layers["A"][0, 0] == 0


@pytest.mark.parametrize("variant", ["llvm_ad_mono", "llvm_ad_spectral", "scalar_rgb"])
def test_other_variants(variant):
    assert main(["render", "ball.xml", "--integrator", "direct", "--variant", variant]) == 0
    layers, header = read_exr("ball.exr")
    assert header["variant"] == variant and all(np.isfinite(layer).all() for layer in layers.values())


def test_integrator_parameters_have_types():
    from intervis.inputs import parse_settings

    words = ["a=3", "b=0.5", "c=true", "d=False", "e=mlp", "f=1e-3", "g=x=y", "scene.h=2"]
    integrator, scene = parse_settings(words)
    assert integrator == {"a": 3, "b": 0.5, "c": True, "d": False, "e": "mlp", "f": 1e-3, "g": "x=y"}
    assert type(integrator["a"]) is int and scene == {"h": 2}


def test_layers_and_the_report_of_an_integrator_are_kept(counting, capsys):
    assert main(["render", "ball.xml", "--integrator", counting, "--png"]) == 0
    layers, header = read_exr("ball.exr")
    assert set(layers) == {"rgb", "visibility.class", "rays.shadow", "error"}
    np.testing.assert_allclose(layers["visibility.class"], 2.0, rtol=1e-5)
    np.testing.assert_allclose(layers["error"], 0.1, rtol=1e-5)
    assert header["rays.pilot"] == 2 and header["skipped.missed"] == 3
    assert header["seconds"] == 1.5 and header["error"] == 0.25
    assert "missed 3" in capsys.readouterr().out
    assert {"ball.png", "ball.class.png", "ball.rays.png"} <= set(os.listdir())


def test_an_interruption_leaves_nothing(counting, capsys):
    assert main(["render", "ball.xml", "--integrator", counting, "--set", "fault=interrupt"]) == 130
    assert capsys.readouterr().err == "intervis: interrupted\n"
    assert os.listdir() == ["ball.xml"]


def test_an_error_inside_a_render_is_one_sentence(counting, capsys):
    message = refused(capsys, "render", "ball.xml", "--integrator", counting, "--set", "fault=error")
    assert message.endswith("the light is out\n")


def test_an_existing_file_survives_a_failed_render(counting, capsys):
    write_exr("ball.exr", {"rgb": np.ones((2, 2, 3))})
    refused(capsys, "render", "ball.xml", "--integrator", counting, "--set", "fault=error")
    assert read_exr("ball.exr")[0]["rgb"].shape == (2, 2, 3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("render missing.xml", "missing.xml: file does not exist"),
        ("render penumbraa", "did you mean 'penumbra'"),
        ("render qqq", "built in are"),
        ("render ball.xml --spp 0", "'spp' must be >= 1"),
        ("render ball.xml --spp -3", "'spp' must be >= 1"),
        ("render ball.xml --spp 99999999999", "below 2**32"),
        ("render ball.xml --spp many", "invalid int value"),
        ("render ball.xml --seed -1", "'seed'"),
        ("render ball.xml --threshold nan", "'threshold'"),
        ("render ball.xml --variant llvm_ad_rgbb", "did you mean 'llvm_ad_rgb'"),
        ("render ball.xml --variant scalar_rgb", "scalar variant"),
        ("render ball.xml --variant llvm_ad_mono_polarized", "polarised variant"),
        ("render ball.xml --integrator vispath --variant scalar_spectral", "scalar variant"),
        ("render ball.xml --integrator nix", "no plugin 'nix'"),
        ("render ball.xml --integrator sphere", "must be an integrator"),
        ("render ball.xml --integrator direct --set foo=3", "no parameter 'foo'"),
        ("render ball.xml --integrator direct --aovs", "no parameter 'aovs'"),
        ("render ball.xml --integrator direct --set scene.foo=3", "no parameter 'foo'"),
        ("render penumbra --integrator direct --set scene.foo=3", "no parameter 'foo'"),
        ("render ball.xml --set foo", "key=value"),
        ("render ball.xml --set type=path", "--integrator"),
        ("render ball.xml -o none/x.exr", "cannot write into the folder"),
        ("render ball.xml -o x.png", "must end in .exr"),
        ("render", "required: SCENE"),
        ("paint", "invalid choice"),
        ("", "required: COMMAND"),
        ("compare a.exr b.exr", "a.exr: file does not exist"),
        ("compare ball.xml ball.xml", "not an OpenEXR"),
        ("compare a.exr b.exr --metric ssim", "invalid choice"),
        ("compare a.exr b.exr --metric psnr --fail-above 3", "psnr"),
        ("compare a.exr b.exr -o diff.jpg", "must end in .png"),
    ],
)
def test_wrong_inputs_are_one_sentence(capsys, words, said):
    assert said in refused(capsys, *words.split())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</film>", "", "line"),
        ('type="sphere"', 'type="spherr"', "no plugin 'spherr'"),
        ('name="center"', 'name="centre"', "no parameter 'centre'"),
        (SCENE.replace("FORMAT", "rgb"), "", "No document element"),
    ],
    ids=["tags", "plugin", "parameter", "empty"],
)
def test_malformed_xml_names_the_file_and_the_line(folder, capsys, old, new, said):
    text = SCENE.replace("FORMAT", "rgb")
    assert old in text
    (folder / "bad.xml").write_text(text.replace(old, new))
    message = refused(capsys, "render", "bad.xml", "--integrator", "direct")
    assert "bad.xml" in message and "line " in message and said in message


def test_a_scene_without_a_sensor_is_refused(folder, capsys):
    (folder / "bad.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    assert "no sensor" in refused(capsys, "render", "bad.xml", "--integrator", "direct")


def test_compare_prints_the_metric_and_obeys_the_limit(capsys):
    write_exr("a.exr", {"rgb": np.full((4, 4, 3), 0.5), "error": np.zeros((4, 4, 3))})
    write_exr("b.exr", {"rgb": np.full((4, 4, 3), 0.3)})
    assert main(["compare", "a.exr", "b.exr", "--metric", "mse"]) == 0
    assert capsys.readouterr().out == "mse 0.04\n"
    assert main(["compare", "a.exr", "b.exr", "--metric", "mse", "--fail-above", "0.05"]) == 0
    assert main(["compare", "a.exr", "b.exr", "--metric", "mse", "--fail-above", "0.03"]) == 1
    assert main(["compare", "a.exr", "a.exr", "--fail-above", "0"]) == 0


def test_compare_is_relative_to_the_second_file(capsys):
    write_exr("a.exr", {"Y": np.full((4, 4), 2.0)})
    write_exr("b.exr", {"Y": np.full((4, 4), 1.0)})
    assert main(["compare", "a.exr", "b.exr"]) == 0
    assert capsys.readouterr().out == f"relmse {1 / 1.01:.6g}\n"


@pytest.mark.parametrize("metric", ["relmse", "mae", "flip"])
def test_compare_draws_the_difference(metric):
    import mitsuba as mi

    image = np.full((16, 16, 3), 0.5)
    write_exr("b.exr", {"rgb": image})
    image[:, 8:] = 1.0
    write_exr("a.exr", {"rgb": image})
    assert main(["compare", "a.exr", "b.exr", "--metric", metric, "-o", "diff.png"]) == 0
    pixels = np.array(mi.Bitmap("diff.png")).astype(int)
    assert pixels[:, 10:].mean() > pixels[:, :6].mean() + 50


def test_compare_refuses_what_cannot_be_compared(capsys):
    write_exr("a.exr", {"rgb": np.ones((4, 4, 3))})
    write_exr("b.exr", {"rgb": np.ones((4, 5, 3))})
    holed = np.ones((4, 4, 3))
    holed[2, 3] = np.nan
    write_exr("c.exr", {"rgb": holed})
    write_exr("d.exr", {"Y": np.ones((4, 4))})
    write_exr("e.exr", {"u": np.ones((4, 4)), "v": np.ones((4, 4))})
    assert "a.exr and b.exr must have the same size" in refused(capsys, "compare", "a.exr", "b.exr")
    assert "c.exr must be finite (got 3" in refused(capsys, "compare", "c.exr", "a.exr")
    assert "same size and channels" in refused(capsys, "compare", "a.exr", "d.exr")
    assert "e.exr: has neither" in refused(capsys, "compare", "a.exr", "e.exr")


def test_scenes_lists_each_with_a_sentence(capsys):
    assert main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == scenes.names()
    assert all(len(line.split()) > 2 for line in lines)


def test_help_and_version(capsys):
    for words in (["--help"], ["render", "--help"], ["--version"]):
        with pytest.raises(SystemExit) as caught:
            main(words)
        assert caught.value.code == 0
    assert "intervis 0" in capsys.readouterr().out


def test_the_program_on_the_path_runs_and_exits_with_the_code():
    program = os.path.join(os.path.dirname(sys.executable), "intervis")
    result = subprocess.run([program, "render", "missing.xml"], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr == "intervis: missing.xml: file does not exist\n"
