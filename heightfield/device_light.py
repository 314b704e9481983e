"""Light on a GPU: what receivers gain from the surface and the sky along one direction, a thread each (see `device`).

What they gain is that of `gather` and `skylight`: newly visible pieces of surface times differences of W.
"""

from __future__ import annotations

import functools
import operator
from typing import NamedTuple

import drjit as dr
import numpy as np

from ..errors import interrupts
from . import gather, skip
from .device import Laid, Rays, copied, last_columns, longest, may_see, rays, tangent, types
from .faces import Facets
from .lanes_light import SHORT, TINY
from .lanes_moments import ARC, QUARTER, STEEPEST
from .skylight import NODES


class Normal(NamedTuple):
    """A normal of each receiver: its upward part, that along the direction, and where its plane rises.

    Attributes
    ----------
    up, along : Float
    least : Float
        Tangent at which the plane rises.
    none : Float
        W there.
    """

    up: object
    along: object
    least: object
    none: object


# --- Moments of light over tangents (see `lanes_moments`) -------------------------------------------------------------


def _angle(t):
    # Arc tangent
    z = dr.select(dr.abs(t) > 1, dr.rcp(dr.abs(t)), dr.abs(t))
    q, e = z * z, ARC[0]
    for coefficient in ARC[1:]:
        e = dr.fma(e, q, coefficient)
    e = dr.select(dr.abs(t) > 1, QUARTER - e * z, e * z)
    return dr.select(t < 0, -e, e)


def _moments(t):
    # S, B and ½ (atan t − t c): with the tangent they grow as t c², c² and t² c²
    t = dr.clip(t, -STEEPEST, STEEPEST)
    c, angle = 0.5 / dr.fma(t, t, 1), 0.5 * _angle(t)
    return t * t * c, angle + t * c, angle - t * c


def _weighed(up, along, moments):
    # W, or what is W's, from two moments
    return dr.fma(up, moments[0], along * moments[1])


def _above(n: Normal, t, moments):
    # W at tangents, whose moments are given, and not below the normal's plane
    return dr.select(t > n.least, _weighed(n.up, n.along, moments), n.none)


def _positive(v):
    # Where nothing is visible there is no number: that is 0, too
    return dr.select(v > 0, v, 0)


# --- Normals ----------------------------------------------------------------------------------------------------------


def _normal(up, along, least) -> Normal:
    return Normal(up, along, least, 0.5 * along * _angle(dr.clip(least, -STEEPEST, STEEPEST)))


def _faces(lane, normals, east, north) -> list[Normal]:
    # Of receivers that have one each, (3, n, pitch)
    x, y, up = (dr.gather(type(east), c, lane) for c in normals)
    along = dr.fma(x, east, y * north)
    return [_normal(up, along, -along / up)]


