"""Start-up: an LLVM chosen before Dr.Jit looks for one, and plugins registered in every variant."""

from __future__ import annotations

import importlib
import warnings

from . import llvm
from .errors import InputError


def register(old: str | None = None, new: str | None = None) -> None:
    """Register the plugins in the active variant; Mitsuba calls this after every ``set_variant``.

    Raises
    ------
    InputError
        If the variant is an ``llvm_*`` one and its LLVM would abort the process at the first kernel.
    """
    import drjit as dr
    import mitsuba as mi

    if mi.variant().startswith("llvm"):
        problem = llvm.problem(dr.detail.llvm_version())
        if problem:
            raise InputError(problem)
    importlib.import_module(".integrators", __package__).register()


def start() -> None:
    """Choose an LLVM, then register the plugins now and in every later variant.

    Raises
    ------
    InputError
        If an ``llvm_*`` variant is already active on an LLVM that Dr.Jit cannot use.
    """
    if problem := llvm.missing_file():
        warnings.warn(problem, stacklevel=3)
    llvm.choose()

    # Only now: importing Mitsuba imports Dr.Jit, which loads the LLVM that is named at that moment.
    import mitsuba as mi

    mi.detail.add_variant_callback(register)
    if mi.variant() is not None:
        register()
