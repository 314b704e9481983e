import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from intervis import InputError, llvm, startup

ROOT = Path(__file__).resolve().parents[2]
SYSTEM_LLVM = next(
    (str(p) for n in (15, 16) for p in sorted(Path("/usr/lib").glob(f"*/libLLVM-{n}.so.1"))), None
)

# Renders with the package's plugin: proof that it is registered and that the LLVM compiles.
RENDER = """
import mitsuba as mi, numpy as np
def render():
    box = mi.cornell_box() | {"integrator": {"type": "visdirect"}}
    box["sensor"]["film"] |= {"width": 8, "height": 8}
    scene = mi.load_dict(box)
    assert scene.integrator() is not None
    assert np.isfinite(np.array(mi.render(scene, spp=2))).all()
    print("rendered", mi.variant())
"""


def python(code, cwd=None, **environment):
    """Run code in a fresh interpreter that has no LLVM named for it."""
    env = {k: v for k, v in os.environ.items() if k != llvm.VARIABLE} | environment
    return subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, env=env, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import mitsuba",
        "import drjit; drjit.detail.llvm_version()",
        "import mitsuba; mitsuba.set_variant('scalar_rgb')",
    ],
    ids=["first", "after mitsuba", "after drjit", "after a variant"],
)
def test_import_in_any_order_renders(before, tmp_path):
    code = f"{before}\nimport intervis\n{RENDER}\nmi.set_variant('llvm_ad_rgb')\nrender()"
    result = python(code, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "rendered llvm_ad_rgb" in result.stdout


def test_import_after_the_variant_registers_in_it(tmp_path):
    code = f"import mitsuba as mi\nmi.set_variant('llvm_ad_rgb')\nimport intervis\n{RENDER}\nrender()"
    # With the good LLVM named by the user, as someone who uses Mitsuba alone must.
    library = llvm.bundled()
    result = python(code, cwd=tmp_path, **({llvm.VARIABLE: str(library)} if library else {}))
    assert result.returncode == 0, result.stderr


def test_every_later_variant_has_the_plugins(tmp_path):
    order = ["llvm_ad_rgb", "llvm_ad_mono", "scalar_rgb", "llvm_ad_rgb", "llvm_ad_spectral", "llvm_ad_rgb"]
    switches = "\n".join(
        f"mi.set_variant('{v}')" + ("\nrender()" if v.startswith("llvm") else "") for v in order
    )
    result = python(f"import intervis\n{RENDER}\n{switches}", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert re.findall(r"rendered (\w+)", result.stdout) == [v for v in order if v.startswith("llvm")]


def test_a_bad_llvm_is_refused_before_it_aborts(tmp_path):
    code = """
import intervis, drjit, mitsuba as mi
drjit.detail.llvm_version = lambda: (15, 0, 6)
mi.set_variant("scalar_rgb")
try:
    mi.set_variant("llvm_ad_rgb")
except intervis.InputError as error:
    print(error)
"""
    result = python(code, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "LLVM 15.0.6" in result.stdout and len(result.stdout.splitlines()) == 1


@pytest.mark.skipif(SYSTEM_LLVM is None, reason="needs a system LLVM 15 or 16")
def test_the_users_bad_llvm_ends_the_command_line_with_a_sentence(tmp_path):
    code = "import sys; from intervis.cli import main; sys.exit(main(['render', 'penumbra', '--spp', '1']))"
    result = python(code, cwd=tmp_path, **{llvm.VARIABLE: SYSTEM_LLVM})
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1 and "aborts" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(SYSTEM_LLVM is None, reason="needs a system LLVM 15 or 16")
def test_a_variant_active_on_a_bad_llvm_is_refused_at_import(tmp_path):
    result = python("import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import intervis", cwd=tmp_path)
    # Without a good one installed, the sentence names the package; with one, the order of imports.
    assert result.returncode == 1
    assert "InputError: Dr.Jit loaded LLVM" in result.stderr.splitlines()[-1]


def test_a_missing_file_in_the_environment_is_warned_of(monkeypatch, tmp_path):
    monkeypatch.setenv(llvm.VARIABLE, str(tmp_path / "libLLVM.so"))
    with pytest.warns(UserWarning, match="names a file that does not exist"):
        startup.start()


def test_a_name_without_a_folder_is_left_to_the_loader(monkeypatch):
    monkeypatch.setenv(llvm.VARIABLE, "libLLVM.so.19")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        startup.start()
    assert os.environ[llvm.VARIABLE] == "libLLVM.so.19"


def test_bundled_takes_the_versioned_file(monkeypatch, tmp_path):
    folder = tmp_path / "lib"
    folder.mkdir()
    (folder / "libLLVM.so.23.1").write_bytes(b"library")
    (folder / "libLLVM.so").symlink_to("libLLVM.so.23.1")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(llvm, "PACKAGE", "no-such-distribution")
    assert llvm.bundled() == folder / "libLLVM.so.23.1"


def test_bundled_is_none_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(llvm, "PACKAGE", "no-such-distribution")
    assert llvm.bundled() is None


def test_choose_keeps_what_the_user_named(monkeypatch):
    monkeypatch.setenv(llvm.VARIABLE, "/somewhere/libLLVM.so")
    llvm.choose()
    assert os.environ[llvm.VARIABLE] == "/somewhere/libLLVM.so"


@pytest.mark.parametrize("version", [(14, 0, 0), (15, 0, 6), (16, 0, 6)])
def test_problem_on_x86_names_the_version_and_a_cure(monkeypatch, version):
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm.platform, "machine", lambda: "x86_64")
    sentence = llvm.problem(version)
    assert f"LLVM {version[0]}" in sentence and llvm.PACKAGE in sentence and "\n" not in sentence


def test_no_problem_with_newer_versions_or_another_processor(monkeypatch):
    monkeypatch.setattr(llvm.platform, "machine", lambda: "x86_64")
    assert llvm.problem((19, 1, 0)) is None and llvm.problem((23, 1, 4)) is None
    monkeypatch.setattr(llvm.platform, "machine", lambda: "aarch64")
    assert llvm.problem((15, 0, 6)) is None


def test_problem_without_any_llvm(monkeypatch, tmp_path):
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    assert "no usable LLVM was found" in llvm.problem((-1, -1, -1))
    monkeypatch.setenv(llvm.VARIABLE, str(tmp_path / "libLLVM.so"))
    assert str(tmp_path) in llvm.problem((-1, -1, -1))


def test_register_refuses_a_bad_llvm(monkeypatch, variant_llvm):
    import drjit

    monkeypatch.setattr(drjit.detail, "llvm_version", lambda: (14, 0, 0))
    monkeypatch.setattr(llvm.platform, "machine", lambda: "x86_64")
    with pytest.raises(InputError, match="LLVM 14"):
        startup.register()


def test_no_module_is_loaded_under_two_names():
    code = """
import importlib, os, pkgutil, sys
from collections import defaultdict
folders = []
for name in ("intervis", "intervis.scenes", "intervis.visibility", "intervis.integrators"):
    package = importlib.import_module(name)
    folders += [folder + os.sep for folder in package.__path__]
    for module in pkgutil.iter_modules(package.__path__, name + "."):
        importlib.import_module(module.name)
names = defaultdict(set)
for name, module in list(sys.modules.items()):
    file = getattr(module, "__file__", None) or ""
    if any(file.startswith(folder) for folder in folders):
        names[file].add(name)
assert len(names) > 10, names
assert all(n.startswith("intervis") for group in names.values() for n in group), names
assert all(len(group) == 1 for group in names.values()), names
"""
    # From the repository's root, where `core` and the other folders can be imported by their own names.
    result = python(code, cwd=ROOT)
    assert result.returncode == 0, result.stderr


def test_the_version_is_that_of_the_package():
    from importlib.metadata import version

    import intervis

    assert intervis.__version__ == version("intervis")
