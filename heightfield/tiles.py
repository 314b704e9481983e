"""Fields larger than memory: overlapping tiles, each a `HeightField` that sees as far as its halo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import InputError
from .check import FARTHEST, grid, known, number, spacing_of
from .field import HeightField


def tiles(heights, spacing=1.0, *, radius: float, size: int = 2048, bounces: int = 0, **options) -> Iterator[tuple]:
    """Cut a height map into tiles with a halo.

    Whatever is computed on a tile within its window equals what the whole field with the same ``radius`` gives there, but for
    rounding: nothing farther than ``radius`` is looked at. Two things are a tile's own: unknown points take the nearest known
    height of their tile, and tiles that know no height are left out.

    Parameters
    ----------
    heights : (rows, columns) array
        Read a tile at a time: a ``np.memmap`` never has to fit in memory.
    spacing : float or (float, float)
        As for `HeightField`.
    radius : float
        Metres that a point looks; the halo's width.
    size : int
        Rows and columns of a tile without its halo.
    bounces : int
        Reflections on light's way to a receiver: it comes from as many times ``radius`` farther away, so the halo is wider.
    **options
        As for `HeightField`.

    Yields
    ------
    window : (slice, slice)
        Rows and columns of the tile in the whole field.
    field : HeightField
        The tile with its halo.
    inner : (slice, slice)
        Rows and columns of the tile in ``field``.

    Raises
    ------
    InputError
        If a parameter cannot be used.

    Examples
    --------
    >>> for window, field, inner in tiles(np.memmap("big.dem", "f4", shape=(60000, 60000)), 30.0, radius=20e3):
    ...     out[window] = field.sky_view(72)[inner]
    """
    dy, dx = spacing_of(spacing)
    radius, size = number("radius", radius, 0.0, FARTHEST, open_low=True), int(number("size", size, 1, whole=True))
    if not hasattr(heights, "shape"):
        heights = grid("heights", heights)
    bounces, shape = int(number("bounces", bounces, 0, 1000, whole=True)), heights.shape
    if len(shape) != 2 or 0 in shape:
        raise InputError(f"'heights' must be a two-dimensional array of rows and columns (got shape {shape})")
    # One sample more than the radius: rays cross cells, and normals take differences
    halo, some = [(int(min(np.ceil(radius / step), max(shape))) + 2) * (bounces + 1) for step in (dy, dx)], False
    for top in range(0, shape[0], size):
        for left in range(0, shape[1], size):
            window, outer, inner = [], [], []
            for start, length, extra in zip((top, left), shape, halo, strict=True):
                stop = min(start + size, length)
                first = max(start - extra, 0)
                window.append(slice(start, stop))
                outer.append(slice(first, min(stop + extra, length)))
                inner.append(slice(start - first, stop - first))
            piece = grid("heights", heights[tuple(outer)])
            if known(piece, options.get("nodata")).any():
                some = True
                yield tuple(window), HeightField(piece, (dy, dx), radius=radius, **options), tuple(inner)
    if not some:
        raise InputError("'heights' must have at least one known height (got none: all are nodata or not finite)")
