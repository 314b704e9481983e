"""What makes the estimate unbiased: no pixel's decision may depend on that pixel's own samples."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from intervis import scenes

WIDTH, HEIGHT = 32, 20
PIXEL = 11 * WIDTH + 13


def pilot_and_frame(name):
    from intervis.integrators.camera import Frame
    from intervis.integrators.pilot import pilot as look
    from intervis.integrators.shading import prepare

    scene = mi.load_dict(scenes.load(name, width=WIDTH, height=HEIGHT))
    shading, frame = prepare(scene), Frame(scene.sensors()[0])
    shading.integrator = mi.load_dict({"type": "visdirect"})
    pilot = look(shading, frame, mi.UInt32(5), 4, True)
    # Before the scene is gone
    dr.eval(vars(pilot))
    return pilot, frame


def decision_of(pilot, frame):
    """What decides how a pixel is sampled, as arrays over pixels: what is believed of the lights, and the effort."""
    from intervis.integrators.decide import decide

    d = decide(pilot, frame, "threshold", 4, True, True)
    fields = {
        "beliefs": [d.label, d.guess, d.mask, d.mean, d.refine, *d.light_seen, *d.light_tried],
        "effort": [d.rays, d.error],
    }
    return {k: [np.broadcast_to(np.array(f), frame.pixels) for f in v] for k, v in fields.items()}


@pytest.mark.parametrize(
    "part",
    [
        "beliefs",
        "effort",
    ],
)
@pytest.mark.parametrize("name", ["wires", "manylights", "glossy"])
def test_a_pixel_does_not_decide_from_its_own_pilot(variant_llvm, name, part):
    pilot, frame = pilot_and_frame(name)
    before = decision_of(pilot, frame)[part]

    # The pixel alone sees something else: every ray blocked, and another brightness
    here = dr.arange(mi.UInt32, frame.pixels) == PIXEL
    pilot.seen = [dr.select(here, mi.UInt64(0), w) for w in pilot.seen]
    pilot.tried = [dr.select(here, mi.UInt64(0x0404040404040404), w) for w in pilot.tried]
    for field in ("value", "control", "bright", "straight"):
        setattr(pilot, field, dr.select(here, mi.Color3f(0.5), getattr(pilot, field)))
    pilot.noise = dr.select(here, mi.Float(0.5), pilot.noise)
    if name == "glossy":
        pilot.unlike = dr.select(here, mi.Float(0.5), pilot.unlike)
    after = decision_of(pilot, frame)[part]

    # The change did reach the neighbours, so the test can fail
    assert any((old != new).any() for old, new in zip(before, after, strict=True))
    # Sums over windows may be floats: what is left of a pixel that is added and taken away again is rounding
    for old, new in zip(before, after, strict=True):
        assert new[PIXEL] == old[PIXEL]
