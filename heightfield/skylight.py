"""The sky's light: what a sector of it adds above the horizons of receivers, analytically over elevation (§10.1)."""

from __future__ import annotations

import numba as nb
import numpy as np

from .gather import edges_of
from .lanes import LANES
from .lanes_light import EACH, UP, facet, open_sky, start
from .lanes_moments import STEEPEST
from .march import BLOCK
from .sweep import arctan

NODES = 2048  # of the sky's table over elevation


def sky_table(radiance) -> np.ndarray:
    """Tabulate what a sky column adds above an elevation.

    Parameters
    ----------
    radiance : (n, channels) array
        Radiance at ``n`` elevations, equally spaced from −π/2 to π/2.

    Returns
    -------
    (2, NODES, channels) float32 array
        Integrals of ``L sin e cos e`` and ``L cos² e`` from each node's elevation to the zenith. (2, 1, channels) if there is
        one elevation: the radiance, which is then that of all.
    """
    radiance = np.atleast_2d(np.asarray(radiance, dtype=np.float64))
    if len(radiance) == 1:
        return np.stack([radiance, radiance]).astype(np.float32)
    e = np.linspace(-np.pi / 2, np.pi / 2, NODES)
    given = np.linspace(-np.pi / 2, np.pi / 2, len(radiance))
    values = np.stack([np.interp(e, given, radiance[:, c]) for c in range(radiance.shape[1])], -1)
    # Each interval's weight in closed form, its radiance the mean of the ends
    mean = 0.5 * (values[1:] + values[:-1])
    primitive = np.stack([np.sin(e) ** 2 / 2, (e + np.sin(e) * np.cos(e)) / 2])
    pieces = np.diff(primitive, axis=1)[..., None] * mean
    out = np.zeros((2, NODES, radiance.shape[1]))
    out[:, :-1] = np.cumsum(pieces[:, ::-1], axis=1)[:, ::-1]
    return out.astype(np.float32)


@nb.njit(cache=True, error_model="numpy")
def _even_row(t, up, along, table, width, out):
    # Add a row of receivers' sky, alike above tangents ``t``, to (channels, m): the integrals of `sky_table` in closed form
    one, half, right = np.float32(1), np.float32(0.5), np.float32(np.pi / 2)
    for c in range(table.shape[2]):
        share = half * width * table[0, 0, c]
        for j in range(len(t)):
            a = min(t[j], np.float32(STEEPEST))
            s = one / (one + a * a)
            out[c, j] += share * max(up[j] * s + along[j] * (right - arctan(a) - a * s), np.float32(0))


@nb.njit(cache=True)
def _table_row(t, up, along, table, width, out):
    # Add a row of receivers' sky above tangents ``t`` to (channels, m)
    scale, middle = np.float32((NODES - 1) / np.pi), np.float32((NODES - 1) / 2)
    for j in range(len(t)):
        at = arctan(t[j]) * scale + middle
        k = np.uint32(min(max(at, np.float32(0)), np.float32(NODES - 2)))
        f = at - np.float32(k)
        for c in range(table.shape[2]):
            s = table[0, k, c] + f * (table[0, k + 1, c] - table[0, k, c])
            b = table[1, k, c] + f * (table[1, k + 1, c] - table[1, k, c])
            out[c, j] += width * max(up[j] * s + along[j] * b, np.float32(0))


@nb.njit(cache=True, error_model="numpy")
def _sky_row(horizon, up, along, table, width, t, out):
    # ``t`` is scratch: the sky begins above the horizon and above the receivers' own planes
    for j in range(len(t)):
        t[j] = max(horizon[j], -along[j] / up[j])
    if table.shape[1] == 1:
        _even_row(t, up, along, table, width, out)
    else:
        _table_row(t, up, along, table, width, out)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def add_sky(horizon, normals, toward, table, width, out):
    """Add the sky of a sector of ``width`` radians, above tangents ``horizon`` and the receivers' own planes.

    ``horizon`` is (n, m), ``normals`` (3, n, m), ``out`` (channels, n, m).
    """
    (rows, columns), (east, north), width = horizon.shape, toward, np.float32(width)
    for i in nb.prange(rows):
        x, y, up = normals[0, i], normals[1, i], normals[2, i]
        _sky_row(horizon[i], up, x * east + y * north, table, width, np.empty(columns, np.float32), out[:, i])


def add_sky_to_facets(laid, horizon, facets, toward, table, width, out):
    """Add the sky as `add_sky` does to what triangles that meet receivers get there.

    ``laid`` is the field and ``out`` (channels, f, n, m), as for `gather.surface`; m is a multiple of 16.
    """
    if table.shape[1] == 1:
        _even_to_facets(laid, horizon, facets, toward, np.float32(width) * table[0, 0], out)
    else:
        _table_to_facets(laid, horizon, facets, toward, table, np.float32(width), out)


@nb.njit(cache=True, parallel=True)
def _table_to_facets(laid, horizon, facets, toward, table, width, out):
    (edges, per_east, per_south), (east, north) = facets, toward
    columns, rows = laid.shape[1], laid.shape[2] - BLOCK
    for x in nb.prange(len(horizon)):
        t = np.empty(rows, np.float32)
        for q in range(len(edges)):
            planes, down, aside = edges[q, :, 0], edges[q, :, 1], edges[q, :, 2]
            if x + aside.min() >= 0 and x + aside.max() < columns:
                a, b = max(-down.min(), 0), rows - max(down.max(), 0)
                h = [laid[planes[k], x + aside[k], a + down[k] : b + down[k]] for k in range(4)]
                u, v = (h[1] - h[0]) * per_east, (h[3] - h[2]) * per_south
                up = np.float32(1) / np.sqrt(np.float32(1) + u * u + v * v)
                _sky_row(horizon[x, a:b], up, (v * north - u * east) * up, table, width, t[a:b], out[:, q, x, a:b])


@nb.njit(cache=True)
def _even_strip(heights, stride, edge, shares, east, north, per_east, per_south, edges, beside, horizon, out, pitch, i):
    # `_even_to_facets` for receivers in rows ``i`` to ``i + 15``
    facing, flat, size = len(beside), np.zeros_like(edges), len(horizon)
    work = np.zeros((UP + EACH * facing) * LANES, np.float32)
    for x in range(size // pitch):
        place, at = x * stride + i, x * pitch + i
        if horizon[at] == np.inf:
            continue
        start(work, horizon, horizon, at)
        for q in range(facing):
            # What lies beyond the border is no triangle: any will do
            there = x + beside[q, 0] >= 0 and x + beside[q, 1] <= edge
            facet(work, q, heights, place, edges if there else flat, east, north, per_east, per_south)
            for m in range(len(shares)):
                open_sky(work, q, shares[m], out, (m * facing + q) * size + at)


@nb.njit(cache=True, parallel=True)
def _even_to_facets(laid, horizon, facets, toward, shares, out):
    # ``shares``: radiance times the sector's width, by channel
    heights, seen, sums, strips = laid.ravel(), horizon.ravel(), out.ravel(), horizon.shape[1] // LANES
    (places, per_east, per_south), (east, north) = facets, toward
    edges, beside = edges_of(places, laid[0].size, laid.shape[2])
    for t in nb.prange(strips):
        _even_strip(
            *(heights, laid.shape[2], laid.shape[1] - 1, shares, east, north, per_east, per_south),
            *(edges, beside, seen, sums, horizon.shape[1], LANES * t),
        )
