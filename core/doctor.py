"""``intervis doctor``: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from importlib import metadata

from . import llvm

PACKAGES = (
    "intervis",
    "mitsuba",
    "drjit",
    llvm.PACKAGE,
    "numpy",
    "scipy",
    "numba",
    "OpenEXR",
    "colour-science",
    "flip-evaluator",
    "rich",
)
OPTIONAL = {"matplotlib": "plots of the benchmarks", "rasterio": "GeoTIFF", "scikit-learn": "training the classifiers"}

# A render in a process of its own: a bad LLVM aborts the process, and one variant must not disturb the next.
_PROBE = """
import sys
import intervis
import mitsuba as mi
import numpy as np
mi.set_variant(sys.argv[1])
image = np.array(mi.render(mi.load_dict(mi.cornell_box() | {"integrator": {"type": sys.argv[2]}}), spp=1))
assert np.isfinite(image).all(), "the picture is not finite"
"""
_PROBED = {
    "llvm_ad_rgb": "llvm_* variants (CPU)",
    "cuda_ad_rgb": "cuda_* variants (NVIDIA GPU)",
    "scalar_rgb": "scalar_* variants",
}


def command() -> int:
    """Print the state of the installation; return 0 if a variant renders with this package, else 1."""
    import drjit as dr
    import mitsuba as mi

    print(f"Python {platform.python_version()} on {platform.platform()}, {os.cpu_count()} cores\n")

    # Versions first: they are what a bug report needs.
    for package in PACKAGES:
        print(f"  {package:<20}{_version(package) or f'missing: pip install {package}'}")
    for package, purpose in OPTIONAL.items():
        print(f"  {package:<20}{_version(package) or f'optional, for {purpose}: pip install {package}'}")

    # The LLVM is what most often stands between a user and a first picture.
    version = dr.detail.llvm_version()
    problem = llvm.missing_file() or llvm.problem(version)
    number = ".".join(map(str, version)) if version[0] >= 0 else "none"
    print(f"\n  {'LLVM':<20}{number}, {'usable' if problem is None else problem}")
    print(f"  {'':<20}{llvm.VARIABLE} {os.environ.get(llvm.VARIABLE, 'not set')}")

    print()
    working = []
    for variant, what in _PROBED.items():
        if variant not in mi.variants():
            failure = "not part of this build of Mitsuba"
        elif variant.startswith("cuda") and not dr.has_backend(dr.JitBackend.CUDA):
            failure = "no usable NVIDIA GPU: a driver must be installed, so that `nvidia-smi` lists one"
        else:
            failure = _probe(variant)
        print(f"  {what:<32}{'works' if failure is None else failure}")
        if failure is None and not variant.startswith("scalar"):
            working.append(variant)
    print(f"\n  variants: {', '.join(mi.variants())}")

    if working:
        print(f"\nReady: `intervis render penumbra --variant {working[0]}` will work.")
        return 0
    print("\nNothing can render here: repair LLVM (CPU) or the NVIDIA driver (GPU) as said above.")
    return 1


def _version(package: str) -> str | None:
    """Return a package's version, or None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _probe(variant: str) -> str | None:
    """Render a small picture in a fresh process; return None, or why it failed and what to do."""
    # Scalar variants are Mitsuba's own affair: this package's integrators need a JIT.
    integrator = "direct" if variant.startswith("scalar") else "visdirect"
    result = subprocess.run(
        [sys.executable, "-c", _PROBE, variant, integrator],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    if result.returncode == 0:
        return None
    lines = result.stderr.strip().splitlines()
    return f"fails: {lines[-1] if lines else f'exit code {result.returncode}'}"
