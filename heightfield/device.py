"""Rays on a GPU: every receiver is a thread that follows its own ray over the few crossings that matter.

The method is that of `skip`, with its tables: the same crossings, weights and stretches give the same horizons but for
rounding. There sixteen rays go together; here each steps over what it cannot see itself. Neighbouring threads are receivers
of neighbouring rows: they come to the columns' stretches together and read heights that lie side by side.

Written once in Dr.Jit: it runs on CUDA, and on LLVM for tests.
"""

from __future__ import annotations

import functools
import importlib
from typing import NamedTuple

import drjit as dr
import numpy as np

from ..errors import interrupts
from . import march, skip

FEWEST = 1 << 18  # points of a field: of fewer, a direction takes CPUs about as long as to tell a GPU of it
MOST = 1 << 28  # points of a field with its margins: 32 bits count the places of what its triangles send


class Types(NamedTuple):
    """Dr.Jit's arrays of one backend."""

    Float: type
    Int32: type
    UInt32: type
    UInt64: type


@functools.cache
def types(backend: str) -> Types:
    """Return the array types of a backend of Dr.Jit, "cuda" or "llvm"."""
    module = importlib.import_module(f"drjit.{backend}")
    return Types(*(getattr(module, name) for name in Types._fields))


def chosen(shape: tuple[int, int]) -> str | None:
    """Return the backend that should look at a field of a shape: "cuda" if there is one and the field is worth it."""
    rows, columns = (size + march.BLOCK for size in shape)
    worth = shape[0] * shape[1] >= FEWEST and rows * columns <= MOST
    return "cuda" if worth and dr.has_backend(dr.JitBackend.CUDA) else None


class Laid(NamedTuple):
    """A laid field (see `skip`) in a backend's memory.

    Attributes
    ----------
    heights : Float
        Flat.
    shape : (int, int, int)
        Planes, columns, rows + margin.
    backend : str
    """

    heights: object
    shape: tuple[int, int, int]
    backend: str


def put(laid: np.ndarray, backend: str) -> Laid:
    """Copy a laid field, (planes, columns, rows + margin) float32, to a backend."""
    return Laid(types(backend).Float(laid.ravel()), laid.shape, backend)


def copied(backend: str, *values) -> list:
    """Copy arrays to a backend, flat and in 32 bits, and numbers as what kernels do not depend on; None stays None."""
    Float, Int32, *_ = types(backend)
    out = []
    for v in values:
        kind, dtype = (Float, np.float32) if np.asarray(v).dtype.kind == "f" else (Int32, np.int32)
        if v is None:
            out.append(None)
        elif isinstance(v, np.ndarray):
            out.append(kind(np.ascontiguousarray(v, dtype=dtype).ravel()))
        else:
            out.append(dr.opaque(kind, v))
    return out


# --- Heights at most of stretches -------------------------------------------------------------------------------------


@dr.syntax
def _lowest_level(kinds, lane, heights, columns, stride, count, first, second, row, column, weight):
    # `skip._lowest_level`; a lane a stretch and row
    Float, Int32, *_ = kinds
    block = lane // stride
    i, c = lane - block * stride, block * skip.SIZES[0]
    place, n, top = c * stride + i, Int32(0 * lane), Float(0 * lane) + march.ABYSS
    while dr.hint(n < count, mode="symbolic"):
        on = (c + dr.gather(Int32, column, n) < columns) & (i + dr.gather(Int32, row, n) < stride)
        a = dr.gather(Float, heights, place + dr.gather(Int32, first, n), on)
        b = dr.gather(Float, heights, place + dr.gather(Int32, second, n), on)
        h = dr.fma(dr.gather(Float, weight, n), b - a, a)
        top = dr.select(on, dr.maximum(top, h), top)
        n += 1
    return top


