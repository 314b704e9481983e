"""Visibility configurations: how a point sees a light or an object, from the visibility of its clusters."""

from .batch import cluster_features, grid_features
from .classes import COLORS, GROUPS, NAMES, VisibilityClass
from .classify import classify, classify_clusters, classify_grid
from .features import co_occurrence, features, grid_positions, neighbor_distance, quantize

__all__ = [
    "COLORS",
    "GROUPS",
    "NAMES",
    "VisibilityClass",
    "classify",
    "classify_clusters",
    "classify_grid",
    "cluster_features",
    "co_occurrence",
    "features",
    "grid_features",
    "grid_positions",
    "neighbor_distance",
    "quantize",
]
