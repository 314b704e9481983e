"""Consistent mode: who shares with whom, that it pays, and that its bias vanishes."""

from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.integrators import consistent
from intervis.scenes import load


def errors(scene, truth, mode, spp, seeds):
    """Return relMSE of single renders, and the rms of their mean's difference from the truth."""
    plugin = mi.load_dict({"type": "visdirect", "mode": mode})
    images = np.array([np.array(mi.render(scene, integrator=plugin, spp=spp, seed=s)) for s in range(seeds)], np.float64)
    each = np.mean((images - truth) ** 2 / (truth**2 + 0.01))
    return each, np.sqrt(np.mean((images.mean(0) - truth) ** 2 / (truth**2 + 0.01)))


def scene_and_truth(name):
    scene = mi.load_dict(load(name, width=120, height=68))
    truth = mi.render(scene, integrator=mi.load_dict({"type": "visdirect"}), spp=2048, seed=1000)
    return scene, np.array(truth, dtype=np.float64)


def test_pixels_beside_another_surface_are_not_inner(variant_llvm):
    # Five columns of floor, then three of a wall that stands on it; and one pixel of floor that lies deeper
    width, height = 8, 6
    normal, point = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    normal[:, :5, 2] = normal[:, 5:, 0] = 1
    point[..., 0] = np.arange(width)
    point[..., 1] = np.arange(height)[:, None]
    point[:, 5:, 0] = 5
    point[:, 5:, 2] = np.arange(3)
    point[2, 2, 2] = -3
    pilot = SimpleNamespace(normal=mi.Vector3f(normal.reshape(-1, 3).T), point=mi.Point3f(point.reshape(-1, 3).T))
    grid = consistent.Grid(SimpleNamespace(width=width, height=height, pixels=width * height), pilot)
    inner = np.ones((height, width), bool)
    inner[:, 4:6] = False
    for row, column in ((2, 2), (1, 2), (3, 2), (2, 1), (2, 3)):
        inner[row, column] = False
    np.testing.assert_array_equal(np.array(grid.inner).reshape(height, width), inner)


def test_equal_pixels_share_alike(variant_llvm):
    # On one even surface, where noise explains all differences, a half's mean is that over its window
    width, height, radius = 16, 12, consistent.RADIUS
    y, x = np.mgrid[:height, :width]
    pilot = SimpleNamespace(
        normal=mi.Vector3f(0 * x.ravel(), 0 * x.ravel(), 0 * x.ravel() + 1.0), point=mi.Point3f(x.ravel(), y.ravel(), 0)
    )
    frame = SimpleNamespace(width=width, height=height, pixels=width * height)
    a, b = np.random.default_rng(0).uniform(0.4, 0.6, (2, height, width))
    va, vb = mi.Float(a.ravel()), mi.Float(b.ravel())
    known, noise = dr.full(mi.Bool, True, x.size), dr.full(mi.Float, 10.0, x.size)
    shared, _ = consistent._share(consistent.Grid(frame, pilot), mi.Color3f(va), mi.Color3f(vb), va, vb, noise, known)
    for i, j in ((0, 0), (5, 7), (11, 3)):
        window = a[max(i - radius, 0) : i + radius + 1, max(j - radius, 0) : j + radius + 1]
        assert np.array(shared)[1].reshape(height, width)[i, j] == pytest.approx(window.mean(), rel=1e-5)


@pytest.mark.parametrize("name, share", [("grating", 0.6), ("penumbra", 0.5), ("fence", 0.75)])
def test_sharing_pays(variant_llvm, name, share):
    scene, truth = scene_and_truth(name)
    plain, shared = (errors(scene, truth, mode, 16, 4)[0] for mode in ("unbiased", "consistent"))
    assert shared < share * plain


def test_bias_vanishes(variant_llvm):
    scene, truth = scene_and_truth("fence")
    few, many = (errors(scene, truth, "consistent", spp, seeds)[1] for spp, seeds in ((8, 16), (256, 4)))
    assert many < 0.3 * few
