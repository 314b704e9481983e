"""Owen-scrambled Sobol' points: each pixel gets its own randomisation, hits and light samples spread jointly."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def _laine_karras(x, seed):
    # Nested uniform scrambling of a bit-reversed integer (Laine and Karras 2011; constants of Vegdahl 2021)
    x = x + seed
    for c in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        x ^= x * mi.UInt32(c)
    return x


def _owen(x, seed):
    return dr.brev(_laine_karras(x, seed))


def _sobol_1(i):
    # Second Sobol' dimension of index i, bit-reversed: multiplication by the Pascal matrix over GF(2)
    for mask, shift in (
        (0xAAAAAAAA, 1),
        (0xCCCCCCCC, 2),
        (0xF0F0F0F0, 4),
        (0xFF00FF00, 8),
        (0xFFFF0000, 16),
    ):
        i = i ^ ((i & mi.UInt32(mask)) >> shift)
    return i


def _unit(x):
    return mi.Float(x >> 8) * mi.Float(2.0**-24)


def seeds(index, seed, count: int):
    """Hash a pixel index and a seed to ``count`` scrambling seeds.

    Parameters
    ----------
    index : mi.UInt32
        Pixel (or lane) index.
    seed : mi.UInt32
        Seed of the render.
    count : int
        How many 32-bit seeds to return.

    Returns
    -------
    list of mi.UInt32
    """
    out = []
    for salt in range((count + 1) // 2):
        out += list(mi.sample_tea_32(index, seed + mi.UInt32(0x9E3779B9) * mi.UInt32(salt), 4))
    return out[:count]


def net_1d(i, s):
    """Return point ``i`` of a scrambled van der Corput sequence in [0, 1)."""
    return _unit(_owen(i, s))


def net_2d(i, s0, s1):
    """Return point ``i`` of a scrambled (0, 2)-sequence in [0, 1)².

    Any aligned run of 2^m points is a (0, m, 2)-net: one point in every elementary interval of area 2^-m.
    """
    return mi.Point2f(_unit(_owen(i, s0)), _unit(_owen(_sobol_1(i), s1)))


def shuffle(i, s):
    """Return index ``i`` permuted within aligned power-of-two blocks (Burley 2020), to decorrelate two sequences."""
    return dr.brev(_laine_karras(dr.brev(i), s))
