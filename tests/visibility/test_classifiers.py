import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import intervis
from intervis.visibility import (
    GROUPS,
    classify,
    classify_clusters,
    classify_grid,
    features,
    grid_positions,
    patterns,
    quantize,
    weights,
)
from intervis.visibility import VisibilityClass as C
from intervis.visibility.svm import expand
from intervis.visibility.train import main, samples, train

KINDS = tuple(weights.KINDS)
FLOOR = {"mlp": 0.98, "svm": 0.98, "threshold": 0.93}
UNSEEN = 777_001  # no training uses this seed

g, o = 0.5, 0.4
BY_HAND = {
    C.FULLY_VISIBLE: np.ones(16),
    C.INVISIBLE: np.zeros(16),
    C.PARTIAL_SOLID: [1, 1, 0, 0] * 4,
    C.FULL_SEE_THROUGH: [g, o, o, g, o, o, g, 0.6, g, g, o, 0.6, 0.6, o, g, o],
    C.PARTIAL_SEE_THROUGH: [1, 1, g, o] * 4,
    C.FULL_SOLID_SEE_THROUGH: [0, 0, g, o] * 4,
    C.PARTIAL_SOLID_SEE_THROUGH: [1] * 5 + [g, o, o, g, o, g] + [0] * 5,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("expected", list(C), ids=lambda c: c.name)
def test_textbook_patterns(kind, expected):
    assert classify(BY_HAND[expected], classifier=kind) == expected


@pytest.mark.parametrize("kind", KINDS)
def test_held_out_accuracy(kind):
    f, y = patterns.generate(3500, UNSEEN)
    assert np.mean(classify(f, classifier=kind) == y) >= FLOOR[kind]


@pytest.mark.parametrize("kind, floor", [("mlp", 0.95), ("svm", 0.945)])
def test_held_out_accuracy_with_few_rays(kind, floor):
    f, y = patterns.generate(3500, UNSEEN, rays=(4, 8))
    found = classify(f, classifier=kind)
    assert np.mean(found == y) >= floor
    # What the integrator asks is easier: lit, hidden, solid edge, or anything see-through
    group = np.array(GROUPS)
    assert np.mean(group[found] == group[y]) >= 0.965


def test_co_occurrence_tells_what_the_histogram_cannot():
    # Fig. 5f and 5g: a fence between the open and a wall, and a strip of light between two walls
    fence = [1, 1, 1, 1, 0.6, 0.6, 0.6, 0.4, 0.6, 0.4, 0.1, 0, 0.4, 0, 0, 0]
    strip = [0.8, 1, 0.2, 0, 0.2, 1, 0.6, 0, 0, 0.7, 1, 0.1, 0, 0.2, 1, 0.7]
    assert np.bincount(quantize(fence)).tolist() == np.bincount(quantize(strip)).tolist()
    assert classify(fence) == C.PARTIAL_SOLID_SEE_THROUGH
    assert classify(strip) == C.PARTIAL_SOLID


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [3, 4, 6])
def test_batch_equals_numpy(variant_llvm, kind, n):
    f, _ = patterns.generate(700, 3, n, rays=(4, 8))
    cells = [mi.Float(np.ascontiguousarray(c)) for c in f.T]
    expected = classify(f, classifier=kind)
    got = classify_grid(cells, kind)
    assert isinstance(got, mi.UInt32 | dr.detached_t(mi.UInt32))
    # Scores are sums in another order: only an exact tie may differ
    assert np.mean(got.numpy() == expected) >= 0.998
    positions = [tuple(map(float, p)) for p in grid_positions(n)]
    assert dr.all(classify_clusters(cells, positions, kind) == got)


def test_scattered_clusters_of_an_object():
    # Clusters of a jittered grid, half of the object behind a wall, a few culled
    rng = np.random.default_rng(2)
    p = grid_positions(5) + rng.uniform(-0.01, 0.01, (25, 2))
    f = (p[:, 0] > 0.5).astype(float)
    f[[3, 12]] = np.nan
    assert classify(f, p) == C.PARTIAL_SOLID
    assert classify(np.stack([f, np.ones(25), np.zeros(25)]), p).tolist() == [C.PARTIAL_SOLID, 0, 1]


