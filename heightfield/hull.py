"""Global horizons by hull stacks: near the receiver exactly, beyond by shared lines.

Only the highest horizon is wanted here, so one upper convex hull a line is enough (Timonen and Westerholm 2010; the paper's
§2 names it as its ancestor): samples are pushed from the far end of the line, the receiver's horizon is the tangent to the
hull. Lines are parallel, `lines` of them a row, and each grid point takes the nearest. A line misses its receivers by at
most half its spacing, which matters less the farther the occluder: the first `near` columns are therefore marched on the
receiver's own ray, where the error would be largest.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from . import march

NEAR = 8  # columns marched exactly
LINES = 2  # shared lines a row, beyond


@nb.njit(cache=True, inline="always")
def _push(x, h, bend, px, ph, n):
    # A parabola for the Earth's curvature: one for the whole line keeps the order of slopes at every receiver
    h -= bend * x * x
    # Samples come nearer and nearer: drop what the new one and the one below it overtop
    while n >= 2:
        a, b = n - 1, n - 2
        if (ph[a] - h) * (px[b] - x) > (ph[b] - h) * (px[a] - x):
            break
        n -= 1
    px[n], ph[n] = x, h
    return n + 1


@nb.njit(cache=True)
def _cell(heights, i, j, k, slope, bend, diagonal):
    # Steepest rise a column from grid point (i, j) to the crossings of its own ray in columns k (included) to k + 1
    rows, columns = heights.shape
    y = slope * k
    r = int(y)
    f = y - r
    r += i
    x = j + k
    if x >= columns or r >= rows:
        return -np.inf
    h = heights[i, j]
    best = -np.inf
    s = r + 1
    if f == 0.0:
        best = (heights[r, x] - h) / k - bend * k
    elif s < rows:
        best = (heights[r, x] + f * (heights[s, x] - heights[r, x]) - h) / k - bend * k
    if x + 1 < columns and s < rows:
        a, b = heights[s, x], heights[s, x + 1]
        if f + slope > 1.0:
            t = (1.0 - f) / slope
            best = max(best, (a + t * (b - a) - h) / (k + t) - bend * (k + t))
            if not diagonal and s + 1 < rows:
                t = (2.0 - f) / (1.0 + slope)
                if t < 1.0:
                    best = max(best, (heights[s + 1, x] + t * (b - heights[s + 1, x]) - h) / (k + t) - bend * (k + t))
        elif diagonal and slope < 1.0:
            t = f / (1.0 - slope)
            if 0.0 < t < 1.0:
                best = max(best, (heights[r, x] + t * (b - heights[r, x]) - h) / (k + t) - bend * (k + t))
        if not diagonal:
            t = (1.0 - f) / (1.0 + slope)
            if t < 1.0:
                best = max(best, (a + t * (heights[r, x + 1] - a) - h) / (k + t) - bend * (k + t))
    return best


@nb.njit(cache=True, parallel=True)
def _far(heights, slope, step, diagonal, bend, near, lines, out):
    rows, columns = heights.shape
    climb = slope * (columns - 1)
    first = -int(np.ceil(climb * lines)) - 1
    count = (rows - 1) * lines - first + 2
    half = 0.5 / lines
    # How much a horizon beyond `near` may differ, per row that the line misses its receiver by
    steepest = np.float32(0)
    for i in range(rows - 1):
        for j in range(columns):
            steepest = max(steepest, abs(heights[i + 1, j] - heights[i, j]))
    fall = steepest / near
    for m in nb.prange(count):
        b = (m + first) / lines
        # Columns over which the line lies on the field
        x0, x1 = 0, columns - 1
        if slope > 0:
            x0 = max(0, int(np.ceil((-half - b) / slope - 1e-9)))
            x1 = min(columns - 1, int(np.floor((rows - 1 - b) / slope + 1e-9)))
        elif b > rows - 1 + half or b < -half:
            x1 = -1
        if x1 < x0:
            continue
        px, ph = np.empty(3 * (x1 - x0) + 8, np.float64), np.empty(3 * (x1 - x0) + 8, np.float64)
        n = 0
        x = x1
        while x >= x0:
            y = b + slope * x
            # Far samples: the cells between columns x + near and x + near + 1, then the column edge at x + near
            c = x + near
            if c <= x1:
                # Receivers at the border may have their line half a spacing outside
                yc = min(max(b + slope * c, 0.0), rows - 1.0)
                if abs(yc - (b + slope * c)) <= half:
                    r = min(int(yc), rows - 1)
                    f = yc - r
                    if c < columns - 1:
                        f1 = f + slope
                        s = r + 1
                        if s < rows:
                            if not diagonal:
                                if f1 > 1 and s + 1 < rows:
                                    t = (2 - f) / (1 + slope)
                                    if t < 1:
                                        n = _push(
                                            c + t,
                                            heights[s + 1, c] + t * (heights[s, c + 1] - heights[s + 1, c]),
                                            bend,
                                            px,
                                            ph,
                                            n,
                                        )
                                if f1 > 1:
                                    t = (1 - f) / slope
                                    n = _push(c + t, heights[s, c] + t * (heights[s, c + 1] - heights[s, c]), bend, px, ph, n)
                                t = (1 - f) / (1 + slope)
                                if t < 1:
                                    n = _push(c + t, heights[s, c] + t * (heights[r, c + 1] - heights[s, c]), bend, px, ph, n)
                            elif f1 > 1:
                                t = (1 - f) / slope
                                n = _push(c + t, heights[s, c] + t * (heights[s, c + 1] - heights[s, c]), bend, px, ph, n)
                            elif f1 < 1 and f > 0:
                                t = f / (1 - slope)
                                n = _push(c + t, heights[r, c] + t * (heights[s, c + 1] - heights[r, c]), bend, px, ph, n)
                    h = heights[r, c]
                    if f > 0 and r + 1 < rows:
                        h += f * (heights[r + 1, c] - h)
                    n = _push(c, h, bend, px, ph, n)
            # The receiver at this column, if its nearest line is this one
            i = int(np.floor(y + 0.5))
            d = y - i
            if n > 0 and 0 <= i < rows and -half < d <= half:
                h = heights[i, x] - bend * x * x
                k = n - 1
                best = (ph[k] - h) / (px[k] - x)
                # Slopes along the hull rise, then fall
                while k > 0:
                    rise = (ph[k - 1] - h) / (px[k - 1] - x)
                    if rise <= best:
                        break
                    best = rise
                    k -= 1
                # Back to the receiver's own datum; nothing to do where the near horizon is higher for certain
                best += 2 * bend * x
                if best + abs(d) * fall < out[i, x] * step:
                    x -= 1
                    continue
                # The line has found where the horizon is; the receiver's own ray says how high
                c = int(px[k]) - x
                best = max(_cell(heights, i, x, c, slope, bend, diagonal), _cell(heights, i, x, c + 1, slope, bend, diagonal))
                if c > near:
                    best = max(best, _cell(heights, i, x, c - 1, slope, bend, diagonal))
                t = np.float32(best / step)
                if t > out[i, x]:
                    out[i, x] = t
            x -= 1


def horizons(heights, d, curve: float = 0.0, near: int = NEAR, lines: int = LINES) -> np.ndarray:
    """Tangent of the horizon of every grid point along +x.

    Parameters
    ----------
    heights : (rows, columns) float32 array
        Turned heights, centred.
    d : sweep.Direction
    curve : float
        Drop of the Earth's surface over squared distance, 1/m.
    near : int
        Columns looked at on the receiver's own ray.
    lines : int
        Shared lines a row, for what lies beyond.

    Returns
    -------
    (rows, columns) float32 array
        −inf where nothing of the field lies in the direction.
    """
    heights = np.ascontiguousarray(heights, dtype=np.float32)
    out = march.horizons(heights, d, curve, near)
    if heights.shape[1] - 1 > near:
        # Where every ray through a grid point is a line of the grid, one line a row is all there is
        lines = 1 if d.slope in (0.0, 1.0) else lines
        _far(heights, d.slope, d.step, d.diagonal, curve * d.step**2, near, lines, out)
    return out
