"""A multilayer perceptron: as many hidden neurons as features, one output a class (§3.2)."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .classes import VisibilityClass


class MLP:
    """Features → rectified hidden layer → one score a class; the largest score wins.

    Parameters
    ----------
    weights : dict
        ``w1`` (hidden, features), ``b1`` (hidden,), ``w2`` (classes, hidden), ``b2`` (classes,),
        float32.
    """

    def __init__(self, weights: dict[str, np.ndarray]):
        self.weights = weights

    def predict(self, features: np.ndarray) -> np.ndarray:
        """Classify features of shape (..., F); returns classes of shape (...), int64."""
        w = self.weights
        hidden = np.maximum(features @ w["w1"].T + w["b1"], 0)
        return (hidden @ w["w2"].T + w["b2"]).argmax(-1)

    def classify(self, features: list):
        """Classify a list of F Dr.Jit floats; returns a Dr.Jit UInt32. Only traces."""
        w = self.weights
        hidden = [dr.maximum(h, 0) for h in affine(w["w1"], w["b1"], features)]
        return argmax(affine(w["w2"], w["b2"], hidden))

    @classmethod
    def train(cls, features: np.ndarray, labels: np.ndarray, seed: int, epochs: int = 100, batch: int = 256) -> MLP:
        """Train by Adam on the cross-entropy, reproducibly from ``seed``.

        Parameters
        ----------
        features : ndarray, shape (M, F), float32
        labels : ndarray, shape (M,), int
        seed : int
        epochs, batch : int
            Rounds over the patterns, and patterns a step.
        """
        rng = np.random.default_rng(seed)
        m, f = features.shape
        c = len(VisibilityClass)
        w = {
            "w1": rng.normal(0, (2 / f) ** 0.5, (f, f)) * 3,
            "b1": np.zeros(f),
            "w2": rng.normal(0, f**-0.5, (c, f)),
            "b2": np.zeros(c),
        }
        target = np.eye(c)[labels]
        first, second = ({k: np.zeros_like(v) for k, v in w.items()} for _ in range(2))
        steps, step = epochs * (m // batch), 0
        for _ in range(epochs):
            order = rng.permutation(m)
            for start in range(0, m - batch + 1, batch):
                x, y = (
                    features[order[start : start + batch]].astype(np.float64),
                    target[order[start : start + batch]],
                )

                # Forward, then the gradient of the mean cross-entropy backward
                hidden = np.maximum(x @ w["w1"].T + w["b1"], 0)
                score = hidden @ w["w2"].T + w["b2"]
                p = np.exp(score - score.max(1, keepdims=True))
                error = (p / p.sum(1, keepdims=True) - y) / batch
                back = (error @ w["w2"]) * (hidden > 0)
                gradient = {"w2": error.T @ hidden, "b2": error.sum(0), "w1": back.T @ x, "b1": back.sum(0)}

                # Adam, with a learning rate that falls to zero along a cosine
                step += 1
                rate = 0.02 * 0.5 * (1 + np.cos(np.pi * step / steps))
                for k, g in gradient.items():
                    first[k] = 0.9 * first[k] + 0.1 * g
                    second[k] = 0.999 * second[k] + 0.001 * g * g
                    w[k] -= rate * (first[k] / (1 - 0.9**step)) / (np.sqrt(second[k] / (1 - 0.999**step)) + 1e-8)
        return cls({k: v.astype(np.float32) for k, v in w.items()})


def affine(matrix: np.ndarray, offset: np.ndarray, x: list) -> list:
    """Return ``matrix @ x + offset`` for a list of Dr.Jit floats; zero weights cost nothing."""
    out = []
    for row, b in zip(matrix.tolist(), offset.tolist(), strict=True):
        total = type(x[0])(b)
        for weight, value in zip(row, x, strict=True):
            if weight:
                total = dr.fma(value, weight, total)
        out.append(total)
    return out


def argmax(scores: list):
    """Return the index of the largest of a list of Dr.Jit floats, the first one on a tie, as UInt32."""
    UInt32 = dr.uint32_array_t(type(scores[0]))
    best, index = scores[0], UInt32(0)
    for i, s in enumerate(scores[1:], 1):
        index = dr.select(s > best, UInt32(i), index)
        best = dr.maximum(best, s)
    return index
