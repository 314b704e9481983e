"""The ablation changes the integrator from outside: every part it names must still be there, and its change must tell."""

from contextlib import ExitStack

import numpy as np
import pytest

from benchmarks import direct_ablation, direct_runs


@pytest.mark.parametrize("part", [name for name in direct_ablation.PARTS if name != "full"])
def test_a_part_is_changed(variant_llvm, part):
    setup = direct_runs.setup("fence", 48, 27)
    parameters, patches = direct_ablation.PARTS[part]
    with ExitStack() as stack:
        for patch in patches():
            stack.enter_context(patch)
        changed = direct_runs.image(direct_runs.visdirect(setup, "unbiased", 16, **parameters).render(1)[0])
    shipped = direct_runs.image(direct_runs.visdirect(setup, "unbiased", 16).render(1)[0])
    assert np.isfinite(changed).all()
    assert (changed != shipped).any()
    # The same picture, though with other noise
    assert abs(changed.mean() / shipped.mean() - 1) < 0.05
