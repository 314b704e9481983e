"""Passes over all directions: what a field's triangles or grid points get from its triangles and from the sky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import gather, skip
from .faces import Faces, along_edge, bordered, centroid, planes, ray, undeal
from .lanes import LANES
from .light import disk_share
from .march import ABYSS, BLOCK, crossed
from .surface import refine
from .sweep import Direction, direction, packed


@dataclass(frozen=True)
class Receivers:
    """Receivers that lie alike in their cells of a laid grid, columns first.

    Attributes
    ----------
    heights : (n, m) float32 array
        m is a multiple of 16; what is more than ``rows`` is no receiver.
    normals : (3, n, m) float32 array
    rows : int
    y, x : float
        Row and column in the cell.
    """

    heights: np.ndarray
    normals: np.ndarray
    rows: int
    y: float = 0.0
    x: float = 0.0


def _receivers(heights, normals, y=0.0, x=0.0):
    # Rows filled up to full vectors
    rows = heights.shape[1]
    more = -rows % LANES
    up = np.pad(normals, ((0, 0), (0, 0), (0, more)), constant_values=1)
    return Receivers(np.pad(heights, ((0, 0), (0, more))), up, rows, y, x)


class Passes:
    """A field and its triangles, to be lit from one direction after another.

    Parameters
    ----------
    field : HeightField
    faces : Faces
    n : (3, rows, columns) array
        Unit normals of the grid points.
    tolerance : float
        As `HeightField.irradiance` takes it.
    """

    def __init__(self, field, faces: Faces, n, tolerance: float):
        self.field, self.faces, self.tolerance = field, faces, tolerance
        self.s = faces.supersampling
        self.n = n
        self.fine = refine(field._turned, self.s).astype(np.float32)

    def gathered(self, to_faces: bool, azimuths, radiance=None, tables=None, step=None) -> np.ndarray:
        """Irradiance over all directions.

        Parameters
        ----------
        to_faces : bool
            Whether triangles receive; grid points otherwise.
        azimuths : (K,) array
        radiance : (channels, 2, ...) float32 array, optional
            Of the triangles; none by default.
        tables : K arrays, optional
            The sky's, as `gather.sky_table` returns them; no sky by default.
        step : callable, optional
            Called after each direction.

        Returns
        -------
        (channels, 2, ...) or (channels, rows, columns) float32 array
        """
        channels = len(radiance) if radiance is not None else tables[0].shape[-1]
        out = np.zeros((channels, *(self.faces.heights.shape if to_faces else self.n.shape[1:])), dtype=np.float32)
        width, before = 2 * np.pi / len(azimuths), None
        for k, az in enumerate(azimuths):
            d = direction(az, self.field.spacing)
            way = d.transpose, d.flip_rows, d.flip_columns
            if way != before:
                # The same for all directions of an eighth of the circle
                laid, receivers, before = planes(d.lay(self.fine), self.s, ABYSS), self._receivers(d, to_faces), way
                lit = None if radiance is None else np.stack([bordered(self._dealt(d, c), self.s) for c in radiance])
            tops, shares = skip.stretches(laid, d, self.s), []
            for r in receivers:
                share = np.zeros((channels, *r.heights.shape), dtype=np.float32)
                a = r.normals[0] * np.float32(np.sin(az)) + r.normals[1] * np.float32(np.cos(az))
                horizon = -a / r.normals[2]
                horizon[:, r.rows :] = np.inf
                self._look(d, laid, tops, r, a, lit, horizon, share)
                share *= np.float32(width)
                if tables is not None:
                    gather.add_sky(horizon, r.normals[2], a, tables[k], width, share)
                shares.append(share)
            out += self._back(d, shares, to_faces)
            if step:
                step()
        return out

    def shadow(self, azimuth: float, elevation: float, radius: float) -> np.ndarray:
        """Share of the sun's disk that every triangle's centroid sees, (2, ...) float64; see `HeightField.shadow`."""
        d = direction(azimuth, self.field.spacing)
        laid, found = planes(d.lay(self.fine), self.s, ABYSS), []
        tops = skip.stretches(laid, d, self.s)
        for r in self._receivers(d, True):
            horizon = np.full((1, *r.heights.shape), -np.inf, dtype=np.float32)
            horizon[..., r.rows :] = np.inf
            self._look(d, laid, tops, r, None, None, horizon[0], None)
            found.append(horizon)
        return disk_share(np.arctan(self._back(d, found, True)[0].astype(np.float64)), elevation, radius)

    def _look(self, d: Direction, laid, tops, r: Receivers, a, radiance, horizon, share):
        # Raise horizons, and add what the surface sends if its radiance is given
        reach = self.field._reach(d)
        columns, stride = laid.shape[1] - 1, laid.shape[2]
        columns = columns if reach is None else min(reach, columns)
        if columns <= 0:
            return
        # A ray along edges has a triangle on its left and another on its right: half of each
        sides = (-1, 1) if radiance is not None and along_edge(d, self.s * r.y, self.s * r.x) else (1,)
        began = horizon.copy() if len(sides) > 1 else horizon
        for side in sides:
            seen = ray(d, columns, self.s, r.y, r.x, side)
            way = skip.way(laid, tops, d, self.field.curve, seen.edges, seen.weight, seen.distance, r.y, r.x)
            if radiance is None:
                looked = skip.steepest(laid, way, r.heights, horizon, r.rows)
            else:
                horizon[...] = began
                # Radiance has a row before the first
                triangles = seen.triangles.astype(np.int64) @ [radiance[0, 0].size, 1, stride] + 1
                slack, part = np.float32(self.tolerance / 2), np.float32(1 / len(sides))
                on = way, triangles, int(r.y != 0), slack, part
                looked = gather.surface(laid, radiance, r.heights, r.normals[2], a, *on, horizon, share, r.rows)
            naive = crossed(seen.edges, (r.rows, len(r.heights)), stride - BLOCK, laid.shape[1])
            # Either side of an edge is half a ray
            self.field.tally.add(looked, naive, r.rows * len(r.heights) / len(sides))

    # --- To a laid grid and back ---------------------------------------------------------------------------------------

    def _dealt(self, d, values):
        # (2, ...) values of triangles as (2 · S², n, m) planes
        return np.concatenate([planes(d.lay(kind), self.s) for kind in values])

    def _receivers(self, d, to_faces):
        if not to_faces:
            return [_receivers(packed(d.lay(self.field._turned)), np.stack([packed(d.lay(c)) for c in self.n]))]
        found, s = [], self.s
        heights = self._dealt(d, self.faces.heights)
        n = np.stack([self._dealt(d, c) for c in self.faces.normals])
        for p in range(len(heights)):
            v, u = centroid(d, p // (s * s))
            a, b = divmod(p % (s * s), s)
            found.append(_receivers(heights[p], n[:, p], (b + v) / s, (a + u) / s))
        return found

    def _back(self, d, parts, to_faces):
        # One (channels, n, m) part per kind of receiver, as north-up (channels, ...)
        if not to_faces:
            rows = self.n.shape[2 if d.transpose else 1]
            return np.stack([packed(d.lift(c[:, :rows])) for c in parts[0]])
        rows = self.faces.heights.shape[2 if d.transpose else 1] // self.s
        parts = [p[..., :rows] for p in parts]
        parts = np.stack(parts, axis=1).reshape(len(parts[0]), 2, self.s**2, *parts[0].shape[1:])
        return np.stack([[packed(d.lift(undeal(kind, self.s))) for kind in channel] for channel in parts])
