"""Spots: how much they count at a point follows their cone, and nothing that they light is left out."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators.collect import collect
from intervis.integrators.lights import importance


def T():
    return mi.ScalarTransform4f()


def spot(origin, target, cutoff, **more):
    place = T().look_at(origin=origin, target=target, up=[0.1, 0.2, 1])
    return {"type": "spot", "to_world": place, "cutoff_angle": cutoff, "intensity": 5.0, **more}


def weights(cutoff, seed=4, n=20000, **more):
    """Angles from a spot's axis of points all around it, what it counts as there, and what it sends them."""
    rng = np.random.default_rng(seed)
    scene = mi.load_dict({"type": "scene", "spot": spot([0.3, 0.2, 1], [1, -0.4, 0.5], cutoff, **more)})
    d = rng.normal(size=(3, n))
    d /= np.linalg.norm(d, axis=0)
    p = np.array([[0.3], [0.2], [1.0]]) + d * rng.uniform(0.5, 4, n)
    lights = collect(scene)
    # Surfaces that face the spot
    args = mi.Point3f(p.astype(np.float32)), mi.Vector3f((-d).astype(np.float32))
    counted = np.array(importance(lights, mi.UInt32(0), *args, mi.Bool(False)))
    it = dr.zeros(mi.Interaction3f, n)
    it.p = args[0]
    _, sent = scene.emitters()[0].sample_direction(it, mi.Point2f(0.5), True)
    axis = np.array([0.7, -0.6, -0.5]) / np.sqrt(0.7**2 + 0.6**2 + 0.5**2)
    return np.degrees(np.arccos(np.clip(axis @ d, -1, 1))), counted, np.array(mi.luminance(sent))


@pytest.mark.parametrize("cutoff", [2.0, 20.0, 60.0, 89.0])
@pytest.mark.parametrize("beam", [0.0, 0.75, 1.0])
def test_a_spot_counts_all_over_its_cone(variant_llvm, cutoff, beam):
    angle, counted, sent = weights(cutoff, beam_width=beam * cutoff)
    assert (counted[sent > 0] > 0).all()
    assert not counted[angle > 1.05 * cutoff + 0.1].any()


@pytest.mark.parametrize("cutoff", [20.0, 60.0])
def test_a_spot_counts_as_much_as_it_sends(variant_llvm, cutoff):
    angle, counted, sent = weights(cutoff)
    inside = angle < 0.95 * cutoff
    ratio = counted[inside] / sent[inside]
    assert ratio.max() < 1.6 * ratio.min()


def test_a_spot_that_shines_back_too_counts_as_a_point(variant_llvm):
    _, counted, sent = weights(120.0)
    assert (counted > 0).all() and (sent == 0).any()


def test_spots_among_lamps_leave_no_more_noise_than_direct(kit):
    """Whose chance of each light is the same everywhere."""
    rng = np.random.default_rng(1)
    lights = {"lamp": kit.lamp()}
    for k in range(7):
        at, to = rng.uniform([-1, 1.5, -1], [1, 2.5, 1]), rng.uniform([-1, 0, -1], [1, 0, 1])
        lights[f"spot {k}"] = spot(at.tolist(), to.tolist(), float(rng.uniform(8, 20)), intensity=float(rng.uniform(5, 20)))
    assert kit.error_ratio(kit.room(lights, camera=kit.sensor(size=48)), 4096) < 0.015
