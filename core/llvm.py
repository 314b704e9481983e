"""An LLVM that Dr.Jit can compile with: found, named to Dr.Jit, and checked before anything aborts.

Dr.Jit aborts the whole process on x86 with LLVM 16 and older ("Cannot select: fminimum"), which are what
Debian 12 and Ubuntu 22.04 ship. It loads an LLVM when `drjit` is imported, and `import mitsuba` imports that.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from importlib import metadata
from pathlib import Path

VARIABLE = "DRJIT_LIBLLVM_PATH"
PACKAGE = "karellen-llvm-core"

# x86 got an instruction selection for `fminimum`, which Dr.Jit emits, in LLVM 17.
OLDEST = 17


def bundled() -> Path | None:
    """Return the LLVM library that pip installed beside this package, or None.

    The plain ``libLLVM.so`` link may appear only at a later start, so every ``libLLVM*.so*`` counts.
    """
    folders = [Path(sys.prefix) / "lib"]
    # Where the distribution recorded its files, for installations outside `sys.prefix` (--user, --target).
    try:
        files = metadata.distribution(PACKAGE).files or []
        folders += [Path(f.locate()).resolve().parent for f in files if f.name.startswith("libLLVM")]
    except metadata.PackageNotFoundError:
        pass
    found = [p for folder in folders for p in folder.glob("libLLVM*.so*") if p.is_file()]
    # The longest name carries the full version: it is the file itself and no link.
    return max(found, key=lambda p: len(p.name)) if found else None


def missing_file() -> str | None:
    """Return one sentence if the user's ``DRJIT_LIBLLVM_PATH`` names a file that does not exist."""
    library = os.environ.get(VARIABLE, "")
    # A bare name is looked up by the dynamic loader, so only a path can be known to be wrong.
    if os.path.dirname(library) and not os.path.isfile(library):
        return f"{VARIABLE} names a file that does not exist ({library}): unset it, or {_cure()}"
    return None


def problem(version: tuple[int, ...]) -> str | None:
    """Return one sentence on why Dr.Jit cannot use the LLVM it loaded, or None if it can.

    Parameters
    ----------
    version : tuple of int
        What ``drjit.detail.llvm_version()`` returned; negative when no LLVM was found.
    """
    if version[0] < 0:
        return missing_file() or f"no usable LLVM was found, which the llvm_* variants need: {_cure()}"
    if version[0] < OLDEST and platform.machine().lower() in ("x86_64", "amd64"):
        number = ".".join(map(str, version))
        library = bundled()
        late = library is not None and os.environ.get(VARIABLE) == str(library)
        cure = "import intervis before the first mi.set_variant" if late else _cure()
        return f"Dr.Jit loaded LLVM {number}, on which it aborts the process: {cure}"
    return None


def choose() -> None:
    """Name the bundled LLVM to Dr.Jit, unless the user named one.

    If `drjit` was imported before, it has already loaded the system's LLVM. When that one is unusable, and
    nothing can have compiled with it, Dr.Jit is started again with the bundled one.
    """
    if os.environ.get(VARIABLE):
        return
    library = bundled()
    if library is None:
        return
    os.environ[VARIABLE] = str(library)
    if "drjit" in sys.modules and not _in_use() and problem(sys.modules["drjit"].detail.llvm_version()):
        _restart()


def _cure() -> str:
    """Return what a user does about a missing or unusable LLVM."""
    package = f"`pip install {PACKAGE}` (Linux x86-64)"
    return f"install one with {package}, or set {VARIABLE} to LLVM {OLDEST} or newer"


def _in_use() -> bool:
    """Return whether a Dr.Jit variant of Mitsuba was loaded, which a restart would break."""
    return any(name.startswith(("mitsuba.llvm_", "mitsuba.cuda_")) for name in sys.modules)


def _restart() -> None:
    """Shut Dr.Jit down and start it again, so that it loads the LLVM that is named now."""
    # `jit_shutdown(light=0)` and `jit_init(backends)` of drjit-core/jit.h, under their C++ names: they are
    # public there but not in Python. Where they are missing, `problem` is what the user reads.
    core = Path(sys.modules["drjit"].__file__).parent / "libdrjit-core.so"
    try:
        library = ctypes.CDLL(str(core))
        shutdown, init = library._Z12jit_shutdowni, library._Z8jit_initj
    except (OSError, AttributeError):
        return
    cuda, llvm = 1 << 1, 1 << 2
    shutdown(ctypes.c_int(0))
    init(ctypes.c_uint32(cuda | llvm))
