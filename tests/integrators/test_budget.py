"""How a budget of rays is spread over the pixels."""

from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

PIXELS = 4096


def spread(error, rays=4, budget=64.0, **settings):
    """Hits in each pixel for a budget of so many rays a pixel."""
    from intervis.integrators.decide import allocate

    decision = SimpleNamespace(error=mi.Float(error), need=mi.Float(error), rays=mi.UInt32(np.full(PIXELS, rays)))
    limits = {"max_rays": 512, "pilot_rays": 4, "threshold": 0.0, **settings}
    allocate(decision, SimpleNamespace(pixels=PIXELS), mi.UInt32(3), budget * PIXELS, **limits)
    return np.array(decision.hits)


@pytest.mark.parametrize("busy", [0.3, 0.5, 1.0])
def test_the_budget_is_spent_on_average(variant_llvm, busy):
    rng = np.random.default_rng(1)
    hits = spread(np.where(rng.uniform(size=PIXELS) < busy, rng.uniform(0.01, 0.1, PIXELS), 0))
    assert hits.mean() * 5 == pytest.approx(64, rel=0.1)


def test_pixels_that_look_sure_are_visited_all_the_same(variant_llvm):
    hits = spread(np.where(np.arange(PIXELS) % 2, 0.1, 0.0), budget=256.0)
    assert hits[::2].min() >= 4 and hits[1::2].min() >= 16


def test_more_error_gets_more_hits_up_to_the_limit(variant_llvm):
    hits = spread(np.where(np.arange(PIXELS) % 2, 0.1, 0.01), max_rays=100)
    assert hits[1::2].mean() > 2 * hits[::2].mean()
    assert hits.max() * 4 <= 100
