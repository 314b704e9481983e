import subprocess

import pytest

from intervis import doctor, llvm


@pytest.fixture
def probes(monkeypatch):
    """Replace the renders in other processes by outcomes that a test chooses."""
    outcomes = {"llvm_ad_rgb": None, "cuda_ad_rgb": "no GPU", "scalar_rgb": None}
    monkeypatch.setattr(doctor, "_probe", outcomes.get)
    return outcomes


def test_a_working_variant_is_enough(probes, capsys):
    assert doctor.command() == 0
    out = capsys.readouterr().out
    for word in (*doctor.PACKAGES, "LLVM", "cuda_*", "llvm_ad_spectral", "intervis render penumbra"):
        assert word in out


def test_scalar_alone_cannot_render_this_packages_plugins(probes, capsys):
    probes["llvm_ad_rgb"] = "fails: no LLVM"
    assert doctor.command() == 1
    out = capsys.readouterr().out
    assert "fails: no LLVM" in out and "Nothing can render here" in out


def test_a_bad_llvm_is_explained(probes, capsys, monkeypatch):
    monkeypatch.setattr(llvm, "problem", lambda version: "LLVM is too old: install another")
    doctor.command()
    assert "LLVM is too old: install another" in capsys.readouterr().out


def test_a_missing_package_comes_with_its_cure(probes, capsys, monkeypatch):
    monkeypatch.setattr(doctor, "PACKAGES", ("no-such-package",))
    doctor.command()
    assert "missing: pip install no-such-package" in capsys.readouterr().out


def test_a_probe_that_dies_says_how(monkeypatch):
    def abort(*_, **__):
        return subprocess.CompletedProcess([], -6, "", "LLVM ERROR\nAborted\n")

    monkeypatch.setattr(subprocess, "run", abort)
    assert doctor._probe("llvm_ad_rgb") == "fails: Aborted"


def test_a_probe_renders_for_real():
    assert doctor._probe("llvm_ad_rgb") is None
