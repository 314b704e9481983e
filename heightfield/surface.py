"""The surface that heights mean, as normals and as a Mitsuba mesh."""

from __future__ import annotations

import numpy as np

from ..images import _write_whole as write_whole


def normals(heights: np.ndarray, spacing: tuple[float, float], valid: np.ndarray | None = None) -> np.ndarray:
    """Unit normals at the grid points, from central differences, one-sided at borders and beside unknown points.

    Parameters
    ----------
    heights : (rows, columns) array
    spacing : (float, float)
        Metres between rows and between columns.
    valid : (rows, columns) bool array, optional
        Known points; all by default.

    Returns
    -------
    (3, rows, columns) float64 array
        East, north and up components.
    """
    h = np.asarray(heights, dtype=np.float64)
    known = np.ones(h.shape, dtype=bool) if valid is None else valid
    east = _slope(h, known) / spacing[1]
    north = -_slope(h.T, known.T).T / spacing[0]
    n = np.stack([-east, -north, np.ones_like(h)])
    return n / np.linalg.norm(n, axis=0)


def _slope(h, known):
    # Mean of the differences to the known neighbours of each row; 0 where there are none
    step = np.diff(h, axis=1)
    both = known[:, 1:] & known[:, :-1]
    total, count = np.zeros_like(h), np.zeros(h.shape)
    for side in (np.s_[:, :-1], np.s_[:, 1:]):
        total[side] += np.where(both, step, 0)
        count[side] += both
    return total / np.maximum(count, 1)


def mesh(heights: np.ndarray, spacing: tuple[float, float], valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of the surface.

    Every cell is cut from its north-west to its south-east corner; cells that touch an invalid point are left out.

    Returns
    -------
    vertices : (rows · columns, 3) float64 array
        x east, y north, z up; the north-west sample is at x = 0, y = 0.
    triangles : (n, 3) int array
        Counter-clockwise seen from above.
    """
    rows, columns = heights.shape
    y, x = np.mgrid[:rows, :columns]
    vertices = np.stack([x * spacing[1], -y * spacing[0], np.where(valid, heights, 0.0)], -1).reshape(-1, 3)
    nw = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    ne, sw, se = nw + 1, nw + columns, nw + columns + 1
    triangles = np.concatenate([np.stack([nw, sw, se], -1), np.stack([nw, se, ne], -1)])
    return vertices, triangles[valid.ravel()[triangles].all(axis=1)]


def refine(values: np.ndarray, s: int) -> np.ndarray:
    """Return the triangulated grid's values on a grid ``s`` times as fine: the same surface in smaller cells.

    Parameters
    ----------
    values : (rows, columns) array
    s : int

    Returns
    -------
    (s · (rows − 1) + 1, s · (columns − 1) + 1) float64 array
    """
    values = np.asarray(values, dtype=np.float64)
    rows, columns = values.shape
    if s == 1 or min(rows, columns) < 2:
        return values
    y, x = np.arange(s * (rows - 1) + 1), np.arange(s * (columns - 1) + 1)
    r, c = np.minimum(y // s, rows - 2), np.minimum(x // s, columns - 2)
    f, g = ((y - r * s) / s)[:, None], ((x - c * s) / s)[None, :]
    r, c = r[:, None], c[None, :]
    nw, ne, sw, se = values[r, c], values[r, c + 1], values[r + 1, c], values[r + 1, c + 1]
    return np.where(g >= f, nw + g * (ne - nw) + f * (se - ne), nw + f * (sw - nw) + g * (se - sw))


def write_ply(path, vertices, normals, triangles) -> None:
    """Write a binary PLY mesh with vertex normals.

    Parameters
    ----------
    path : path-like
    vertices, normals : (n, 3) array
    triangles : (m, 3) int array
    """
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        + "".join(f"property float {c}\n" for c in ("x", "y", "z", "nx", "ny", "nz"))
        + f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, triangles

    def write(temporary):
        with open(temporary, "wb") as file:
            file.write(head.encode())
            file.write(np.hstack([vertices, normals]).astype("<f4").tobytes())
            file.write(faces.tobytes())

    write_whole(path, write)


def filled(values: np.ndarray, valid: np.ndarray, policy: str, spacing: tuple[float, float]) -> np.ndarray:
    """Return heights with unknown points replaced as the policy says (see `HeightField`), (rows, columns) float64."""
    if valid.all():
        return values
    out = values.copy()
    known = values[valid]
    extent = np.hypot(values.shape[0] * spacing[0], values.shape[1] * spacing[1])
    if policy == "fill":
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(~valid, sampling=spacing, return_distances=False, return_indices=True)
        return values[tuple(nearest)]
    # Higher, or lower, than any line of sight between known points
    steep = 1e6 * (extent + np.ptp(known))
    out[~valid] = known.max() + steep if policy == "block" else known.min() - steep
    return out