@pytest.mark.parametrize(
    "arguments, words",
    [
        (([0.5] * 15,), "square grid"),
        (([],), "N >= 1"),
        ((0.5,), "shape"),
        (([1.2] + [0.5] * 15,), "[0, 1]"),
        (([-0.1] + [0.5] * 15,), "-0.1"),
        (([np.inf] + [0.5] * 15,), "[0, 1]"),
        (([np.nan] * 16,), "not culled"),
        (([0.5] * 3, [(0, 0)] * 4), "(3, 2)"),
        (([0.5] * 2, [(0, 0), (np.nan, 1)]), "finite"),
        ((["a"] * 16,), "numbers"),
        (([0.5] * 16, None, "mpl"), "did you mean 'mlp'"),
    ],
)
def test_wrong_input_is_one_sentence(arguments, words):
    with pytest.raises(intervis.InputError) as error:
        classify(*arguments)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_wrong_batches(variant_llvm):
    with pytest.raises(intervis.InputError, match="n×n"):
        classify_grid([mi.Float(1)] * 5)
    with pytest.raises(intervis.InputError, match="clusters"):
        classify_clusters([mi.Float(1)] * 5, [(0, 0)] * 4)
    with pytest.raises(intervis.InputError, match="classifier"):
        classify_grid([mi.Float(1)] * 16, "tree")


def test_single_and_coincident_clusters_have_a_class():
    assert classify([1.0], [(0, 0)]) in set(C)
    assert classify([0.0] * 4, [(1, 1)] * 4) in set(C)


QUICK = {k: v for k, v in weights.KINDS.items() if k != "svm"}  # threaded BLAS makes small SVMs slow on busy cores


def test_training_is_reproducible(monkeypatch):
    monkeypatch.setattr(weights, "KINDS", QUICK)
    first, again, other = (train(seed, sizes=(4,), count=700) for seed in (3, 3, 4))
    assert first.keys() == again.keys()
    for key in first:
        np.testing.assert_array_equal(first[key], again[key])
    assert not np.array_equal(first["mlp/4/w1"], other["mlp/4/w1"])
    # 14-14-7 (§3.2)
    assert first["mlp/4/w1"].shape == (14, 14) and first["mlp/4/w2"].shape == (7, 14)


def test_svm_reaches_the_minimum():
    # Two gray levels keep it small: no step in any direction lowers the convex loss of a class
    x, y = samples(600, 0, levels=2)
    trained = weights.KINDS["svm"].train(x, y, c=100.0)
    phi, sign = expand(x[::3]).astype(float), np.where(y[::3] == C.PARTIAL_SOLID, 1.0, -1.0)

    def loss(w, b):
        slack = np.maximum(1 - sign * (phi @ w + b), 0)
        return w @ w / 2 + 100 / 2 * np.mean(slack**2)

    w, b = trained.weights["w"][C.PARTIAL_SOLID].astype(float), float(trained.weights["b"][C.PARTIAL_SOLID])
    rng = np.random.default_rng(0)
    for scale in (1e-2, 1e-1, 1.0):
        for step in rng.normal(0, scale, (20, len(w) + 1)):
            assert loss(w + step[:-1], b + step[-1]) > loss(w, b)


def test_command_writes_loadable_weights(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(weights, "KINDS", QUICK)
    monkeypatch.setattr("intervis.visibility.train.COUNT", 300)
    monkeypatch.setattr(weights, "SIZES", (4,))
    target = tmp_path / "weights.npz"
    main(["--seed", "5", "-o", str(target)])
    assert str(target) in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["weights.npz"]
    with np.load(target) as stored:
        assert {k.split("/")[0] for k in stored.files} == set(QUICK)


@pytest.mark.slow
def test_shipped_weights_come_from_seed_zero(monkeypatch):
    monkeypatch.setattr(weights, "KINDS", QUICK)
    trained = train(0, sizes=(4,))
    shipped = weights.load("threshold", 4).weights["rule"]
    np.testing.assert_array_equal(trained["threshold/4/rule"], shipped)
    # Rounding may differ between machines, what is learnt may not
    network = QUICK["mlp"]({k[-2:]: v for k, v in trained.items() if k.startswith("mlp")})
    f, _ = patterns.generate(3500, UNSEEN)
    assert np.mean(network.predict(features(f, grid_positions(4))) == classify(f)) >= 0.985


def test_histogram_alone_is_worse():
    # Table 2: the same network without co-occurrence
    x, y = samples(7000, 0)
    network = weights.KINDS["mlp"].train(np.ascontiguousarray(x[:, :4]), y, 0, epochs=60)
    f, z = patterns.generate(3500, UNSEEN, rays=(4, 8))
    t = features(f, grid_positions(4))
    assert np.mean(network.predict(t[:, :4]) == z) < np.mean(weights.load("mlp").predict(t) == z) - 0.02