def _facets(kinds, heights, place, x, edge, facets, toward) -> list[Normal]:
    # Of the triangles that meet receivers; see `lanes_light.facet`
    (edges, beside, per_east, per_south), (east, north), out = facets, toward, []
    Float, Int32, *_ = kinds
    for q in range(dr.width(beside) // 2):
        # What lies beyond the border is no triangle: any will do
        first, last = (dr.gather(Int32, beside, Int32(2 * q + k)) for k in (0, 1))
        there = (x + first >= 0) & (x + last <= edge)
        at = [place + dr.gather(Int32, edges, Int32(4 * q + k)) for k in range(4)]
        h = [dr.gather(Float, heights, p, there & (p >= 0)) for p in at]
        u, v = (h[1] - h[0]) * per_east, (h[3] - h[2]) * per_south
        up, least = dr.rsqrt(dr.fma(v, v, dr.fma(u, u, 1))), u * east - v * north
        out.append(_normal(up, -least * up, least))
    return out


# --- The surface ------------------------------------------------------------------------------------------------------


def _middle(kinds, normals, start, near, ratio, old, step, more):
    # How far from where newly seen surface begins its middle lies; see `lanes_light.measure`
    middle = dr.fma(start, 0.5 - near, near)
    up = old >= 0
    level = dr.select(up, kinds.Float(1), 0), dr.select(up, kinds.Float(0), 1)
    shares = (normals[0].up, normals[0].along) if len(normals) == 1 else level
    second = _weighed(*shares, more)
    first = _weighed(*shares, (more[2], more[0])) - old * second
    ratio = ratio + start * (1 - ratio)
    lean = first * (1 + ratio) / (step * second - first * (1 - ratio))
    return dr.select((step > SHORT) & (old > -1 / SHORT), dr.minimum(_positive(middle * lean), 1), middle)


def _colours(kinds, shown, light, place, n, spot):
    # Radiance of the triangle before crossing ``n``, at a share of the way over it; see `lanes_light.tint`
    Float, Int32, *_ = kinds
    at, out = [place + dr.gather(Int32, shown.corners, 4 * n + k) for k in range(4)], []
    weights = [dr.gather(Float, shown.weight, n + side) for side in (0, 1)]
    for image in light:
        a, b, c, d = (dr.gather(Float, image, p) for p in at)
        a, c = dr.fma(weights[0], b - a, a), dr.fma(weights[1], d - c, c)
        out.append(dr.fma(spot, c - a, a))
    return out


def _shone(kinds, r, shown, light, normals, place, n, before, best, rise, old, sums):
    # What a newly seen piece adds
    moments = _moments(rise)
    more = [a - b for a, b in zip(moments, old, strict=True)]
    now, last = (dr.gather(kinds.Float, r.scale, k) for k in (n, dr.maximum(n - 1, 0)))
    step, under = rise - best, _positive(best - before) * now
    start = under / (under + step * last + TINY)
    share = _middle(kinds, normals, start, dr.gather(kinds.Float, shown.bend, n), now / last, best, step, more)
    colours = _colours(kinds, shown, light, place, n, dr.fma(1 - start, share, start))
    gains = [_above(q, rise, moments) - _above(q, best, old) for q in normals]
    return [dr.fma(c, g, s) for (c, g), s in zip(((c, g) for c in colours for g in gains), sums, strict=True)], moments


def _worth(kinds, r, normals, mine, best, k, top, slack):
    # Whether a surface up to ``top`` may add more than ``slack`` from column ``k`` on; see `lanes_light.worth`
    rise = (top - mine) * dr.gather(kinds.Float, r.inverse, k) - dr.gather(kinds.Float, r.fall, k)
    worth = []
    for n in normals:
        seen = dr.maximum(best, n.least)
        after, before = (_weighed(n.up, n.along, _moments(t)) for t in (dr.maximum(rise, seen), seen))
        worth.append(after - before > slack)
    return functools.reduce(operator.or_, worth)


@dr.syntax
def _gather(kinds, r: Rays, shown, light, lane, pitch, edge, leave, own, horizon, normals, facets, toward, stop):
    Float, Int32, UInt32, _ = kinds
    x = lane // pitch
    i = lane - x * pitch
    mine, best, place = dr.gather(Float, own, lane), dr.gather(Float, horizon, lane), x * r.stride + i
    on = best < dr.inf
    last = dr.select(on, dr.minimum(edge - x, dr.gather(Int32, leave, i, on)), 0)
    if dr.hint(facets is None, mode="scalar"):
        normals = _faces(lane, normals, *toward)
        best = dr.maximum(best, normals[0].least)
    else:
        normals = _facets(kinds, r.heights, place, x, edge, facets, toward)
    old, sums = _moments(best), [Float(0 * lane) for _ in range(len(light) * len(normals))]
    k, level, looked = Int32(0 * lane), Int32(0 * lane), UInt32(0 * lane)
    while dr.hint(k < last, mode="symbolic"):
        sees, end = may_see(kinds, r, i, x, k, level, last, mine, best)
        look = sees & (level == 0)
        if dr.hint(stop is not None, mode="scalar"):
            enough = look & (k > 0) & ~_worth(kinds, r, normals, mine, best, k, *stop)
            last = dr.select(enough, k, last)
            look = look & ~enough
        n = dr.gather(Int32, r.upto, k)
        to = dr.select(look, dr.gather(Int32, r.upto, end), n)
        looked += UInt32(to - n) + 1
        before = tangent(kinds, r, place, mine, dr.maximum(n - 1, 0), look)
        while dr.hint(n < to, mode="symbolic"):
            rise = tangent(kinds, r, place, mine, n)
            if dr.hint(rise > best, mode="symbolic"):
                sums, old = _shone(kinds, r, shown, light, normals, place, n, before, best, rise, old, sums)
                best = Float(rise)
            before = Float(rise)
            n += 1
        onward = look | ~sees
        k = dr.select(onward, end, k)
        level = dr.select(onward, longest(x + k), level - 1)
    return best, sums, looked


class Receivers(NamedTuple):
    """Receivers that lie alike in their cells, in a backend's memory (see `passes.Receivers`).

    Attributes
    ----------
    heights : Float
        (n, pitch), flat.
    pitch : int
    normals : list of Float or None
        Three components, of receivers that have one normal each.
    facets : (Int32, Int32, Float, Float) or None
        Of those that stand for triangles: edges and columns as `gather.edges_of` returns them, inverse lengths.
    """

    heights: object
    pitch: int
    normals: list | None
    facets: tuple | None


def put(laid: Laid, heights, normals, facets: Facets) -> Receivers:
    """Copy receivers to the backend of a laid field; parameters as `passes.Receivers` has them."""
    own, *up = copied(laid.backend, heights, *(() if normals is None else normals))
    if normals is not None:
        return Receivers(own, heights.shape[1], up, None)
    _, columns, stride = laid.shape
    edges, beside = gather.edges_of(facets.edges, columns * stride, stride)
    lengths = float(facets.per_east), float(facets.per_south)
    return Receivers(own, heights.shape[1], None, tuple(copied(laid.backend, edges, beside, *lengths)))


def surface(laid: Laid, light: list, to: Receivers, toward, way: skip.Way, shown: gather.Shown, slack: float, horizon):
    """What the surface sends along one direction's rays; see `gather.surface`.

    Parameters
    ----------
    laid : Laid
    light : list of Float
        Radiance of the channels.
    to : Receivers
    toward, way, shown, slack
        As `gather.surface` has them; ``way`` as `device.steepest`.
    horizon : Float
        −∞, or ∞ for what is no receiver.

    Returns
    -------
    horizon : Float
        Afterwards.
    sums : list of Float
        By channel and normal.
    looked : UInt64
        Crossings looked at and tests of stretches, over all receivers.
    """
    kinds = types(laid.backend)
    shown = gather.Shown(*copied(laid.backend, *shown))
    numbers = copied(laid.backend, to.pitch, laid.shape[1] - 1, last_columns(way, laid))
    toward, lane = copied(laid.backend, *map(float, toward)), dr.arange(kinds.Int32, dr.width(horizon))
    stop = (dr.max(laid.heights), *copied(laid.backend, float(slack))) if slack > 0 else None
    with interrupts():
        found = rays(laid, way), shown, light, lane, *numbers, to.heights, horizon, to.normals, to.facets, toward, stop
        horizon, sums, looked = _gather(kinds, *found)
        looked = kinds.UInt64(looked)
        dr.eval(horizon, sums, looked)
    return horizon, sums, dr.sum(looked)


# --- The sky ----------------------------------------------------------------------------------------------------------


def sky(laid: Laid, to: Receivers, toward, table, horizon) -> list:
    """What receivers gain from a sector of the sky a radian wide, by channel and normal; see `skylight.add_sky`.

    ``table`` is one of `skylight.sky_table`.
    """
    kinds, (_, nodes, channels) = types(laid.backend), table.shape
    pitch, stride, edge, east, north = copied(laid.backend, to.pitch, laid.shape[2], laid.shape[1] - 1, *map(float, toward))
    lane, table = dr.arange(kinds.Int32, dr.width(horizon)), copied(laid.backend, table)[0]
    x = lane // pitch
    if to.facets is None:
        normals = _faces(lane, to.normals, east, north)
    else:
        normals = _facets(kinds, laid.heights, x * stride + lane - x * pitch, x, edge, to.facets, (east, north))
    gains = [_open(kinds, n, dr.maximum(horizon, n.least), table, nodes, channels) for n in normals]
    return [_positive(g[c]) for c in range(channels) for g in gains]


def _open(kinds, n, t, table, nodes, channels):
    # What a normal gains above tangents ``t``, by channel, before it is known to be more than nothing
    Float, Int32, *_ = kinds
    if nodes == 1:
        # W from there to the zenith, where its moments are ½ and π/4
        left = [a - b for a, b in zip((0.5, 0.5 * QUARTER), _moments(t), strict=False)]
        return [_weighed(n.up, n.along, left) * dr.gather(Float, table, Int32(c)) for c in range(channels)]
    at = dr.clip(dr.fma(dr.atan(t), (NODES - 1) / np.pi, (NODES - 1) / 2), 0, NODES - 1)
    k = dr.minimum(Int32(at), NODES - 2)
    f, out = at - Float(k), []
    for c in range(channels):
        parts = []
        for first in (0, nodes * channels):
            a, b = (dr.gather(Float, table, (k + further) * channels + c + first) for further in (0, 1))
            parts.append(dr.fma(f, b - a, a))
        out.append(_weighed(n.up, n.along, parts))
    return out
