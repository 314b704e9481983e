"""Glints: what shiny things show of lamps in a part of a pixel, or now and then. Looks miss it; mirror directions tell.

Within a pixel a surface mirrors a range of directions: its normal turns, and it is seen from elsewhere. If a lamp lies in
that range, part of the pixel shows its highlight: as large a part as the lamp, widened by the surface's lobe, is of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .cells import neighbors
from .lights import importance

REACH = 0.75  # share of what normals turn in a pixel that they may be off from the one that was hit
SHARP = 1e8  # density of the lobe of a mirror, 1/sr
GLASS = 0.04  # share that glass mirrors, at least


@dataclass
class Shine:
    """How surfaces mirror, at one hit a pixel."""

    point: object  # mi.Point3f
    normal: object  # mi.Vector3f, towards the camera; zero on a miss
    lobe: object  # mi.Float, density of a direction sampled from the lobe, 1/sr; 0 where nothing is mirrored
    strength: object  # mi.Float, share of the light that is
    matt: object  # mi.Bool, whether it reflects diffusely as well


def glints(shading, frame, shine: Shine):
    """Tell of what looks may miss on shiny things.

    Parameters
    ----------
    shading : Shading
    frame : Frame
    shine : Shine

    Returns
    -------
    mean, variance : mi.Float
        Of the luminances of highlights from one hit to another of a pixel, were nothing in the way.
    chance : mi.Float
        Of a surface not to mirror, where it does so at random: glass.
    """
    w, h = (dr.opaque(mi.Int32, n) for n in (frame.width, frame.height))
    index = dr.arange(mi.UInt32, frame.pixels)
    x, y = mi.Int32(index) % w, mi.Int32(index) // w

    def beside(dx, dy):
        inside = (x + dx >= 0) & (x + dx < w) & (y + dy >= 0) & (y + dy < h)
        return mi.UInt32((y + dy) * w + x + dx), inside

    def turn(*steps):
        # How much the normal turns in a pixel along an axis: outlines are no bends, so the side where it is less
        turns = []
        for step in steps:
            at, inside = beside(*step)
            turns.append(dr.select(inside, dr.norm(dr.gather(mi.Vector3f, shine.normal, at) - shine.normal), dr.inf))
        least = dr.minimum(*turns)
        return dr.select(dr.isfinite(least), least, 0)

    # Lobes are sampled, and those of several layers are met by chance
    lobe, strength = shine.lobe, shine.strength
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            at, inside = beside(dx, dy)
            lobe = dr.maximum(lobe, dr.gather(mi.Float, shine.lobe, at, inside))
            strength = dr.maximum(strength, dr.gather(mi.Float, shine.strength, at, inside))
    across, down = turn((-1, 0), (1, 0)), turn((0, -1), (0, 1))
    middle = frame.corner(index) + 0.5
    ray, next_ray = frame.ray(middle)[0], frame.ray(middle + mi.Vector2f(1, 0))[0]
    # How far from each other, at the hit, pixels' rays are, and how much their directions differ
    distance = dr.norm(shine.point - ray.o)
    swing = next_ray.d - ray.d
    step = dr.norm(next_ray.o - ray.o + distance * swing)
    mean, variance = _sum(shading.lights, shine, -ray.d, lobe, strength, across, down, step, dr.norm(swing))
    # Looks that missed small things say nothing of the rest of their pixels
    most = [mean, variance]
    for values, _ in neighbors([mean, variance], frame.width, frame.height):
        most = [dr.maximum(m, v) for m, v in zip(most, values, strict=True)]
    missed = shine.lobe == 0
    mean, variance = (dr.select(missed, m, v) for m, v in zip(most, (mean, variance), strict=True))
    return mean, variance, dr.select(lobe >= SHARP, 1 - dr.clip(strength, GLASS, 1), 0)


@dr.syntax
def _sum(lights, shine, wi, lobe, strength, across, down, step, swing):
    # Over the lights, or the clusters of them that are compared jointly
    p, n = shine.point, shine.normal
    mean, variance = mi.Float(0), mi.Float(0)
    k, count = mi.UInt32(0), dr.opaque(mi.UInt32, lights.tops)
    # Glass chooses at random whether it mirrors
    chosen = dr.select(lobe >= SHARP, dr.rcp(dr.clip(strength, GLASS, 1)) - 1, 0)
    slant = 2 * dr.maximum(dr.dot(wi, n), 0.1)
    while (lobe > 0) & (dr.squared_norm(n) > 0) & (k < count):
        ball, facing, cone = (dr.gather(mi.Vector4f, lights.nodes, 3 * k + j) for j in range(3))
        d, r = mi.Vector3f(ball.x, ball.y, ball.z) - p, dr.maximum(ball.w, 0)
        # A sphere is smaller than the one around its box
        r *= dr.select((facing.w == 0) & (cone.y >= 1), 3**-0.5, 1)
        d2 = dr.squared_norm(d) + r * r
        # Solid angle and width of a highlight among mirrored directions, which turn twice as fast as normals
        spot = dr.rcp(lobe) + dr.pi * r * r / d2
        width = dr.sqrt(spot)
        off = dr.norm(dr.normalize(wi + dr.normalize(d)) - n)
        # From pixel to pixel the normal turns that would mirror the lamp, and so does the one that is there
        flat = (swing + step * dr.rsqrt(d2)) / slant
        x, y = across + flat, down + flat
        # Mirrors do not show points
        near = (ball.w >= dr.select(lobe >= SHARP, 1e-30, 0)) & (off < REACH * (x + y) + 0.5 * width)
        s, t = 2 * x / width, 2 * y / width
        share = dr.rcp((1 + s) * (1 + t))
        # Of a surface that looks all ways a quarter is seen from any side
        seen = dr.select((r > 0) & (facing.w == 0), 0.25, 1)
        value = seen * strength * importance(lights, k, p, n, mi.Bool(False)) / spot
        # A highlight of several pixels is seen by all that look
        q = s * s + t * t
        part = share * q * q / ((12 + q) * (1 + q))
        mean += dr.select(near, value * share, 0)
        variance += dr.select(near, value * value * (part + chosen * share), 0)
        k += 1
    return mean, variance