@dr.syntax
def _next_level(kinds, lane, source, stride, blocks, ratio, down):
    # `skip._next_level`
    Float, Int32, *_ = kinds
    block = lane // stride
    i = lane - block * stride
    k, top = Int32(0 * lane), Float(0 * lane) + march.ABYSS
    while dr.hint(k < ratio, mode="symbolic"):
        below = block * ratio + k
        row = i + dr.gather(Int32, down, k)
        for further in (0, 1):
            on = (below < blocks) & (row + further < stride)
            top = dr.select(on, dr.maximum(top, dr.gather(Float, source, below * stride + row + further, on)), top)
        k += 1
    return top


def stretches(laid: Laid, d, s: int = 1):
    """Return the heights at most of all stretches along a direction, and where each size begins; as `skip.stretches`."""
    kinds, (_, columns, stride) = types(laid.backend), laid.shape
    swept = copied(laid.backend, *skip.swept(d, s, stride, columns * stride))
    wide, high, count = copied(laid.backend, columns, stride, dr.width(swept[0]))
    levels, blocks = [], [-(-columns // size) for size in skip.SIZES]
    for n, size in enumerate(skip.SIZES):
        lane = dr.arange(kinds.Int32, blocks[n] * stride)
        if n == 0:
            levels.append(_lowest_level(kinds, lane, laid.heights, wide, high, count, *swept))
        else:
            ratio = size // skip.SIZES[n - 1]
            down = np.floor(d.slope * skip.SIZES[n - 1] * np.arange(ratio) + march.NEARBY).astype(np.int32)
            more = copied(laid.backend, blocks[n - 1], ratio, down)
            levels.append(_next_level(kinds, lane, levels[-1], high, *more))
        dr.eval(levels[-1])
    return dr.concat(levels), np.cumsum([0, *blocks[:-1]]) * stride


# --- Rays -------------------------------------------------------------------------------------------------------------


class Rays(NamedTuple):
    """What a kernel knows of rays of one direction: `skip.Way` on a backend, and the field.

    Attributes
    ----------
    first, second, weight, scale, drop, upto, down, inverse, fall, tops, begins
        Of `skip.Way`.
    heights : Float
    stride : Int32
    """

    first: object
    second: object
    weight: object
    scale: object
    drop: object
    upto: object
    down: object
    inverse: object
    fall: object
    tops: object
    begins: object
    heights: object
    stride: object


def rays(laid: Laid, way: skip.Way) -> Rays:
    """Bring what rays meet to the backend of a laid field; ``way`` has its stretches already there."""
    arrays = way._replace(tops=None)
    found = copied(laid.backend, *arrays, laid.shape[2])
    return Rays(*found[:-1], laid.heights, found[-1])._replace(tops=way.tops)


def last_columns(way: skip.Way, laid: Laid) -> np.ndarray:
    """Return after how many columns rays from each row leave the field over its last row; see `skip.leaves`."""
    rows = laid.shape[2] - march.BLOCK
    found = np.searchsorted(way.down, rows - np.arange(laid.shape[2]))
    return np.minimum(found, len(way.down) - 2).astype(np.int32)


def tangent(kinds, r: Rays, place, own, n, active=True):
    """Tangent under which a receiver of a height, at a place in the laid field, sees crossing ``n``."""
    Float, Int32, *_ = kinds
    a, b = (dr.gather(Float, r.heights, place + dr.gather(Int32, ends, n, active), active) for ends in (r.first, r.second))
    h = dr.fma(dr.gather(Float, r.weight, n, active), b - a, a)
    scale = dr.gather(Float, r.scale, n, active)
    if r.drop is None:
        return (h - own) * scale
    return dr.fma(h - own, scale, -dr.gather(Float, r.drop, n, active))


def may_see(kinds, r: Rays, i, x, k, level, last, own, best):
    """Whether rays from rows ``i``, columns ``x``, may see a stretch, ``k`` columns on, above ``best``; and where it ends."""
    Float, Int32, *_ = kinds
    size = skip.SIZES[0] << 2 * level
    end = dr.minimum(((x + k) | (size - 1)) + 1 - x, last)
    row = i + dr.gather(Int32, r.down, k)
    at = dr.gather(Int32, r.begins, level) + ((x + k) >> (skip.SHIFTS[0] + 2 * level)) * r.stride + row
    # To the first whole stretch all is looked at
    over = dr.gather(Float, r.tops, at, k > 0) - own
    near, far = (over * dr.gather(Float, r.inverse, c) for c in (k, end))
    return (dr.maximum(near, far) - dr.gather(Float, r.fall, k) > best) | (k == 0), end


def longest(column):
    """Return the level of the longest stretch that begins at a column, a multiple of the shortest."""
    level = type(column)(0 * column)
    for size in skip.SIZES[1:]:
        level = dr.select(column & (size - 1) == 0, level + 1, level)
    return level


@dr.syntax
def _steepest(kinds, r: Rays, lane, pitch, edge, leave, own, out):
    # Tangents of the horizons, and what was looked at; a lane a receiver
    Float, Int32, UInt32, _ = kinds
    x = lane // pitch
    i = lane - x * pitch
    best, mine, place = dr.gather(Float, out, lane), dr.gather(Float, own, lane), x * r.stride + i
    on = best < dr.inf
    last = dr.select(on, dr.minimum(edge - x, dr.gather(Int32, leave, i, on)), 0)
    k, level, looked = Int32(0 * lane), Int32(0 * lane), UInt32(0 * lane)
    while dr.hint(k < last, mode="symbolic"):
        sees, end = may_see(kinds, r, i, x, k, level, last, mine, best)
        look = sees & (level == 0)
        n = dr.gather(Int32, r.upto, k)
        to = dr.select(look, dr.gather(Int32, r.upto, end), n)
        looked += UInt32(to - n) + 1
        while dr.hint(n < to, mode="symbolic"):
            best = dr.maximum(best, tangent(kinds, r, place, mine, n))
            n += 1
        onward = look | ~sees
        k = dr.select(onward, end, k)
        level = dr.select(onward, longest(x + k), level - 1)
    return best, looked


def steepest(laid: Laid, way: skip.Way, own, pitch: int, out):
    """Raise tangents of horizons to the steepest rise towards any crossing; as `skip.steepest`.

    Parameters
    ----------
    laid : Laid
    way : skip.Way
        Its ``tops`` as `stretches` returns them.
    own : Float
        Heights of the receivers, (n, pitch), flat.
    pitch : int
    out : Float
        Tangents of the horizons so far; infinite for what is no receiver.

    Returns
    -------
    horizons : Float
    looked : UInt64
        Crossings looked at and tests of stretches, over all receivers.
    """
    kinds = types(laid.backend)
    numbers = copied(laid.backend, pitch, laid.shape[1] - 1, last_columns(way, laid))
    with interrupts():
        best, looked = _steepest(kinds, rays(laid, way), dr.arange(kinds.Int32, dr.width(out)), *numbers, own, out)
        looked = kinds.UInt64(looked)
        dr.eval(best, looked)
    return best, dr.sum(looked)


def horizons(laid: Laid, d, curve: float = 0.0, reach: float | None = None, tally=None) -> np.ndarray:
    """Tangent of the horizon of every grid point; as `skip.horizons`."""
    (_, columns, stride), kinds = laid.shape, types(laid.backend)
    rows, ahead = stride - march.BLOCK, march.edges(d, columns - 1, reach)
    if not len(ahead[0]):
        return np.full((columns, rows), -np.inf, np.float32)
    row = dr.arange(kinds.Int32, columns * stride) % dr.opaque(kinds.Int32, stride)
    out = dr.select(row < dr.opaque(kinds.Int32, rows), kinds.Float(-dr.inf), dr.inf)
    way = skip.way(laid.shape, stretches(laid, d), d, curve, *ahead)
    best, looked = steepest(laid, way, laid.heights, stride, out)
    if tally is not None:
        tally.append(int(looked.numpy()[0]))
    return best.numpy().reshape(columns, stride)[:, :rows]
