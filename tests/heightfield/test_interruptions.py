"""``intervis heightfield`` interrupted: what is finished is written, what is not leaves nothing behind."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from intervis.cli import main
from intervis.heightfield import HeightField, command, make
from intervis.images import read_exr

FIELD = "fractal", "--size", 24


def run(*words):
    return main(["heightfield", *(str(w) for w in words)])


def interrupt(monkeypatch, product, after):
    """Have the progress of a product raise what Ctrl-C raises, after so many directions."""
    real = command._Progress._task

    def task(self, name):
        tell = real(self, name)

        def counting(n, total):
            tell(n, total)
            if name == product and n == after:
                raise KeyboardInterrupt

        return counting

    monkeypatch.setattr(command._Progress, "_task", task)


def test_an_interruption_keeps_finished_directions(here, capsys, monkeypatch):
    field = HeightField(make("fractal", 24))
    interrupt(monkeypatch, "horizons", 2)
    words = (*FIELD, "--products", "skyview,horizons,shadow", "--sun", "135,30,900", "--azimuths", 6)
    assert run(*words, "-o", "out.npz") == 130
    with np.load("out.npz") as data:
        assert set(data) == {"skyview", "horizons", "azimuths", "spacing"}
        np.testing.assert_array_equal(data["horizons"], field.horizons(6)[:2])
        np.testing.assert_allclose(data["azimuths"], np.radians([0, 60]))
        np.testing.assert_array_equal(data["skyview"], field.sky_view(6))
    assert "interrupted" in capsys.readouterr().out
    assert run(*words, "-o", "out.exr") == 130
    assert set(read_exr("out.exr")[0]) == {"skyview", "horizons.000.0", "horizons.060.0"}


def test_an_interruption_while_files_are_written(here, capsys, monkeypatch):
    """What has been computed is written, the picture too."""
    real = command.files.write

    def write(*what):
        os.kill(os.getpid(), signal.SIGINT)
        real(*what)

    monkeypatch.setattr(command.files, "write", write)
    assert run(*FIELD, "--products", "skyview", "--azimuths", 6, "-o", "out.exr", "--preview", "p.png") == 130
    assert "skyview" in read_exr("out.exr")[0] and (here / "p.png").exists()
    assert "out.exr" in capsys.readouterr().out


def test_an_interruption_inside_a_kernel(here, monkeypatch):
    """Dr.Jit wraps what is raised while it records a loop; it is an interruption all the same."""
    real, count = HeightField.horizons, []

    def wrapped(self, *args, **kw):
        count.append(1)
        if len(count) < 3:
            return real(self, *args, **kw)
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise RuntimeError("drjit.while_loop(): encountered an exception (see above).") from error

    monkeypatch.setattr(HeightField, "horizons", wrapped)
    assert run(*FIELD, "--products", "horizons", "--azimuths", 6, "-o", "out.npz") == 130
    with np.load("out.npz") as data:
        assert len(data["horizons"]) == 2


@pytest.mark.parametrize("product", ["irradiance", "skyview"])
def test_an_interruption_keeps_no_half_sums(here, capsys, monkeypatch, product):
    """A sum over some of the directions is no result: nothing is written, and an older file stays."""
    (here / "out.exr").write_text("older")
    interrupt(monkeypatch, product, 2)
    assert run(*FIELD, "--products", product, "--azimuths", 6, "-o", "out.exr", "--preview", "p.png") == 130
    assert (here / "out.exr").read_text() == "older" and not (here / "p.png").exists()
    assert capsys.readouterr().err == "intervis: interrupted\n"


def test_an_interruption_drops_a_product_whose_tiles_are_not_all_there(here, capsys, monkeypatch):
    interrupt(monkeypatch, "horizons", 2)
    words = (*FIELD, "--radius", 5, "--tile", 12, "--products", "skyview,horizons", "--azimuths", 3)
    before = set(here.iterdir())
    assert run(*words, "-o", "out.npz") == 130 and set(here.iterdir()) - before == {here / "out.npz"}
    with np.load("out.npz") as data:
        assert set(data) == {"skyview", "spacing"}
    interrupt(monkeypatch, "skyview", 2)
    assert run(*words, "-o", "none.npz") == 130 and not (here / "none.npz").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_control_c(here, number):
    """A real signal, sent once the first direction has been reported, ends the run early with what there is."""
    program = (
        "import signal, sys\n"
        # Whatever runs the tests, such as nohup, may ignore what a run then ignores too
        f"signal.signal({int(number)}, signal.SIG_DFL)\n"
        "from intervis.heightfield import command\n"
        "task = command._Progress._task\n"
        "def told(self, name):\n"
        "    tell = task(self, name)\n"
        "    def both(n, total):\n"
        "        tell(n, total)\n"
        "        print('finished', n, flush=True)\n"
        "        if n > 3:\n"
        "            sys.stdin.readline()\n"
        "    return both\n"
        "command._Progress._task = told\n"
        "from intervis.cli import main\n"
        "sys.exit(main())\n"
    )
    words = ["heightfield", "fractal", "--size", "200", "--products", "horizons", "--azimuths", "360", "-o", "out.npz"]
    process = subprocess.Popen(
        [sys.executable, "-c", program, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "NUMBA_NUM_THREADS": "1"},
    )
    try:
        # The program waits after its fourth direction, so the signal comes before the end whatever the machine
        assert process.stdout.readline() == "finished 1\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert "interrupted: what was finished has been written" in out
    with np.load("out.npz") as data:
        count = len(data["horizons"])
        assert 1 <= count <= 4 and len(data["azimuths"]) == count and np.isfinite(data["horizons"]).all()
