"""Kernels are compiled once for a scene: what differs from one render to the next is data to them."""

import secrets

import drjit as dr
import mitsuba as mi
import numpy as np
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


def test_the_lights_table_lies_where_four_numbers_are_gathered_at_once(variant_llvm):
    """What NumPy made is borrowed by Dr.Jit, and aligned only now and then: kernels would be of two kinds by chance."""
    from intervis.integrators.collect import collect

    scene = mi.load_dict(scenes.manylights(width=32, height=18))
    kept, places = [], []
    for k in range(20):
        lights = collect(scene)
        kept.append((lights, np.empty(16 * k + 4, dtype=np.uint8)))
        places += [t.numpy().__array_interface__["data"][0] % 64 for t in (lights.table, lights.nodes)]
    assert not any(places)
