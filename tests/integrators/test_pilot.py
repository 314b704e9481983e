"""What the first pass finds."""

import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis import scenes


@pytest.mark.parametrize("name", ["glossy", "meshlight", "fence"])
def test_pilots_find_the_same_with_a_probe_beside_them(variant_llvm, name):
    """Though on glossy scenes both are lanes of one launch; and probes find what is not the pilots' own, but much alike."""
    from intervis.integrators.camera import Frame
    from intervis.integrators.pilot import pilot
    from intervis.integrators.shading import prepare

    scene = mi.load_dict(scenes.load(name, width=31, height=17))
    shading, frame = prepare(scene), Frame(scene.sensors()[0])
    shading.integrator = mi.load_dict({"type": "visdirect"})
    alone, both = (pilot(shading, frame, mi.UInt32(5), 4, probe) for probe in (False, True))
    dr.eval(vars(alone), vars(both))
    for field in ("value", "bright", "straight", "position", "normal", "point", "traced"):
        a, b = (np.array(getattr(look, field)) for look in (alone, both))
        np.testing.assert_allclose(np.broadcast_to(a, b.shape), b, rtol=1e-5, atol=1e-6, err_msg=field)
    for field in ("seen", "tried"):
        for a, b in zip(getattr(alone, field), getattr(both, field), strict=True):
            np.testing.assert_array_equal(a, b)
    own, other = np.log(0.01 + np.array(mi.luminance(both.bright))), np.log(0.01 + np.array(both.probe_bright))
    assert own.shape == other.shape == (frame.pixels,)
    assert (own != other).any()
    assert np.corrcoef(own, other)[0, 1] > 0.4
