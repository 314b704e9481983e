"""Non-local means on both halves of an image (`consistent`), row by row: what vector units are fed with is contiguous.

Dr.Jit could only gather it, neighbour by neighbour. Each function goes over one row, and LLVM makes vectors of that.
"""

from __future__ import annotations

import drjit as dr
import numba as nb
import numpy as np

RADIUS = 2  # share within 5×5 pixels
PATCH = 3  # that agree over 7×7 pixels
TOLERANCE = 0.7  # of what noise explains
TURN = 0.95  # least cosine between the normals of one surface
SLOPE = 0.2  # most that a step along it leaves its tangent plane, as a share of the step
ROWS = 24  # of a stripe, which stays in the cache
EDGE = RADIUS + PATCH  # of pixels looked at around it
SLACK = 64  # floats behind an array that Dr.Jit borrows: its kernels read whole packets

# Planes of a field: normals and points; of each half its light, without shadows too, and their ratios; noise; whether known
NORMAL, POINT, LIGHT, RATIO, NOISE, KNOWN = 0, 3, 6, 18, 24, 25
PLANES = 26
GIVEN = 6  # planes a half

# Called by compiled code alone
_compiled = nb.njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


def share(frame, normal, point, halves, ratios, noise, known):
    """Return sums of both halves over pixels whose surroundings agree in the other half.

    Light with shadows and without is added up apart: the ratio of the sums is that of one large pixel. A mean of ratios would
    give dark pixels, whose ratios say least, as much weight as bright ones.

    Parameters
    ----------
    frame : Frame
    normal, point : mi.Vector3f, mi.Point3f
        Of the surface in each pixel.
    halves : pair of pairs of mi.Color3f
        Of both halves of the samples: light, and what it would be without shadows.
    ratios : pair of mi.Color3f
        Of the two.
    noise : mi.Float
        Variance of a half's ratios, added up over the channels.
    known : mi.Bool
        Pixels that take part.

    Returns
    -------
    pair of pairs of mi.Color3f
        Sums of ``halves``.
    """
    given = [channel for half in halves for colour in half for channel in colour]
    planes = [*normal, *point, *given, *ratios[0], *ratios[1], noise, dr.select(known, type(noise)(1), 0)]
    dr.eval(planes)
    planes = tuple(np.ascontiguousarray(plane.numpy()) for plane in planes)
    count = len(given)
    flat = np.empty(count * frame.pixels + SLACK, np.float32)
    out = flat[: count * frame.pixels].reshape(count, frame.height, frame.width)
    # Dr.Jit's workers have nothing to do now, but spin for some milliseconds on the CPUs that ours run on
    workers = dr.thread_count()
    dr.set_thread_count(1)
    try:
        _share(planes, out, nb.get_num_threads())
    finally:
        dr.set_thread_count(workers)
    sums = [type(halves[0][0])([type(noise)(plane.ravel()) for plane in out[k : k + 3]]) for k in range(0, count, 3)]
    return sums[:2], sums[2:]


@_compiled
def _turned(nx, ny, nz, ox, oy, oz, out):
    # Nought where normals differ
    for i in range(len(out)):
        out[i] = np.float32(1 if nx[i] * ox[i] + ny[i] * oy[i] + nz[i] * oz[i] > np.float32(TURN) else 0)


@_compiled
def _step(n, p, q, along, length):
    # One coordinate of the step to another point, added to its part along the normal and to its squared length
    for i in range(len(n)):
        d = q[i] - p[i]
        along[i] += n[i] * d
        length[i] += d * d


@_compiled
def _flat(along, length, known, other, out):
    # Nought where the step leaves the tangent plane, or a pixel is not known
    for i in range(len(out)):
        stays = along[i] * along[i] < np.float32(SLOPE * SLOPE) * length[i]
        out[i] = out[i] * known[i] * other[i] if stays else np.float32(0)


@_compiled
def _explained(noise, other, out):
    # What noise explains of a squared difference
    for i in range(len(out)):
        out[i] = noise[i] + other[i]


@_compiled
def _unit(noise, same, out):
    # One over that, with the tolerance
    for i in range(len(out)):
        out[i] = same[i] / (np.float32(TOLERANCE) * noise[i] + np.float32(1e-7))


@_compiled
def _differ(x, y, out):
    # Add the squared difference
    for i in range(len(out)):
        d = x[i] - y[i]
        out[i] += d * d


@_compiled
def _differ_last(x, y, noise, scale, out):
    # The same, and what of it is beyond what noise explains, in units of that
    for i in range(len(out)):
        d = x[i] - y[i]
        out[i] = (out[i] + d * d - noise[i]) * scale[i]


@_compiled
def _across(a, out):
    # Sums of seven beside each other
    for i in range(len(out)):
        out[i] = ((a[i] + a[i + 1]) + (a[i + 2] + a[i + 3])) + ((a[i + 4] + a[i + 5]) + a[i + 6])


@_compiled
def _down(a, b, c, d, e, f, g, out):
    # Sums of seven below each other
    for i in range(len(out)):
        out[i] = ((a[i] + b[i]) + (c[i] + d[i])) + ((e[i] + f[i]) + g[i])


@_compiled
def _weigh(value, count, same, out):
    # exp(-x) as (1 + x/16)^-16, which needs no call
    for i in range(len(out)):
        n, v = max(count[i], np.float32(1)), value[i]
        x = n / (n + (v if v > 0 else np.float32(0)) * np.float32(1 / 16))
        x *= x
        x *= x
        x *= x
        out[i] = same[i] * (x * x)


