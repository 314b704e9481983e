"""The simple rule to beat: thresholds on the mean visibility and on the share of partly visible clusters."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .classes import VisibilityClass as C


class Threshold:
    """Decide from the histogram alone.

    The mean level decides fully visible and invisible; above a share of gray clusters the blocker
    counts as see-through, and black and white clusters beside the gray ones tell the four see-
    through classes apart.

    Parameters
    ----------
    weights : dict
        ``levels`` (1,) gray levels G, ``rule`` (3,): distance of the mean level to 0 or 1 that
        still counts as invisible or visible; share of gray clusters from which a blocker is see-
        through; share of black or white clusters from which a region of that kind is present.
    """

    def __init__(self, weights: dict[str, np.ndarray]):
        self.weights = weights

    def _parts(self, h):
        """Return the mean level and the shares of gray, black and white clusters from a list of features."""
        levels = int(self.weights["levels"][0])
        mean = sum((h[i] * (i / (levels - 1)) for i in range(2, levels)), h[1] * (1 / (levels - 1)))
        gray = 1 - h[0] - h[levels - 1]
        return mean, gray, h[0], h[levels - 1]

    def predict(self, features: np.ndarray) -> np.ndarray:
        """Classify features of shape (..., F); returns classes of shape (...), int64."""
        mean, gray, black, white = self._parts([features[..., i] for i in range(features.shape[-1])])
        near, mixed, region = self.weights["rule"].tolist()
        out = np.where(
            black >= region,
            np.where(white >= region, C.PARTIAL_SOLID_SEE_THROUGH, C.FULL_SOLID_SEE_THROUGH),
            np.where(white >= region, C.PARTIAL_SEE_THROUGH, C.FULL_SEE_THROUGH),
        )
        out = np.where(gray >= mixed, out, C.PARTIAL_SOLID)
        out = np.where(mean >= 1 - near, C.FULLY_VISIBLE, out)
        return np.where(mean <= near, C.INVISIBLE, out)

    def classify(self, features: list):
        """Classify a list of F Dr.Jit floats; returns a Dr.Jit UInt32. Only traces."""
        UInt32 = dr.uint32_array_t(type(features[0]))
        mean, gray, black, white = self._parts(features)
        near, mixed, region = self.weights["rule"].tolist()

        def choose(mask, yes, no):
            return dr.select(
                mask,
                UInt32(int(yes)) if isinstance(yes, C) else yes,
                UInt32(int(no)) if isinstance(no, C) else no,
            )

        has_white = white >= region
        out = choose(
            black >= region,
            choose(has_white, C.PARTIAL_SOLID_SEE_THROUGH, C.FULL_SOLID_SEE_THROUGH),
            choose(has_white, C.PARTIAL_SEE_THROUGH, C.FULL_SEE_THROUGH),
        )
        out = choose(gray >= mixed, out, C.PARTIAL_SOLID)
        out = choose(mean >= 1 - near, C.FULLY_VISIBLE, out)
        return choose(mean <= near, C.INVISIBLE, out)

    @classmethod
    def train(cls, features: np.ndarray, labels: np.ndarray, seed: int = 0) -> Threshold:
        """Try all thresholds on a grid and keep the most accurate.

        Parameters
        ----------
        features : ndarray, shape (M, F), float32
        labels : ndarray, shape (M,), int
        seed : int
            Unused; every classifier trains through the same call.
        """
        f = features.shape[1]
        levels = round((np.sqrt(9 + 8 * f) - 3) / 2)
        best, rule = -1.0, None
        for near in (0.005, 0.015, 0.025, 0.035, 0.045):
            for mixed in np.arange(0.05, 0.85, 0.05):
                for region in np.arange(0.03, 0.4, 0.06):
                    trial = cls(_weights(levels, near, mixed, region))
                    accuracy = (trial.predict(features) == labels).mean()
                    if accuracy > best:
                        best, rule = accuracy, trial
        return rule


def _weights(levels: int, near: float, mixed: float, region: float) -> dict[str, np.ndarray]:
    return {"levels": np.array([levels], np.int32), "rule": np.array([near, mixed, region], np.float32)}
