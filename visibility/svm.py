"""A support vector machine with a quadratic kernel, one against the rest, solved in its primal form (§3.2)."""

from __future__ import annotations

import drjit as dr
import numpy as np
from scipy.optimize import minimize

from .classes import VisibilityClass
from .mlp import affine, argmax


class SVM:
    """Score of a class = a quadratic polynomial of the features; the largest score wins.

    Parameters
    ----------
    weights : dict
        ``w`` (classes, F + F (F + 1)/2) for the features and then their products in the order of the upper triangle,
        ``b`` (classes,), float32.
    """

    def __init__(self, weights: dict[str, np.ndarray]):
        self.weights = weights

    def predict(self, features: np.ndarray) -> np.ndarray:
        """Classify features of shape (..., F); returns classes of shape (...), int64."""
        return (expand(features) @ self.weights["w"].T + self.weights["b"]).argmax(-1)

    def classify(self, features: list):
        """Classify a list of F Dr.Jit floats; returns a Dr.Jit UInt32. Traces code only, evaluates nothing."""
        products = [features[i] * features[j] for i, j in zip(*np.triu_indices(len(features)), strict=True)]
        return argmax(affine(self.weights["w"], self.weights["b"], features + products))

    @classmethod
    def train(cls, features: np.ndarray, labels: np.ndarray, seed: int = 0, c: float = 30.0) -> SVM:
        """Minimise the squared hinge loss with L-BFGS; convex, so the seed does not matter.

        Parameters
        ----------
        features : ndarray, shape (M, F), float32
        labels : ndarray, shape (M,), int
        seed : int
            Unused; every classifier trains through the same call.
        c : float
            Weight of the mean loss against ‖w‖²/2.
        """
        x = np.concatenate([expand(features), np.ones((len(features), 1))], 1).astype(np.float64)

        def loss(w, sign):
            slack = np.maximum(1 - sign * (x @ w), 0)
            value = 0.5 * w[:-1] @ w[:-1] + c * len(VisibilityClass) * np.mean(slack**2)
            return value, np.append(w[:-1], 0) - 2 * c * len(VisibilityClass) / len(x) * ((slack * sign) @ x)

        rows = []
        for k in range(len(VisibilityClass)):
            sign = np.where(labels == k, 1.0, -1.0)
            rows.append(minimize(loss, np.zeros(x.shape[1]), (sign,), "L-BFGS-B", True, options={"maxiter": 300}).x)
        w = np.array(rows, np.float32)
        return cls({"w": w[:, :-1], "b": w[:, -1]})


def expand(features: np.ndarray) -> np.ndarray:
    """Append all products of two features, shape (..., F + F (F + 1)/2)."""
    i, j = np.triu_indices(features.shape[-1])
    return np.concatenate([features, features[..., i] * features[..., j]], -1)
