"""Passes over all directions: what grid points or triangles' corners get from the field's triangles and from the sky."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from . import gather, skip
from .faces import MEETING, Facets, along_edge, bordered, facets, fit, inside, placed, planes, ray, spots, undeal
from .lanes import LANES
from .light import disk_share
from .march import ABYSS, BLOCK, crossed
from .skylight import add_sky, add_sky_to_facets
from .surface import refine
from .sweep import Direction, direction, packed

PARTS = 4  # a side, of a grid's triangle, at whose centroids the sun is looked at

NO_NORMALS = np.empty((3, 0, 0), np.float32)
NO_FACETS = Facets(np.empty((0, 4, 3), np.int64), np.float32(0), np.float32(0))


@dataclass(frozen=True)
class Receivers:
    """Receivers that lie alike in their cells of a laid grid, columns first.

    Attributes
    ----------
    heights : (n, m) float32 array
        m is a multiple of 16; what is more than ``rows`` is no receiver.
    rows : int
    y, x : float
        Row and column in the cell.
    normals : (3, n, m) float32 array, optional
        Of those that gather light by a normal of their own.
    facets : faces.Facets
        Of those that gather light for the triangles that meet there.
    """

    heights: np.ndarray
    rows: int
    y: float = 0.0
    x: float = 0.0
    normals: np.ndarray | None = None
    facets: Facets = NO_FACETS

    def horizon(self, busy=None) -> np.ndarray:
        """Return tangents of horizons before anything is seen, infinite for what is no receiver.

        ``busy``, (n, m / 16) bool, says which sixteen rows receive at all.
        """
        out = np.full(self.heights.shape, -np.inf, dtype=np.float32)
        if busy is not None:
            out[_sixteenfold(~busy)] = np.inf
        out[:, self.rows :] = np.inf
        return out

    def turns(self, sparse: int, seed: int) -> np.ndarray:
        """Return which of ``sparse`` turns it is of sixteen rows, (n, m / 16) int64: dashes of two columns, at random."""
        columns, rows = self.heights.shape
        some = np.random.default_rng(seed).integers(sparse, size=(-(-columns // 2), rows // LANES))
        return np.repeat(some, 2, axis=0)[:columns]


def _sixteenfold(values):
    return np.repeat(values, LANES, axis=-1)


def _padded(values, fill=0.0):
    # Rows filled up to full vectors
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, -values.shape[-1] % LANES)], constant_values=fill)


class Passes:
    """A field and its triangles, to be lit from one direction after another.

    Parameters
    ----------
    field : HeightField
    n : (3, rows, columns) array
        Unit normals of the grid points.
    s : int
        Cells into which a cell is cut, a side.
    tolerance, sparse
        As `HeightField.irradiance` takes them.
    """

    def __init__(self, field, n, s: int, tolerance: float, sparse: int = 1):
        self.field, self.n, self.s, self.tolerance, self.sparse = field, n, s, tolerance, sparse
        # In units of about a cell, whatever its size, float32 holds every number; powers of two change no digit
        unit = 2.0 ** np.floor(np.log2(min(field.spacing)))
        self.spacing = field.spacing[0] / unit, field.spacing[1] / unit
        self.radius, self.curve = np.inf if field.radius is None else field.radius / unit, field.curve * unit
        self.heights = (field._turned / unit).astype(np.float32)
        self.fine = refine(self.heights, s)

    def gathered(self, to_corners: bool, azimuths, radiance=None, near=None, tables=None, step=None) -> np.ndarray:
        """Irradiance over all directions.

        Parameters
        ----------
        to_corners : bool
            Whether the triangles' corners receive; the field's points otherwise.
        azimuths : (K,) array
        radiance : (channels, 2, 3, ...) float32 array, optional
            Of the triangles at their corners; none by default.
        near : (channels, 2, 3, rows − 1, columns − 1) float32 array, optional
            Of whole triangles, as a receiver sees it that stands on their corner: all of them must be grid points.
        tables : K arrays, optional
            The sky's, as `skylight.sky_table` returns them; no sky by default.
        step : callable, optional
            Called after each direction.

        Returns
        -------
        (channels, 6, ...) or (channels, rows, columns) float32 array
            Of the six triangles that meet at a corner, in the order of `faces.MEETING`.
        """
        channels = len(radiance) if radiance is not None else tables[0].shape[-1]
        each = (len(MEETING), *self.fine.shape) if to_corners else self.field.heights.shape
        out = np.zeros((channels, *each), dtype=np.float32)
        width, tables = 2 * np.pi / len(azimuths), [None] * len(azimuths) if tables is None else tables
        directions = ((az, direction(az, self.spacing), table) for az, table in zip(azimuths, tables, strict=True))
        done, served = 0, np.zeros((1, *each[-2:]), dtype=np.float32)
        for _, some in itertools.groupby(directions, lambda v: (v[1].transpose, v[1].flip_rows, v[1].flip_columns)):
            # Directions of an eighth of the circle see the field alike
            some = list(some)
            d = some[0][1]
            laid, receivers = self._laid(d, self.s), self._receivers(d, to_corners)
            lit = None if radiance is None else self._lit(d, radiance, near)
            # Of a sparse direction each point has its turn (§10.3); neighbours have others, so that banding turns to noise
            turns = [r.turns(self.sparse, done) if self.sparse > 1 else None for r in receivers]
            busy = [[None if t is None else (t + done + n) % self.sparse == 0 for t in turns] for n in range(len(some))]
            done += len(some)
            self._add_back(d, self._gained(some, (channels, *each[:-2]), laid, receivers, lit, width, busy, step), out)
            if self.sparse > 1:
                self._add_back(d, [_sixteenfold(sum(b).astype(np.float32))[None] for b in zip(*busy, strict=True)], served)
        return out if self.sparse == 1 else out * (len(azimuths) / np.maximum(served, 1))

    def _gained(self, some, each, laid, receivers: list[Receivers], lit, width: float, busy, step) -> list[np.ndarray]:
        # What receivers gain from directions that see the grid alike, (*each, n, m), from the sky and from the surface
        shares = [np.zeros((*each, *r.heights.shape), dtype=np.float32) for r in receivers]
        crossed, s = self._crossed(some[0][1], laid, lit)
        for (az, d, table), those in zip(some, busy, strict=True):
            tops, toward = self._stretches(crossed, d, s), (np.float32(np.sin(az)), np.float32(np.cos(az)))
            for r, share, b in zip(receivers, shares, those, strict=True):
                horizon = self._look(d, crossed, tops, r, lit, toward, width, share, b)
                if table is not None and r.normals is None:
                    add_sky_to_facets(laid, horizon, r.facets, toward, table, width, share)
                elif table is not None:
                    add_sky(horizon, r.normals, toward, table, width, share)
            if step:
                step()
        return shares

    def shadow(self, azimuth: float, elevation: float, radius: float) -> np.ndarray:
        """Share of the sun's disk that triangles see, straight over each, at their corners: (2, 3, ...) float32."""
        d, s, parts = direction(azimuth, self.spacing), self.s, -(-PARTS // self.s)
        laid, out = self._laid(d, 1), np.zeros((2, 3, *(size - 1 for size in self.fine.shape)), np.float32)
        tops = self._stretches(laid, d, 1)
        for kind in (0, 1):
            for (v, u), weights in zip(spots(kind, parts), fit(kind, parts).T, strict=True):
                heights = planes(d.lay(inside(self.fine, kind, v, u).astype(np.float32)), s)
                every = [Receivers(_padded(h), h.shape[1], *placed(d, s, p, v, u)) for p, h in enumerate(heights)]
                horizon = np.stack([self._look(d, laid, tops, r)[:, : r.rows] for r in every])
                horizon = packed(d.lift(undeal(horizon, s)))
                seen = disk_share(np.arctan(horizon), elevation, radius)
                for corner, weight in zip(out[kind], weights, strict=True):
                    corner += np.float32(weight) * seen
        return np.clip(out, 0, 1, out=out)

    def _look(self, d: Direction, laid, tops, r: Receivers, radiance=None, toward=None, width=None, share=None, busy=None):
        # Return the tangents of the horizons, and add what the surface sends if its radiance is given
        horizon, image = r.horizon(busy), None if radiance is None else radiance.shape
        for way, shown, part, count in self._sides(d, laid.shape, tops, r, image, busy):
            if radiance is None:
                looked = skip.steepest(laid, way, r.heights, horizon, r.rows)
            else:
                horizon = r.horizon(busy)
                slack, part = np.float32(self.tolerance / 2), np.float32(width * part)
                own = r.heights, NO_NORMALS if r.normals is None else r.normals, r.facets
                looked = gather.surface(laid, radiance, *own, toward, way, shown, slack, part, horizon, share, r.rows)
            self.field.tally.add(looked, *count)
        return horizon

    def _sides(self, d: Direction, shape, tops, r: Receivers, image=None, busy=None):
        # Yield what rays meet and, if the radiance's shape is given, what is shown there; its share; and what to count
        stride, columns = shape[2], float(min(shape[1] - 1, self.radius / d.step))
        # A ray along edges has a triangle on its left and another on its right: half of each
        s = 1 if image is None else self.s
        sides = (-1, 1) if image is not None and along_edge(d, s * r.y, s * r.x) else (1,)
        for side in sides:
            seen = ray(d, columns, s, r.y, r.x, side, image is not None and image[1] > 6 * s * s)
            if not len(seen.edges):
                return
            way = skip.way(shape, tops, d, self.curve, seen.edges, seen.weight, seen.distance, r.y, r.x)
            shown = None
            if image is not None:
                # Radiance has a row before the first
                corners = (seen.corners.astype(np.int64) @ [image[2] * image[3], 1, stride] + 1).ravel()
                numbers = np.append(0, seen.weight), gather.bends(seen.distance)
                shown = gather.Shown(corners, *(v.astype(np.float32) for v in numbers))
            naive = crossed(seen.edges, (r.rows, len(r.heights)), stride - BLOCK, shape[1])
            part = 1.0 if busy is None else busy.mean()
            yield way, shown, 1 / len(sides), (part * naive, part * r.rows * len(r.heights) / len(sides))

    def _stretches(self, laid, d, s):
        return skip.stretches(laid, d, s)

    def _crossed(self, d, laid, lit):
        # What rays cross, and into how many cells its cells are cut: where nothing is shown, whole ones will do
        return (laid, self.s) if lit is not None or self.s == 1 else (self._laid(d, 1), 1)

    # --- To a laid grid and back ---------------------------------------------------------------------------------------

    def _laid(self, d, s):
        laid = planes(d.lay(self.heights if s == 1 else self.fine.astype(np.float32)), s, ABYSS)
        # Something to read before the first sample: triangles are looked at from all of their corners
        guarded = np.full(LANES + laid.size, ABYSS, np.float32)[LANES:].reshape(laid.shape)
        guarded[...] = laid
        return guarded

    def _lit(self, d, radiance, near):
        # The surface's radiance, as `gather.surface` takes it
        columns, rows = d.turn(self.heights).shape[::-1]
        count = 6 * self.s**2
        out = np.zeros((len(radiance), count + 6 * (near is not None), columns - 1, rows + BLOCK), np.float32)
        self._fill(d, radiance, self.s, out[:, :count])
        if near is not None:
            self._fill(d, near, 1, out[:, count:])
        return out

    def _fill(self, d, values, s, out):
        flat = values.reshape(-1, *values.shape[-2:])
        bordered(np.concatenate([planes(d.lay(v), s) for v in flat]), s, d.flip_rows, out)

    def _receivers(self, d, to_corners):
        if not to_corners:
            own, n = packed(d.lay(self.heights)), np.stack([packed(d.lay(c)) for c in self.n])
            return [Receivers(_padded(own), own.shape[1], normals=_padded(n, 1.0))]
        s, found = self.s, []
        for p, h in enumerate(planes(d.lay(self.fine.astype(np.float32)), s)):
            meeting = facets(d, s, p, self.spacing)
            found.append(Receivers(_padded(h), h.shape[1], p % s / s, p // s / s, facets=meeting))
        return found

    def _add_back(self, d, parts, out):
        # Add a (channels, [f,] n, m) part for each plane to north-up (channels, [f,] ...)
        s = 1 if len(parts) == 1 else self.s
        rows, columns = d.turn(out[(0,) * (out.ndim - 2)]).shape
        for one in np.ndindex(out.shape[:-2]):
            fine = [p[one][:, : -(-rows // s)] for p in parts]
            fine = fine[0] if s == 1 else undeal(np.stack(fine), s)
            out[one] += packed(d.lift(fine[:columns, :rows]))
