"""Every scene loads by name, renders, and refuses wrong input in one sentence."""

import subprocess
import sys

import mitsuba as mi
import numpy as np
import pytest

import intervis.scenes as scenes
from intervis.errors import InputError

ALL = [
    "cornell",
    "fence",
    "foliage",
    "glossy",
    "grating",
    "manylights",
    "meshlight",
    "openfloor",
    "penumbra",
    "smalllight",
    "spheres",
    "wires",
]


def picture(scene, spp=16, seed=0):
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0})
    return np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed))


def test_names_are_the_public_functions():
    assert scenes.names() == ALL
    assert all(callable(getattr(scenes, name)) for name in ALL)


@pytest.mark.parametrize("name", ALL)
def test_renders_finite_and_not_black(variant_llvm, name):
    image = picture(mi.load_dict(scenes.load(name, width=48, height=27)))
    assert image.shape == (27, 48, 3)
    assert np.isfinite(image).all() and (image >= 0).all()
    # A picture: a good part of it is lit, and little of it is over-exposed.
    luminance = image.mean(-1)
    assert (luminance > 0.02).mean() > 0.29
    assert (luminance > 1).mean() < 0.15


@pytest.mark.parametrize("name", ALL)
def test_dict_has_the_librarys_film_and_no_integrator(variant_llvm, name):
    made = scenes.load(name)
    film = made["sensor"]["film"]
    assert (film["width"], film["height"]) == (480, 270)
    assert (film["pixel_format"], film["component_format"]) == ("rgb", "float32")
    assert film["rfilter"]["type"] == "box"
    assert made["sensor"]["sampler"] == {"type": "independent", "sample_count": 64}
    assert "integrator" not in made
    assert scenes.load(name, spp=7)["sensor"]["sampler"]["sample_count"] == 7


@pytest.mark.parametrize("name", ALL)
def test_described_and_documented(name):
    assert scenes.describe(name).endswith(".")
    known = scenes.parameters(name)
    assert {"width", "height", "spp"} < set(known)
    documented = getattr(scenes, name).__doc__
    for parameter in known:
        assert parameter in documented.split("Parameters", 1)[1]


def test_unknown_name_suggests_the_nearest():
    with pytest.raises(InputError, match=r"no scene 'pennumbra' \(did you mean 'penumbra'\?\).*wires"):
        scenes.load("pennumbra")
    with pytest.raises(InputError, match=r"no scene 'zzz': choose one of cornell"):
        scenes.load("zzz")


def test_unknown_parameter_suggests_the_nearest(variant_llvm):
    with pytest.raises(InputError, match=r"'fence' has no parameter 'picket' \(did you mean 'pickets'\?\)"):
        scenes.load("fence", picket=3)


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("penumbra", {"light_size": 0}, r"'light_size' must be > 0 \(got 0\)"),
        ("penumbra", {"light_size": float("nan")}, r"'light_size' must be > 0 \(got nan\)"),
        ("penumbra", {"radiance": "bright"}, r"'radiance' must be > 0 \(got 'bright'\)"),
        ("cornell", {"width": 0}, r"'width' must be an integer >= 1 \(got 0\)"),
        ("cornell", {"spp": 1.5}, r"'spp' must be an integer >= 1 \(got 1.5\)"),
        ("foliage", {"seed": -1}, r"'seed' must be an integer >= 0 \(got -1\)"),
        ("meshlight", {"segments": 2}, r"'segments' must be an integer >= 3 \(got 2\)"),
    ],
)
def test_wrong_value_is_said_in_one_sentence(variant_llvm, name, values, sentence):
    with pytest.raises(InputError, match=sentence):
        scenes.load(name, **values)


def test_without_a_variant_it_says_what_to_do():
    code = (
        "import intervis.scenes as s\n"
        "from intervis.errors import InputError\n"
        "for name in s.names():\n"
        "    try:\n"
        "        s.load(name)\n"
        "    except InputError as e:\n"
        "        assert 'mitsuba.set_variant' in str(e), e\n"
        "    else:\n"
        "        raise AssertionError(name)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral", "llvm_ad_mono"])
def test_meshes_and_transforms_follow_the_variant(variant_llvm, variant):
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not compiled in")
    mi.set_variant(variant)
    for name in ("penumbra", "meshlight", "glossy"):
        image = picture(mi.load_dict(scenes.load(name, width=16, height=9)), spp=4)
        assert np.isfinite(image).all() and image.mean() > 0.02
