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


def _directions(degree: int, polynomial: int, first: tuple) -> list[int]:
    # Bit-reversed direction numbers of a Sobol' dimension, from its row of Joe and Kuo's table (2008)
    m = list(first)
    for k in range(degree, INDEX_BITS):
        v = m[k - degree] ^ (m[k - degree] << degree)
        for j in range(1, degree):
            v ^= ((polynomial >> (degree - 1 - j)) & 1) * (m[k - j] << j)
        m.append(v)
    return [int(f"{v << (31 - k):032b}"[::-1], 2) for k, v in enumerate(m)]


INDEX_BITS = 16  # that the higher dimensions use; beyond them comes another randomisation
THIRD, FOURTH = _directions(2, 1, (1, 3)), _directions(3, 1, (1, 3, 1))


def _sobol_high(i, directions):
    # A higher Sobol' dimension of index i, bit-reversed
    x = mi.UInt32(0)
    for k, v in enumerate(directions):
        x ^= dr.select((i & mi.UInt32(1 << k)) != 0, mi.UInt32(v), mi.UInt32(0))
    return x


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


def net_high(i, s0, s1):
    """Return the third and fourth dimension of point ``i`` of a scrambled Sobol' sequence in [0, 1)².

    They are well spread together with `net_2d`, whether that has one point for each index or a power of two of them.
    """
    salt = (i >> INDEX_BITS) * mi.UInt32(0x9E3779B9)
    x, y = (_sobol_high(i, d) for d in (THIRD, FOURTH))
    return mi.Point2f(_unit(_owen(x, s0 + salt)), _unit(_owen(y, s1 + salt)))


def shuffle(i, s):
    """Return index ``i`` permuted within aligned power-of-two blocks (Burley 2020), to decorrelate two sequences."""
    return dr.brev(_laine_karras(dr.brev(i), s))
