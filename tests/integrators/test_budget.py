"""How a budget of rays is spread over the pixels."""

from types import SimpleNamespace

import drjit as dr
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


@pytest.mark.parametrize("rays", [4, 8])
@pytest.mark.parametrize("busy", [0.3, 0.5, 1.0])
def test_the_budget_is_spent_on_average(variant_llvm, busy, rays):
    """What pixels get that look sure is no more than is there for all."""
    rng = np.random.default_rng(1)
    hits = spread(np.where(rng.uniform(size=PIXELS) < busy, rng.uniform(0.01, 0.1, PIXELS), 0), rays)
    assert hits.mean() * (rays + 1) == pytest.approx(64, rel=0.06)


def test_pixels_that_look_sure_are_visited_all_the_same(variant_llvm):
    hits = spread(np.where(np.arange(PIXELS) % 2, 0.1, 0.0), budget=256.0)
    assert hits[::2].min() >= 4 and hits[1::2].min() >= 16


def test_more_error_gets_more_hits_up_to_the_limit(variant_llvm):
    hits = spread(np.where(np.arange(PIXELS) % 2, 0.1, 0.01), max_rays=100)
    assert hits[1::2].mean() > 2 * hits[::2].mean()
    assert hits.max() * 4 <= 100


SIDE = 48
ROW, COLUMN = 24, 9


def expected_error(bright=None, mixed=None, thin=None, glow=None, lamps=None, glints=None, unlike=None, tries=1):
    """Error expected of a hit in each pixel of a picture, all lit evenly but for what is given.

    Parameters
    ----------
    bright : (SIDE, SIDE) array
        Light without shadows.
    mixed : pair of slices
        Pixels half of whose light cells are hidden.
    thin : pair of int
        A pixel one of whose two looks met something black.
    glow : (SIDE, SIDE) array
        Lamps that looks have met.
    lamps : pair of (SIDE, SIDE) arrays
        Mean and mean square of lamps in view, by light samples.
    glints : pair of (SIDE, SIDE) arrays
        Mean and variance of highlights within pixels.
    unlike : pair of (SIDE, SIDE) arrays
        Variance of what BSDF samples find, and the chance that surfaces do not mirror.
    tries : int
        Light samples a pixel and cell; mirrors have none.
    """
    from intervis.integrators.decide import decide

    bright = np.ones((SIDE, SIDE)) if bright is None else bright
    probe = bright.copy()
    if thin is not None:
        probe[thin] = 0
    # Four rays a pixel in cells 0, 5, 10 and 15; packed eight counters to a word
    seen = [np.full((SIDE, SIDE), tries + (tries << 40), np.uint64)]
    seen.append(np.full((SIDE, SIDE), (tries << 16) + (tries << 56), np.uint64))
    tried = [mi.UInt64(w.ravel().copy()) for w in seen]
    if mixed is not None:
        seen[1][mixed] = 0
    n = SIDE * SIDE
    glow, colour = mi.Float(np.zeros(n) if glow is None else glow.ravel()), mi.Color3f(mi.Float(bright.ravel()))
    mean, square = (None, None) if lamps is None else (mi.Float(x.ravel()) for x in lamps)
    told = None
    if glints is not None or unlike is not None:
        nothing = np.zeros((SIDE, SIDE))
        told = (*(glints or (nothing, nothing)), nothing if unlike is None else unlike[1])
    pilot = SimpleNamespace(
        bright=colour,
        straight=mi.Color3f(glow),
        noise=dr.zeros(mi.Float, n),
        proven=dr.zeros(mi.Float, n),
        sky=None,
        rays=4,
        seen=[mi.UInt64(w.ravel()) for w in seen],
        tried=tried,
        probe_bright=mi.Float(probe.ravel()),
        probe_straight=glow,
        shine=None,
        unlike=None if unlike is None else mi.Float(unlike[0].ravel()),
        lamps=mean,
        lamps_squared=square,
        glints=told and [mi.Float(x.ravel()) for x in told],
    )
    frame = SimpleNamespace(width=SIDE, height=SIDE, pixels=n)
    return np.array(decide(pilot, frame, "threshold", 4, False, False).error).reshape(SIDE, SIDE)


def test_what_is_lit_near_shadows_is_looked_at_more_than_what_is_lit_far_away(variant_llvm):
    error = expected_error(mixed=np.s_[ROW - 2 : ROW + 3, 0:5])
    # Windows of 5×5 pixels see it up to column 6, those around them up to column 11
    assert error[ROW, COLUMN] > 3 * error[ROW, 30]
    assert error[ROW, 13] == error[ROW, 30]


