"""Many lights as trees of clusters: a hit compares a few clusters, then goes down the one it has chosen.

Where a scene has more lights than are worth comparing one by one, they are halved again and again, where places and
normals spread most, as in Conty Estévez and Kulla, *Importance Sampling of Many Lights with Adaptive Tree Splitting*
(2018). A cluster is bounded as a light is: by a sphere, and by a cone that holds all normals. The largest, the *tops*, are
compared jointly, as a few single lights would be. Below them a light is found by one decision of two a level.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

TOPS = 64  # most lights, or clusters of them, that are compared jointly
COUNTED = 16  # most lights, or clusters of them, whose visibility is told apart
_LEAST = 0.25  # share of a cluster's lights, at least, on either side of a cut


@dataclass
class Clusters:
    """Trees over the lights, in arrays that kernels gather from; nodes are numbered from the tops down, siblings in a row.

    Attributes
    ----------
    tops : int
        Number of trees, whose roots are the first nodes.
    table : mi.Float
        Twelve numbers a node, as in `lights.Lights.table`; the last is how many lights there are below.
    widest : mi.Float
        Largest radius among each node's lights.
    child : mi.UInt32
        First child of each node; 0 for single lights.
    after : mi.UInt32
        Node that follows once a node and all below it are done with; the number of nodes after the last.
    parent : mi.UInt32
        Of each node; its own number for tops.
    light, node : mi.UInt32
        Light of each node without children, and node of each light.
    counter : mi.UInt32
        Of each top: which of the `COUNTED` clusters it is part of.
    """

    tops: int
    table: object
    widest: object
    child: object
    after: object
    parent: object
    light: object
    node: object
    counter: object


def _halve(order, begin, features, power, chosen):
    """Cut ranges of a list in two, each along its widest feature, about its mean.

    Parameters
    ----------
    order : ndarray of int, shape (N,)
        Lights, range by range; those of ranges that are cut are put in order, in place.
    begin : ndarray of int, shape (R + 1,)
        Where ranges begin, and N.
    features : ndarray, shape (N, F)
        By light.
    power : ndarray, shape (N,)
    chosen : ndarray of bool, shape (R,)
        Ranges to cut, of two lights or more.

    Returns
    -------
    ndarray of int, shape (R + 1 + number of cuts,)
        Where ranges begin now, and N.
    """
    size = np.diff(begin)
    group = np.repeat(np.arange(len(size)), size)
    x, w = features[order], power[order, None] + 1e-3 * power.max() + 1e-300
    sums = lambda v: np.add.reduceat(v, begin[:-1], axis=0)  # noqa: E731
    mean = sums(w * x) / sums(w)
    axis = np.argmax(sums(w * (x - mean[group]) ** 2), axis=1)
    value = x[np.arange(len(x)), axis[group]]
    at = np.lexsort((np.where(chosen[group], value, 0), group))
    order[:] = order[at]
    low = np.add.reduceat((value[at] <= mean[group, axis[group]]).astype(np.int64), begin[:-1])
    least = np.maximum((size * _LEAST).astype(np.int64), 1)
    cut = begin[:-1] + np.clip(low, least, size - least)
    return np.sort(np.concatenate([begin, cut[chosen]]))


def _bound(order, begin, rows):
    """Bound ranges of lights by spheres and cones.

    Parameters
    ----------
    order, begin : ndarray of int
        As in `_halve`.
    rows : ndarray, shape (N, 9)
        As `lights.collect` has them: centre, normal, cosine of the normals' cone, radius and brightness.

    Returns
    -------
    rows : ndarray, shape (R, 9)
        The same of each range.
    widest : ndarray, shape (R,)
        Largest radius in each.
    beams : ndarray, shape (R,)
        Whether all in it are spots.
    """
    r = rows[order]
    size = np.diff(begin)
    group = np.repeat(np.arange(len(size)), size)
    c, n, cone, radius, phi = r[:, :3], r[:, 3:6], r[:, 6], r[:, 7], r[:, 8]
    reach = np.maximum(radius, 0)[:, None]
    over = lambda f, v: f.reduceat(v, begin[:-1], axis=0)  # noqa: E731
    centre = 0.5 * (over(np.minimum, c - reach) + over(np.maximum, c + reach))
    ball = over(np.maximum, np.linalg.norm(c - centre[group], axis=1) + reach[:, 0])
    total = over(np.add, phi)
    mean = over(np.add, n * phi[:, None]) / np.maximum(total, 1e-300)[:, None]
    length, own = np.linalg.norm(mean, axis=1), np.linalg.norm(n, axis=1)
    # The widest angle from the mean normal that any light's normals reach
    cosine = np.einsum("ij,ij->i", n, mean[group]) / np.maximum(own * length[group], 1e-300)
    angle = np.arccos(np.clip(cosine, -1, 1)) + np.arccos(np.clip(cone, -1, 1))
    angle = over(np.maximum, np.where((own > 0) & (cone > -1) & (length[group] > 1e-3), angle, np.pi))
    # Not one plane, even where all face alike
    wide = np.where(angle < 0.5 * np.pi, np.minimum(np.cos(angle), 1 - 1e-6), -1.0)
    infinite = over(np.minimum, radius) < 0
    bound = np.column_stack([centre, mean, wide, np.where(infinite, -1.0, ball), total])
    # Lights themselves stay as they are
    beams = over(np.logical_and, (radius == 0) & (own > 0))
    return np.where((size == 1)[:, None], r[begin[:-1]], bound), over(np.maximum, radius), beams


def _split(order, begin, features, power, most):
    # Halve all clusters for as long as there are fewer than `most`; the brightest first where there is not room for all
    while True:
        size = np.diff(begin)
        phi = np.add.reduceat(power[order], begin[:-1])
        rank = np.argsort(np.argsort(-np.where(size > 1, phi, -1.0), kind="stable"))
        chosen = (size > 1) & (rank < most - len(size))
        if not chosen.any():
            return begin
        begin = _halve(order, begin, features, power, chosen)


def build(rows: np.ndarray, pack) -> Clusters | None:
    """Make trees over more than `COUNTED` lights; None for fewer.

    Parameters
    ----------
    rows : ndarray, shape (N, 9)
        As `lights.collect` has them.
    pack : callable
        From such rows, and the number of lights in each (negative where all are spots), to a table of twelve numbers each
        (mi.Float).

    Returns
    -------
    Clusters or None
    """
    if len(rows) <= COUNTED:
        return None
    # Lights at infinity have clusters of their own
    infinite, power = rows[:, 7] < 0, rows[:, 8]
    order = np.argsort(infinite, kind="stable")
    begin = np.unique([0, int((~infinite).sum()), len(rows)])
    extent = max(float(np.ptp(rows[~infinite, :3], axis=0).max()) if not infinite.all() else 0.0, 1e-300)
    features = np.concatenate([rows[:, :3] * (2 / extent), rows[:, 3:6]], axis=1)

    counted = _split(order, begin, features, power, COUNTED)
    begin = _split(order, counted, features, power, TOPS)
    counter = np.searchsorted(counted, begin[:-1], side="right") - 1
    tops = len(counter)

    # Level by level: children of a level's clusters follow all of that level
    child, parent, light, parts, widest, sizes = [], [np.arange(tops)], [], [], [], []
    at, done = np.arange(tops), tops  # numbers of the level's nodes, and how many nodes there are
    while True:
        size = np.diff(begin)
        inner = size > 1
        bound, wide, beams = _bound(order, begin, rows)
        parts.append(bound)
        widest.append(wide)
        sizes.append(np.where(beams, -size, size))
        light.append(np.where(inner, 0, order[begin[:-1]]))
        first = done + 2 * (np.cumsum(inner) - 1)
        child.append(np.where(inner, first, 0))
        if not inner.any():
            break
        parent.append(np.repeat(at[inner], 2))
        done += 2 * int(inner.sum())
        # Single lights are done with
        cut = _halve(order, begin, features, power, inner)
        kept = np.repeat(inner, np.where(inner, 2, 1))
        order, begin = _only(order, cut, kept)
        at = np.arange(done - len(begin) + 1, done)
    child, parent, light = (np.concatenate(x) for x in (child, parent, light))
    leaves = np.flatnonzero(child == 0)
    node = np.zeros(len(rows), dtype=np.int64)
    node[light[leaves]] = leaves
    after = np.arange(1, len(child) + 1)
    after[tops - 1] = len(child)
    for k in range(tops, len(child)):
        # A second child is followed by what follows its parent
        if (k - tops) % 2:
            after[k] = after[parent[k]]
    as_index = lambda v: mi.UInt32(v.astype(np.uint32))  # noqa: E731
    return Clusters(
        tops,
        pack(np.concatenate(parts), np.concatenate(sizes)),
        mi.Float(np.concatenate(widest).astype(np.float32)),
        *(as_index(v) for v in (child, after, parent, light, node, counter)),
    )


def _only(order, begin, kept):
    # Ranges of a list, some left out
    size = np.diff(begin)
    return order[np.repeat(kept, size)], np.concatenate([[0], np.cumsum(size[kept])])


def _first(importance, child):
    # Chance of the first of two siblings
    a, b = importance(child), importance(child + 1)
    return a / dr.maximum(a + b, 1e-30)


@dr.syntax
def descend(clusters: Clusters, importance, node, u, active):
    """Find a light below a top, by chance: at every fork in proportion to the importances of both sides.

    Parameters
    ----------
    clusters : Clusters
    importance : callable
        From a node to its importance.
    node : mi.UInt32
        The top.
    u : mi.Float
        Uniform number, in [0, 1).
    active : mi.Bool

    Returns
    -------
    light : mi.UInt32
    chance : mi.Float
        Of this light among those below the top.
    u : mi.Float
        Uniform again.
    """
    node, u, chance = mi.UInt32(node), mi.Float(u), mi.Float(1)
    child = dr.gather(mi.UInt32, clusters.child, node, active)
    while active & (child > 0):
        share = _first(importance, child)
        first = u < share
        part = dr.select(first, share, 1 - share)
        u = dr.clip(dr.select(first, u, u - share) / dr.maximum(part, 1e-30), 0, 1 - 2**-20)
        chance *= part
        node = dr.select(first, child, child + 1)
        child = dr.gather(mi.UInt32, clusters.child, node)
    return dr.gather(mi.UInt32, clusters.light, node, active), chance, u


@dr.syntax
def ascend(clusters: Clusters, importance, light, active):
    """Return the top above a light, and the light's chance of being found from there by `descend`."""
    node, chance = dr.gather(mi.UInt32, clusters.node, light, active), mi.Float(1)
    while active & (node >= clusters.tops):
        second = (node - clusters.tops) & 1
        share = _first(importance, node - second)
        chance *= dr.select(second == 0, share, 1 - share)
        node = dr.gather(mi.UInt32, clusters.parent, node)
    return node, chance
