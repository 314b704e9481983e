"""What each part of the integrator adds, and what an oracle that knew every pixel's variance would gain."""

from __future__ import annotations

import time
from contextlib import ExitStack
from unittest.mock import patch

import drjit as dr
import mitsuba as mi
import numpy as np

from intervis.integrators import camera, cells, decide, estimate, hits, pilot, rectangle, visdirect

from .direct_runs import Setup, image, relmse
from .direct_runs import visdirect as configure

SCENES = ("penumbra", "fence", "grating")
SEEDS = 32  # renders from which the oracle learns


def _random_1d(i, s):
    return mi.sample_tea_float32(i, s, 4)


def _random_2d(i, s0, s1):
    return mi.Point2f(_random_1d(i, s0), _random_1d(i, s1))


POINTS = (("net_1d", _random_1d), ("net_2d", _random_2d), ("net_high", _random_2d))


def _random_points():
    swaps = [(m, n, f) for m in (camera, estimate, hits, pilot, rectangle) for n, f in POINTS]
    return [patch.object(m, n, f) for m, n, f in swaps if hasattr(m, n)]


def _prepare_open(scene, original=visdirect.prepare):
    out = original(scene)
    out.closed = False
    return out


def _decide(change):
    """Patch of the decision: ``change`` edits what the real one returns."""
    original = visdirect.decide

    def wrapped(*args):
        decision = original(*args)
        change(decision)
        return decision

    return patch.object(visdirect, "decide", wrapped)


def _no_guess(decision):
    decision.mean = dr.zeros(mi.Float, dr.width(decision.mean))


def _sampled_guess(decision):
    decision.mean = dr.select(decision.mean >= 1, mi.Float(1), mi.Float(0))


def _constants(**values):
    return [patch.object(decide, name, value) for name, value in values.items()]


def _one_window(radius):
    defaults = ((cells.window_sum, (radius, 1)), (cells.window_count, (radius,)))
    return [patch.object(function, "__defaults__", values) for function, values in defaults]


def _own_pilot(values, width, height, *window, original=cells.window_sum):
    return original(values, width, height, *window) if window else list(values)


def _own_window():
    return [patch.object(cells, "window_sum", _own_pilot), patch.object(cells, "window_count", lambda *_: mi.Float(1))]


# Name to (integrator parameters, patches); everything else as shipped
PARTS = {
    "full": ({}, lambda: []),
    "random points instead of nets": ({}, _random_points),
    "1 shadow ray a hit": ({}, lambda: [patch.object(decide, "MAX_LOG_RAYS", 0)]),
    "uniform budgets": ({}, lambda: [patch.object(decide, "EXPONENT", 0.0)]),
    "no closed form": ({}, lambda: [patch.object(visdirect, "prepare", _prepare_open)]),
    "visibility guess 0 or 1 only": ({}, lambda: [_decide(_sampled_guess)]),
    "no visibility guess": ({}, lambda: [_decide(_no_guess)]),
    "with refined light cells": ({"refine": True}, lambda: []),
    "pilot window 3×3 for 5×5": ({}, lambda: _one_window(1)),
    "no look beyond 5×5 pixels": ({}, lambda: _constants(AROUND=0.0, RARE=0.0, PRIOR=0.015)),
    "shading counts as edges": ({}, lambda: _constants(GENTLE=1e-9)),
    "own pilot only (biased)": ({}, _own_window),
}


def _sample(s: Setup, run, seeds) -> tuple[float, float, float]:
    """Median seconds, mean error and rays a pixel over seeds, after a warm-up."""
    run.render(1)
    times, errors = [], []
    for seed in seeds:
        dr.sync_thread()
        begin = time.perf_counter()
        tensor, integrator = run.render(seed)
        dr.sync_thread()
        times.append(time.perf_counter() - begin)
        errors.append(relmse(image(tensor), s))
    rays = sum(integrator.report.rays.values()) / s.pixels
    return float(np.median(times)), float(np.mean(errors)), rays


def ablate(s: Setup, spp: int, repeats: int) -> dict[str, dict]:
    """Measure the integrator on a scene with one part changed at a time.

    Returns
    -------
    dict of str to dict
        For each part: ``seconds``, ``error``, ``rays``, and ``error_ratio`` and ``time_ratio`` over the full
        integrator; empty where the knob that the part hangs on is gone.
    """
    out = {}
    for name, (parameters, patches) in PARTS.items():
        with ExitStack() as stack:
            try:
                for p in patches():
                    stack.enter_context(p)
            except AttributeError:
                out[name] = {}
                continue
            seconds, error, rays = _sample(s, configure(s, "unbiased", spp, **parameters), range(500, 500 + repeats))
        base = out.get("full", {"seconds": seconds, "error": error})
        out[name] = {
            "seconds": seconds,
            "error": error,
            "rays": rays,
            "error_ratio": error / base["error"],
            "time_ratio": seconds / base["seconds"],
        }
    return out


def regret(s: Setup, spp: int, repeats: int, seeds: int = SEEDS) -> dict[str, float]:
    """Compare the budgets with those of an oracle that knows every pixel's variance, at equal rays.

    The oracle's variances come from many renders with uniform budgets, smoothed over nothing; it spends with the
    shipped exponent and with Neyman's 1, and the better of the two counts.

    Returns
    -------
    dict
        ``error`` and ``rays`` of the integrator, ``oracle_error`` and ``oracle_rays``, and ``regret`` (the former
        error over the latter, minus 1).
    """
    with patch.object(decide, "EXPONENT", 0.0):
        run = configure(s, "unbiased", max(spp // 4, 4))
        renders = np.array([image(run.render(7000 + k)[0]) for k in range(seeds)])
    variance = (renders.var(axis=0, ddof=1) / (s.reference**2 + 0.01)).mean(axis=-1)
    known = mi.Float(np.sqrt(np.maximum(variance, 1e-4 * variance.mean())).ravel().astype(np.float32))

    def tell(decision):
        decision.error = decision.need = known

    _, error, rays = _sample(s, configure(s, "unbiased", spp), range(600, 600 + repeats))
    found = []
    for exponent in (decide.EXPONENT, 1.0):
        with patch.object(decide, "EXPONENT", exponent), _decide(tell):
            found.append(_sample(s, configure(s, "unbiased", spp), range(600, 600 + repeats))[1:])
    oracle, oracle_rays = min(found)
    return {
        "error": error,
        "rays": rays,
        "oracle_error": oracle,
        "oracle_rays": oracle_rays,
        "regret": error / oracle - 1,
    }
