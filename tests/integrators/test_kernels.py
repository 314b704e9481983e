"""Kernels are compiled once for a scene: what differs from one render to the next is data to them."""

import secrets

import drjit as dr
import mitsuba as mi
import pytest

from intervis import scenes


@pytest.mark.parametrize("settings", [{}, {"mode": "consistent"}, {"threshold": 0.02, "aovs": True}], ids=str)
def test_another_seed_compiles_nothing(variant_llvm, settings):
    """Seeds are fresh, as compiled kernels outlive a run of the tests; any seed will do."""
    scene = mi.load_dict(scenes.wires(width=64, height=40))
    integrator = mi.load_dict({"type": "visdirect", **settings})
    mi.render(scene, integrator=integrator, spp=64, seed=1)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for _ in range(2):
            dr.eval(mi.render(scene, integrator=integrator, spp=64, seed=secrets.randbits(30)))
        ran = dr.kernel_history([dr.KernelType.JIT])
    assert ran and not [(kernel["size"], kernel["backend_time"]) for kernel in ran if not kernel["cache_hit"]]
