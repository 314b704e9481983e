"""A support vector machine on quadratic features, one against the rest, solved in primal form (§3.2)."""

from __future__ import annotations

import numpy as np

from .classes import VisibilityClass
from .mlp import affine, argmax


class SVM:
    """Score of a class = a quadratic polynomial of the features; the largest score wins.

    Parameters
    ----------
    weights : dict
        ``w`` (classes, F + F (F + 1)/2) for the features and then their products in the order of
        the upper triangle, ``b`` (classes,), float32.
    """

    def __init__(self, weights: dict[str, np.ndarray]):
        self.weights = weights

    def predict(self, features: np.ndarray) -> np.ndarray:
        """Classify features of shape (..., F); returns classes of shape (...), int64."""
        return (expand(features) @ self.weights["w"].T + self.weights["b"]).argmax(-1)

    def classify(self, features: list):
        """Classify a list of F Dr.Jit floats; returns a Dr.Jit UInt32. Only traces."""
        products = [features[i] * features[j] for i, j in zip(*np.triu_indices(len(features)), strict=True)]
        return argmax(affine(self.weights["w"], self.weights["b"], features + products))

    @classmethod
    def train(cls, features: np.ndarray, labels: np.ndarray, seed: int = 0, c: float = 1e6) -> SVM:
        """Minimise ‖w‖²/2 + c × (mean squared hinge loss) of each class against the rest, to the minimum.

        Parameters
        ----------
        features : ndarray, shape (M, F), float32
        labels : ndarray, shape (M,), int
        seed : int
            Unused, the problem is convex; every classifier trains through the same call.
        c : float
            Weight of the loss.
        """
        # A third of the patterns gives the same accuracy, and the time is in this matrix
        features, labels = features[::3], labels[::3]
        x = np.concatenate([expand(features), np.ones((len(features), 1))], 1).astype(np.float64)
        w = np.array([_newton(x, np.where(labels == k, 1.0, -1.0), c) for k in range(len(VisibilityClass))])
        return cls({"w": w[:, :-1].astype(np.float32), "b": w[:, -1].astype(np.float32)})


def _newton(x: np.ndarray, sign: np.ndarray, c: float, steps: int = 50) -> np.ndarray:
    """Minimise by Newton's method: the loss is quadratic while the set of margin errors stays the same."""
    regular = np.append(np.ones(x.shape[1] - 1), 0)
    scale = c / len(x)

    def loss(w):
        return 0.5 * w @ (regular * w) + 0.5 * scale * np.sum(np.maximum(1 - sign * (x @ w), 0) ** 2)

    w = np.zeros(x.shape[1])
    value = loss(w)
    for _ in range(steps):
        slack = 1 - sign * (x @ w)
        wrong = slack > 0
        gradient = regular * w - scale * ((slack * sign * wrong) @ x)
        hessian = np.diag(regular + 1e-9) + scale * (x[wrong].T @ x[wrong])
        move, length = np.linalg.solve(hessian, gradient), 1.0
        while (trial := loss(w - length * move)) > value and length > 1e-6:
            length /= 2
        if value - trial <= 1e-7 * value:
            break
        w, value = w - length * move, trial
    return w


def expand(features: np.ndarray) -> np.ndarray:
    """Append all products of two features, shape (..., F + F (F + 1)/2)."""
    i, j = np.triu_indices(features.shape[-1])
    return np.concatenate([features, features[..., i] * features[..., j]], -1)
