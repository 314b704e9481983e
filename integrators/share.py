"""Non-local means on both halves of an image (`consistent`), row by row: what vector units are fed with is contiguous.

Dr.Jit could only gather it, neighbour by neighbour. Each function goes over one row, and LLVM makes vectors of that.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import drjit as dr
import numba as nb
import numpy as np

RADIUS = 2  # share within 5×5 pixels
PATCH = 3  # that agree over 7×7 pixels
TOLERANCE = 0.7  # of what noise explains
ROWS = 24  # of a stripe, shared together
EDGE = RADIUS + PATCH  # of pixels looked at around it
SLACK = 64  # floats behind an array that Dr.Jit borrows: its kernels read whole packets

# Planes of a field: normals and points; of each half its colour and luminance; noise; whether a pixel is known
NORMAL, POINT, COLOUR, LEVEL, NOISE, KNOWN = 0, 3, 6, 12, 14, 15
PLANES = 16


def share(frame, normal, point, halves, levels, noise, known):
    """Return means of both halves over pixels whose surroundings agree in the other half.

    Parameters
    ----------
    frame : Frame
    normal, point : mi.Vector3f, mi.Point3f
        Of the surface in each pixel.
    halves, levels : pairs of mi.Color3f, of mi.Float
        Values of both halves of the samples, and their luminances.
    noise : mi.Float
        Variance of a half's luminance.
    known : mi.Bool
        Pixels that take part.

    Returns
    -------
    list of 6 mi.Float
        Channels of the first half, then of the second.
    """
    height, width = frame.height, frame.width
    field = np.zeros((PLANES, height + 2 * EDGE, width + 2 * EDGE), np.float32)
    planes = [*normal, *point, *halves[0], *halves[1], *levels, noise, known]
    for plane, values in zip(field[:, EDGE:-EDGE, EDGE:-EDGE], planes, strict=True):
        plane[:] = values.numpy().reshape(height, width)
    flat = np.empty(6 * frame.pixels + SLACK, np.float32)
    out = flat[: 6 * frame.pixels].reshape(6, height, width)
    with ThreadPoolExecutor(max(dr.thread_count(), 1)) as pool:
        list(pool.map(lambda first: _stripe(field, first, out), range(0, height, ROWS)))
    return [type(noise)(plane.ravel()) for plane in out]


@nb.njit(cache=True, error_model="numpy")
def _turned(nx, ny, nz, ox, oy, oz, out):
    # Nought where normals differ by more than 18°
    for i in range(len(out)):
        out[i] = np.float32(1 if nx[i] * ox[i] + ny[i] * oy[i] + nz[i] * oz[i] > np.float32(0.95) else 0)


@nb.njit(cache=True, error_model="numpy")
def _step(n, p, q, along, length):
    # One coordinate of the step to another point, added to its part along the normal and to its squared length
    for i in range(len(n)):
        d = q[i] - p[i]
        along[i] += n[i] * d
        length[i] += d * d


@nb.njit(cache=True, error_model="numpy")
def _flat(along, length, known, other, out):
    # Nought where the step leaves the tangent plane, or a pixel is not known
    for i in range(len(out)):
        stays = along[i] * along[i] < np.float32(0.04) * length[i]
        out[i] = out[i] * known[i] * other[i] if stays else np.float32(0)


@nb.njit(cache=True, error_model="numpy")
def _differ(x, y, noise, more, same, out):
    # The squared difference beyond what noise explains, in units of that
    for i in range(len(out)):
        spread, d = noise[i] + more[i], x[i] - y[i]
        value = (d * d - spread) / (np.float32(TOLERANCE) * spread + np.float32(1e-7))
        out[i] = value if same[i] > 0 else np.float32(0)


@nb.njit(cache=True, error_model="numpy")
def _across(a, out):
    # Sums of seven beside each other
    for i in range(len(out)):
        out[i] = ((a[i] + a[i + 1]) + (a[i + 2] + a[i + 3])) + ((a[i + 4] + a[i + 5]) + a[i + 6])


@nb.njit(cache=True, error_model="numpy")
def _down(a, b, c, d, e, f, g, out):
    # Sums of seven below each other
    for i in range(len(out)):
        out[i] = ((a[i] + b[i]) + (c[i] + d[i])) + ((e[i] + f[i]) + g[i])


@nb.njit(cache=True, error_model="numpy")
def _weigh(value, count, same, out):
    # exp(-x) as (1 + x/16)^-16, which needs no call
    for i in range(len(out)):
        x = value[i] / max(count[i], np.float32(1))
        x = np.float32(1) + (x if x > 0 else np.float32(0)) * np.float32(1 / 16)
        x *= x
        x *= x
        x *= x
        out[i] = same[i] / (x * x)


@nb.njit(cache=True, error_model="numpy")
def _add(weight, values, out):
    for i in range(len(out)):
        out[i] += weight[i] * values[i]


@nb.njit(cache=True, error_model="numpy")
def _increase(weight, out):
    for i in range(len(out)):
        out[i] += weight[i]


@nb.njit(cache=True, error_model="numpy")
def _divide(values, weight, out):
    for i in range(len(out)):
        out[i] = values[i] / weight[i]


@nb.njit(cache=True, error_model="numpy")
def _compare(field, y, begin, end, u, v, space, same, row):
    # How the pixels of a row differ from those u to the right and v below, summed across their patches
    a, b, c, d, z = begin, end, begin + u, end + u, y + v
    along, length, value, sums = space
    _turned(field[0, y, a:b], field[1, y, a:b], field[2, y, a:b], field[0, z, c:d], field[1, z, c:d], field[2, z, c:d], same)
    along[:] = 0
    length[:] = 0
    for k in range(3):
        _step(field[NORMAL + k, y, a:b], field[POINT + k, y, a:b], field[POINT + k, z, c:d], along, length)
    _flat(along, length, field[KNOWN, y, a:b], field[KNOWN, z, c:d], same)
    for half in range(2):
        k = LEVEL + half
        _differ(field[k, y, a:b], field[k, z, c:d], field[NOISE, y, a:b], field[NOISE, z, c:d], same, value)
        _across(value, sums[half, row])
    _across(same, sums[2, row])


@nb.njit(cache=True, error_model="numpy")
def _give(field, w, half, y, x, total, row, column):
    # Give a row of a half's pixels, so weighted, to others
    n = len(w)
    for c in range(3):
        _add(w, field[COLOUR + 3 * half + c, y, x : x + n], total[4 * half + c, row, column : column + n])
    _increase(w, total[4 * half + 3, row, column : column + n])


@nb.njit(cache=True, error_model="numpy", nogil=True)
def _stripe(field, first, out):
    # All of rows `first` on
    height, width = out.shape[1:]
    rows, wide = min(ROWS, height - first), width + 2 * PATCH
    same, sums = np.empty((rows + 2 * EDGE, wide), np.float32), np.empty((3, rows + 2 * EDGE, width), np.float32)
    space = np.empty(wide, np.float32), np.empty(wide, np.float32), np.empty(wide, np.float32), sums
    near, w = np.empty((3, width), np.float32), np.empty(width, np.float32)
    # Colours and weight of each half: first the pixels' own
    total = np.zeros((8, rows, width + 2 * RADIUS), np.float32)
    w[:] = 1
    for half in range(2):
        for r in range(rows):
            _give(field, w, half, first + r + EDGE, EDGE, total, r, RADIUS)
    for v in range(RADIUS + 1):
        for u in range(-RADIUS if v else 1, RADIUS + 1):
            for r in range(-v - PATCH, rows + PATCH):
                k = r + EDGE
                _compare(field, first + k, RADIUS, RADIUS + wide, u, v, space, same[k], k)
            for r in range(-v, rows):
                k = r + EDGE
                y = first + k
                for j in range(3):
                    s = sums[j]
                    _down(s[k - 3], s[k - 2], s[k - 1], s[k], s[k + 1], s[k + 2], s[k + 3], near[j])
                for half in range(2):
                    # Each half is weighted by the other
                    _weigh(near[1 - half], near[2], same[k, PATCH : PATCH + width], w)
                    if r >= 0:
                        _give(field, w, half, y + v, EDGE + u, total, r, RADIUS)
                    if r + v < rows:
                        _give(field, w, half, y, EDGE, total, r + v, RADIUS + u)
    for half in range(2):
        for r in range(rows):
            for c in range(3):
                a, b = total[4 * half + c, r, RADIUS : RADIUS + width], total[4 * half + 3, r, RADIUS : RADIUS + width]
                _divide(a, b, out[3 * half + c, first + r])
