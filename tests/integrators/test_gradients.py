"""Derivatives: a correct gradient, or one clear sentence."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis.errors import InputError

KEY = "floor.bsdf.reflectance.value"


def gradient(kit, integrator, seeds):
    scene = mi.load_dict(kit.room(), optimize=False)
    plugin = mi.load_dict(integrator)
    out = []
    for seed in seeds:
        params = mi.traverse(scene)
        params.keep([KEY])
        dr.enable_grad(params[KEY])
        image = mi.render(scene, params, integrator=plugin, spp=32, seed=seed)
        dr.backward(dr.mean(image))
        out.append(np.array(dr.grad(params[KEY])).ravel())
        dr.disable_grad(params[KEY])
    return np.array(out)


def test_backward_agrees_with_prb(kit):
    ours = gradient(kit, {"type": "visdirect"}, range(8))
    theirs = gradient(kit, {"type": "prb", "max_depth": 2}, range(100, 108))
    noise = np.sqrt(ours.var(0, ddof=1) / 8 + theirs.var(0, ddof=1) / 8)
    assert (ours.mean(0) > 0).all()
    assert (np.abs(ours.mean(0) - theirs.mean(0)) < 5 * noise + 1e-6).all()


def test_gradients_agree_with_a_finite_difference(kit):
    """The image is linear in the floor's reflectance, so a difference is exact but for noise."""
    backward = gradient(kit, {"type": "visdirect"}, range(8)).mean(0).sum()
    scene = mi.load_dict(kit.room(), optimize=False)
    plugin = mi.load_dict({"type": "visdirect"})
    params = mi.traverse(scene)
    base = mi.Color3f(params[KEY])
    means = []
    for shift in (0.0, 0.1):
        params[KEY] = base + shift
        params.update()
        means.append(np.mean([np.array(mi.render(scene, integrator=plugin, spp=64, seed=s)).mean() for s in range(4)]))
    assert backward == pytest.approx((means[1] - means[0]) / 0.1, rel=0.03)


def test_a_plain_render_of_tracked_parameters_is_refused(kit):
    scene = mi.load_dict(kit.room(), optimize=False)
    params = mi.traverse(scene)
    dr.enable_grad(params[KEY])
    params.update()
    with pytest.raises((InputError, RuntimeError), match="mi.render"):
        mi.load_dict({"type": "visdirect"}).render(scene, spp=4)


@pytest.mark.parametrize("settings", [{"aovs": True}, {"mode": "consistent"}])
def test_what_has_no_derivative_says_so(kit, settings):
    scene = mi.load_dict(kit.room(), optimize=False)
    plugin = mi.load_dict({"type": "visdirect", **settings})
    with pytest.raises((InputError, RuntimeError), match="no derivatives"):
        plugin.render_backward(scene, mi.traverse(scene), dr.zeros(mi.TensorXf, (32, 32, 3)))
