"""Moments of light over tangents of elevation, sixteen receivers side by side, as LLVM vectors (see `lanes`).

What a receiver gains between two tangents is a difference of W (see `gather`). With c = 1 / (1 + t²) that is n_z S + a B,
where S = ½ t² c and B = ½ (atan t + t c).
"""

from __future__ import annotations

from llvmlite import ir

from .lanes import _F32, LANES
from .lanes_skip import FUSED

STEEPEST = 1e12

# Minimax polynomial of the arc tangent over [0, 1], absolute error 2e-6
ARC = (-0.01172120, 0.05265332, -0.11643287, 0.19354346, -0.33262347, 0.99997726)
QUARTER = 1.5707963


def constant(value):
    """Return the same number in all lanes."""
    return ir.Constant(_F32, [value] * LANES)


def bounded(builder, t):
    """Return the magnitude of tangents, up to `STEEPEST`, and where they are negative."""
    below = builder.fcmp_ordered("<", t, constant(0.0))
    magnitude = builder.select(below, builder.fneg(t), t)
    most = constant(STEEPEST)
    return builder.select(builder.fcmp_ordered("<", magnitude, most), magnitude, most), below


def angle_of(builder, magnitude, inverse, below):
    """Return the arc tangent of `bounded` tangents; ``inverse`` is that of magnitudes above 1."""
    steep = builder.fcmp_ordered(">", magnitude, constant(1.0))
    z = builder.select(steep, inverse, magnitude)
    q = builder.fmul(z, z)
    e = constant(ARC[0])
    for coefficient in ARC[1:]:
        e = builder.fadd(builder.fmul(e, q, flags=FUSED), constant(coefficient), flags=FUSED)
    e = builder.fmul(e, z)
    e = builder.select(steep, builder.fsub(constant(QUARTER), e), e)
    return builder.select(below, builder.fneg(e), e)


def moments_of(builder, t):
    """Return S, B and ½ (atan t − t c): with the tangent they grow as t c², c² and t² c²."""
    half, one = constant(0.5), constant(1.0)
    magnitude, below = bounded(builder, t)
    square = builder.fmul(magnitude, magnitude)
    whole = builder.fadd(one, square)
    # One division for both 1 / t and c
    large = builder.select(builder.fcmp_ordered(">", magnitude, one), magnitude, one)
    both = builder.fdiv(one, builder.fmul(large, whole))
    c = builder.fmul(half, builder.fmul(both, large))
    e = angle_of(builder, magnitude, builder.fmul(both, whole), below)
    tc = builder.fmul(magnitude, c)
    tc = builder.select(below, builder.fneg(tc), tc)
    angle = builder.fmul(half, e)
    return builder.fmul(square, c), builder.fadd(angle, tc), builder.fsub(angle, tc)


def weighed(builder, nz, a, moments):
    """Return W, from S and B."""
    return builder.fadd(builder.fmul(nz, moments[0], flags=FUSED), builder.fmul(a, moments[1]), flags=FUSED)
