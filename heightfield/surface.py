"""The surface that heights mean, as normals and as a Mitsuba mesh."""

from __future__ import annotations

import numpy as np


def normals(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """Unit normals at the grid points, from central differences (one-sided at the border).

    Parameters
    ----------
    heights : (rows, columns) array
    spacing : (float, float)
        Metres between rows and between columns.

    Returns
    -------
    (3, rows, columns) float64 array
        East, north and up components.
    """
    h = np.asarray(heights, dtype=np.float64)
    east = np.gradient(h, spacing[1], axis=1) if h.shape[1] > 1 else np.zeros_like(h)
    north = -np.gradient(h, spacing[0], axis=0) if h.shape[0] > 1 else np.zeros_like(h)
    n = np.stack([-east, -north, np.ones_like(h)])
    return n / np.linalg.norm(n, axis=0)


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
    with open(path, "wb") as file:
        file.write(head.encode())
        file.write(np.hstack([vertices, normals]).astype("<f4").tobytes())
        file.write(faces.tobytes())
