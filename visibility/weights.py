"""The shipped classifiers: stored weights, loaded when first asked for."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from ..errors import InputError, suggest
from .mlp import MLP
from .svm import SVM
from .threshold import Threshold

KINDS = {"mlp": MLP, "svm": SVM, "threshold": Threshold}
SIZES = (3, 4, 5, 6)
"""Grid sizes the classifiers were trained for; others use the nearest."""
LEVELS = 4
PATH = Path(__file__).with_name("weights.npz")


@cache
def load(kind: str, size: int = 4):
    """Return a trained classifier.

    Parameters
    ----------
    kind : {'mlp', 'svm', 'threshold'}
    size : int
        Clusters an axis (the root of their number); the nearest trained size is taken.

    Returns
    -------
    MLP, SVM or Threshold

    Raises
    ------
    InputError
        If there is no such classifier.
    """
    if kind not in KINDS:
        raise InputError(f"'classifier' must be one of {', '.join(KINDS)} (got '{kind}'){suggest(str(kind), KINDS)}")
    size = min(SIZES, key=lambda s: abs(s - size))
    prefix = f"{kind}/{size}/"
    with np.load(PATH) as stored:
        return KINDS[kind]({k[len(prefix) :]: stored[k] for k in stored.files if k.startswith(prefix)})