def test_what_one_look_has_met_is_expected_nearby(variant_llvm):
    error = expected_error(thin=(ROW, COLUMN - 6))
    assert error[ROW, COLUMN] > 2 * error[ROW, 30]


def test_shading_is_no_edge(variant_llvm):
    x = np.tile(np.arange(SIDE), (SIDE, 1))
    shaded, edge = expected_error(1 + 0.01 * x), expected_error(1.0 + (x > 30))
    # Neighbours that are one per cent apart; inside a pixel light differs by 0.3 %, and nets take most of that away
    assert shaded[ROW, 20] < 0.005
    assert edge[ROW, 30] > 0.2


def test_lamps_below_a_pixel_are_expected_where_light_samples_put_them(variant_llvm):
    mean, square = np.zeros((2, SIDE, SIDE))
    mean[ROW, COLUMN], square[ROW, COLUMN] = 5, 250
    error = expected_error(lamps=(mean, square))
    # A tenth of the pixel at 50: a hit's variance is 0.1 * 0.9 * 50², next to light of 1 + 5
    assert error[ROW, COLUMN] == pytest.approx(np.sqrt(225 / 36.01), rel=0.01)
    # Beside it 3 % of their mean square less their mean's; farther off nothing
    beside = 0.03 * (250 / 8 - (5 / 8) ** 2) / ((5 / 8) ** 2 + 0.01)
    np.testing.assert_allclose(error[ROW - 1 : ROW + 2, COLUMN + 1], np.sqrt(beside), rtol=0.01)
    assert error[ROW, COLUMN + 2] == error[ROW, 40]


def test_lamps_that_looks_have_met_are_left_to_them(variant_llvm):
    """Few light samples of a large lamp make some of its pixels look half covered."""
    glow, mean = np.zeros((2, SIDE, SIDE))
    glow[ROW - 6 : ROW + 7, 10:23], mean[ROW, 16] = 50, 25
    error = expected_error(glow=glow, lamps=(mean, 50 * mean))
    assert error[ROW, 16] == pytest.approx(error[ROW, 14], rel=0.5) and error[ROW, 16] < 0.1


@pytest.mark.parametrize("tries", [0, 1])
def test_highlights_below_a_pixel_are_expected_where_they_are_told(variant_llvm, tries):
    mean, variance = np.zeros((2, SIDE, SIDE))
    mean[ROW, COLUMN], variance[ROW, COLUMN] = 3, 40
    error = expected_error(glints=(mean, variance), tries=tries)
    # Next to light of 1, or of none where none was tried
    assert error[ROW, COLUMN] == pytest.approx(np.sqrt(40 / ((3 + tries) ** 2 + 0.01)), rel=0.01)
    assert error[ROW, COLUMN + 1] == error[ROW, 40]


@pytest.mark.parametrize("chance", [0.0, 0.96])
def test_what_a_pane_mirrors_is_expected_all_over_it(variant_llvm, chance):
    """Looks that happened to pass through say nothing of those that would not."""
    found = np.zeros((SIDE, SIDE))
    found[ROW - 3 : ROW + 4 : 3, COLUMN + 3 : COLUMN + 6] = 2
    error = expected_error(unlike=(found, np.full((SIDE, SIDE), chance)))
    # Nine of the pixels in reach of the windows around; one in fifty counts where surfaces do not choose
    expected = np.sqrt(max(chance, 0.02) * 9 * 2 / (9 * 24) / 1.01)
    assert error[ROW, COLUMN] == pytest.approx(expected, rel=0.3)
    assert error[ROW, 40] < 0.1 * error[ROW, COLUMN]


@pytest.mark.parametrize("surface", ["roughconductor", "roughplastic"])
def test_skies_are_left_to_bsdf_samples_where_surfaces_only_mirror(kit, surface):
    """As many light samples a hit as elsewhere would leave too few of those."""
    from intervis.integrators.camera import Frame
    from intervis.integrators.decide import decide
    from intervis.integrators.pilot import pilot
    from intervis.integrators.shading import prepare

    most = {}
    for light in ({"type": "constant", "radiance": 1.0}, kit.lamp()):
        scene = mi.load_dict(kit.room({"light": light}, bsdf={"type": surface, "alpha": 0.1}))
        shading, frame = prepare(scene), Frame(scene.sensors()[0])
        shading.integrator = mi.load_dict({"type": "visdirect"})
        look = pilot(shading, frame, mi.UInt32(1), 4, True)
        rays = np.array(decide(look, frame, "threshold", 4, False, False).rays)
        most[light["type"]] = rays[np.array(look.shine.lobe) > 0].max()
    assert most["rectangle"] == 8
    assert most["constant"] == 1 if surface == "roughconductor" else most["constant"] > 1
