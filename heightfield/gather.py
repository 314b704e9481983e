"""Light gathered over one direction: what the surface shows below the horizon (the sky above it: `skylight`).

A receiver of unit normal ``n`` sees, in a sector of azimuth around the horizontal direction ``d``, radiance ``L(e)`` at
elevation ``e``. With ``a = n·d`` its irradiance from the sector is, per radian of azimuth,

    ∫ L(e) (n_z sin e + a cos e) cos e de  =  Σ L_i [W(e_i) − W(e_{i−1})],    W(e) = n_z sin²e / 2 + a (e + sin e cos e) / 2 ,

so every newly visible piece of surface adds its radiance times a difference of W (§10.1, third way: exact over the visible
points). Elevations below the receiver's own tangent plane count nothing. A receiver may have several normals: where triangles
meet, each has its own.

Radiance is straight over each triangle, so that of a piece is taken where the middle of what is seen of it lies.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from .lanes import LANES
from .lanes_light import BEST, EACH, MINE, UP, climb, face, facet, measure, pour, shine, start, tint, total, worth
from .lanes_skip import soon
from .skip import AHEAD, SIZES, leaves, seek


class Shown(NamedTuple):
    """What the surface shows at the crossings of one direction's rays, from all receivers that lie alike in their cells.

    Attributes
    ----------
    corners : (4 n,) int64 array
        Places in the radiance, from the receiver's cell, of the triangle before each crossing: at the two ends of the edge
        over which the ray enters it, and of the one over which it leaves.
    weight : (n + 1,) float32 array
        Of the second ends: of each crossing's entry, and at the end the last one's way out.
    bend : (n,) float32 array
        See `bends`.
    """

    corners: np.ndarray
    weight: np.ndarray
    bend: np.ndarray


def bends(distance: np.ndarray) -> np.ndarray:
    """Return how far from each crossing to the next, on average, lies what is seen of a straight surface between them.

    Tangents are seen alike often: at share ``s`` of the way from distance 1 to ``r`` the tangent is ``s r / (1 + s (r − 1))``
    of its way, so the mean of ``s`` is ``1 − r (1 − ln r / (r − 1)) / (r − 1)``: a half from afar, 0 where the receiver lies
    on the surface.

    Parameters
    ----------
    distance : (n,) array
        Of the crossings, rising; the first stretch begins at 0.

    Returns
    -------
    (n,) float64 array
    """
    before = np.concatenate([[0.0], distance[:-1]])
    r = distance / np.maximum(before, 1e-9 * distance)
    far = np.maximum(r - 1, 1e-3)
    return np.where(r < 1 + 1e-3, 0.5, 1 - r * (1 - np.log(r) / far) / far)


@nb.njit(cache=True)
def _strip(
    heights, stride, edge, top, light, image, corners, passed, bend, slack, share, east, north, per_east, per_south,
    own, normals, edges, beside, horizon, out, pitch, channels, i,
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins,
):  # fmt: skip
    # `surface` for receivers in rows ``i`` to ``i + 15``
    leave, mine, best, size = leaves(down, stride, i), MINE * LANES, BEST * LANES, len(own)
    facing, flat = max(len(beside), 1), np.zeros_like(edges)
    work, sums = np.zeros((UP + EACH * facing) * LANES, np.float32), np.zeros(facing * channels * LANES, np.float32)
    # As many as a ray crosses in one stretch, one before and one to overwrite
    most = LANES * (2 + max([upto[min(k + SIZES[0], len(upto) - 1)] - upto[k] for k in range(len(upto))]))
    which = np.empty(most // LANES, np.int64)
    tangents, rises, spots, sines, cosines, colours = [np.empty(most, np.float32) for _ in range(6)]
    both = np.empty(2 * LANES, np.float32)
    looked = 0
    for x in range(size // pitch):
        place, at, last = x * stride + i, x * pitch + i, min(edge - x, leave)
        for values in (horizon, own):
            soon(values, at + AHEAD * pitch)
        for q in range(channels * facing):
            soon(out, q * size + at + AHEAD * pitch)
        if horizon[at] == np.inf:
            # None of the sixteen receives
            continue
        start(work, horizon, own, at)
        if facing == 1:
            for q in range(3):
                soon(normals, q * size + at + AHEAD * pitch)
            face(work, normals, size, at, east, north)
        for q in range(len(beside)):
            # What lies beyond the border is no triangle: any will do
            there = x + beside[q, 0] >= 0 and x + beside[q, 1] <= edge
            facet(work, q, heights, place, edges if there else flat, east, north, per_east, per_south)
        # To the first whole stretch all is looked at
        begin, k = 0, min(SIZES[0] - (x & (SIZES[0] - 1)), last)
        while True:
            end = upto[k]
            seen = climb(work, heights, place, first, second, weight, scale, drop, begin, end, tangents, which)
            if seen > 0:
                measure(work, facing == 1, tangents, begin, which, seen, scale, bend, rises, sines, cosines, spots)
                for m in range(channels):
                    tint(which, spots, seen, corners, passed, light, m * image + place, colours)
                    total(sines, cosines, colours, seen, both)
                    for q in range(facing):
                        shine(work, q, rises, sines, cosines, colours, seen, both, sums, (m * facing + q) * LANES)
            looked += end - begin
            k, tests = seek(down, inverse, fall, tops, begins, stride, x, i, k, last, None, work, mine, work, best, 0)
            looked += tests
            if k == last:
                break
            if slack > 0:
                more = False
                for q in range(facing):
                    more |= worth(work, q, top, inverse[k], fall[k], slack)
                if not more:
                    break
            begin, k = upto[k], min(k + SIZES[0], last)
        for lane in range(LANES):
            horizon[at + lane] = work[best + lane]
        for m in range(channels * facing):
            pour(sums, m * LANES, share, out, m * size + at)
    return looked


@nb.njit(cache=True)
def edges_of(places, size, stride):
    """Return the places of facets' edges in a laid field, flat, and the first and last of their columns, (f, 2).

    ``size`` is that of one of the field's planes, ``stride`` that of one of its columns.
    """
    edges = (places[:, :, 0] * size + places[:, :, 1] + places[:, :, 2] * stride).ravel()
    beside = np.empty((len(places), 2), np.int64)
    for q in range(len(places)):
        beside[q, 0], beside[q, 1] = places[q, :, 2].min(), places[q, :, 2].max()
    return edges, beside


@nb.njit(cache=True, parallel=True)
def surface(laid, radiance, own, normals, facets, toward, way, shown, slack, share, horizon, out, receivers):
    """Add to ``out`` the irradiance that the surface sends along one direction's rays, times ``share``.

    Parameters
    ----------
    laid : (S², columns, rows + margin) float32 array
        Turned heights, centred, as `faces.planes` deals them.
    radiance : (channels, 6 · S² [+ 6], columns − 1, rows + margin) float32 array
        At the triangles' corners, a row before the first and one behind the last, as `faces.bordered` has them; then,
        if they differ, those of whole triangles as who stands there sees them.
    own : (n, m) float32 array
        The receivers' heights; columns lie first, m is a multiple of 16.
    normals : (3, n, m) float32 array
        Their unit normals, where they have one.
    facets : Facets
        Of receivers that have none, but triangles that meet them.
    toward : (float, float)
        East and north components of the direction.
    way : skip.Way
    shown : Shown
    slack : float
        Stop where all that may still appear weighs less than this, over all receivers side by side.
    share : float
        Factor of what is added.
    horizon : (n, m) float32 array
        −∞, or ∞ for what is no receiver; tangents of their horizons afterwards. What a receiver's normal's plane hides counts
        as well.
    out : (channels, f, n, m) float32 array
    receivers : int
        Rows of receivers.

    Returns
    -------
    int
        Crossings looked at and tests of stretches, over all receivers.
    """
    heights, light, image, strips = laid.ravel(), radiance.ravel(), radiance[0].size, own.shape[1] // LANES
    top, half, looked = heights.max(), (strips + 1) // 2, 0
    mine, up, found, sums = own.ravel(), normals.ravel(), horizon.ravel(), out.ravel()
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins = way
    (corners, passed, bend), (places, per_east, per_south), (east, north) = shown, facets, toward
    edges, beside = edges_of(places, laid[0].size, laid.shape[2])
    for t in nb.prange(strips):
        i = LANES * (2 * t if t < half else 2 * (t - half) + 1)
        looked += min(LANES, receivers - i) * _strip(
            *(heights, laid.shape[2], laid.shape[1] - 1, top, light, image, corners, passed, bend, slack, share),
            *(east, north, per_east, per_south, mine, up, edges, beside, found, sums, own.shape[1], len(out), i),
            *(first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins),
        )
    return looked