@_compiled
def _gather(a, b, c, d, e, values, out):
    # Add what five pixels beside each other give
    for i in range(len(out)):
        sides = (a[i] * values[i] + b[i] * values[i + 1]) + (d[i] * values[i + 3] + e[i] * values[i + 4])
        out[i] += sides + c[i] * values[i + 2]


@_compiled
def _compare(field, y, begin, end, u, v, scratch, sums, same):
    # How the pixels of a row differ from those u to the right and v below, summed across their patches
    a, b, c, d, z = begin, end, begin + u, end + u, y + v
    along, length, value = scratch
    _turned(field[0, y, a:b], field[1, y, a:b], field[2, y, a:b], field[0, z, c:d], field[1, z, c:d], field[2, z, c:d], same)
    along[:] = 0
    length[:] = 0
    for k in range(3):
        _step(field[NORMAL + k, y, a:b], field[POINT + k, y, a:b], field[POINT + k, z, c:d], along, length)
    _flat(along, length, field[KNOWN, y, a:b], field[KNOWN, z, c:d], same)
    noise, scale = along, length
    _explained(field[NOISE, y, a:b], field[NOISE, z, c:d], noise)
    _unit(noise, same, scale)
    for half in range(2):
        k = RATIO + 3 * half
        value[:] = 0
        _differ(field[k, y, a:b], field[k, z, c:d], value)
        _differ(field[k + 1, y, a:b], field[k + 1, z, c:d], value)
        _differ_last(field[k + 2, y, a:b], field[k + 2, z, c:d], noise, scale, value)
        _across(value, sums[half, y])
    _across(same, sums[2, y])


@_compiled
def _exchange(field, w, half, y, v, rows, total):
    # A row and that v below give each other what they have, by the row's weights of those to its left and right
    n, r, left = total.shape[2], y - EDGE, EDGE - RADIUS
    for k in range(GIVEN * half, GIVEN * (half + 1)):
        here, there = field[LIGHT + k, y, left:], field[LIGHT + k, y + v, left:]
        if r >= 0:
            _gather(w[0, 2 : 2 + n], w[1, 2 : 2 + n], w[2, 2 : 2 + n], w[3, 2 : 2 + n], w[4, 2 : 2 + n], there, total[k, r])
        if r + v < rows:
            _gather(w[4, :n], w[3, 1 : 1 + n], w[2, 2 : 2 + n], w[1, 3 : 3 + n], w[0, 4 : 4 + n], here, total[k, r + v])


@_compiled
def _copy(values, out):
    for i in range(len(out)):
        out[i] = values[i]


@_compiled
def _stripes(planes, begin, step, out):
    # Rows `begin` on, and those `step` further down, and so on
    height, width = out.shape[1:]
    wide = width + 2 * PATCH
    field = np.zeros((PLANES, ROWS + 2 * EDGE, width + 2 * EDGE), np.float32)
    same, sums = np.empty((ROWS + 2 * EDGE, wide), np.float32), np.empty((3, ROWS + 2 * EDGE, width), np.float32)
    scratch = np.empty(wide, np.float32), np.empty(wide, np.float32), np.empty(wide, np.float32)
    near = np.empty((3, width), np.float32)
    # Of both halves each row's weights by the step to the right, with margins that stay nought
    w = np.zeros((2, ROWS + RADIUS, 2 * RADIUS + 1, width + 2 * RADIUS), np.float32)
    total = np.empty((2 * GIVEN, ROWS, width), np.float32)
    for first in range(begin, height, step):
        rows = min(ROWS, height - first)
        for k, plane in enumerate(planes):
            for r in range(rows + 2 * EDGE):
                y = first + r - EDGE
                if 0 <= y < height:
                    _copy(plane[y * width : (y + 1) * width], field[k, r, EDGE : EDGE + width])
                else:
                    field[k, r] = 0
        # First what is the pixels' own
        for k in range(2 * GIVEN):
            for r in range(rows):
                _copy(field[LIGHT + k, r + EDGE, EDGE : EDGE + width], total[k, r])
        # Within a row pairs are met once, from the left
        w[:, :, : RADIUS + 1] = 0
        for v in range(RADIUS + 1):
            for u in range(-RADIUS if v else 1, RADIUS + 1):
                for y in range(RADIUS - v, rows + EDGE + PATCH):
                    _compare(field, y, RADIUS, RADIUS + wide, u, v, scratch, sums, same[y])
                for y in range(EDGE - v, rows + EDGE):
                    for j in range(3):
                        s = sums[j]
                        _down(s[y - 3], s[y - 2], s[y - 1], s[y], s[y + 1], s[y + 2], s[y + 3], near[j])
                    for half in range(2):
                        # Each half is weighted by the other
                        out_w = w[half, y - EDGE + RADIUS, RADIUS + u, RADIUS : RADIUS + width]
                        _weigh(near[1 - half], near[2], same[y, PATCH : PATCH + width], out_w)
            for y in range(EDGE - v, rows + EDGE):
                for half in range(2):
                    _exchange(field, w[half, y - EDGE + RADIUS], half, y, v, rows, total)
        for k in range(2 * GIVEN):
            for r in range(rows):
                _copy(total[k, r], out[k, first + r])


@nb.njit(cache=True, parallel=True)
def _share(planes, out, threads):
    for k in nb.prange(threads):
        _stripes(planes, k * ROWS, threads * ROWS, out)
