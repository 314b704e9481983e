"""`HeightField`: a height map, and what its points see of each other and of the sky."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..report import Report
from . import device, hull, intervisibility, light, march, skip, surface, transport
from . import points as rays
from .check import FARTHEST, choice, grid, known, number, shown, spacing_of, watcher
from .sources import path_of
from .sweep import angles, azimuths_of, direction, packed
from .tally import Tally

EARTH = 6_371_000.0  # m
REFRACTION = 0.13  # of the Earth's curvature, standard for light near the ground
POLICIES = ("fill", "transparent", "block")
METHODS = ("auto", "tree", "march")


class HeightField:
    """A field of heights over a regular grid.

    The surface is the triangulated grid: straight from sample to sample, every cell cut from its north-west to its
    south-east corner. Receivers are the samples. Beyond the border there is nothing.

    Parameters
    ----------
    heights : (rows, columns) array
        Metres; row 0 is north, column 0 west. Any real dtype; kept as float64.
    spacing : float or (float, float)
        Metres between samples, or between rows and between columns (dy, dx).
    nodata : float, optional
        A height that means "unknown"; NaN always does.
    nodata_policy : {"fill", "transparent", "block"}
        What unknown points do to their surroundings: take the height of the nearest known point (default), let light
        pass, or stand like an endless wall. Results at unknown points are NaN.
    curvature : bool or float
        Let the Earth curve away: True for its radius and a refraction of 0.13, a number for another refraction coefficient.
    radius : float, optional
        Do not look farther than so many metres; what is just so far is seen.

    Attributes
    ----------
    heights : (rows, columns) float64 array
        As used: unknown points replaced by the policy.
    valid : (rows, columns) bool array
    spacing : (float, float)
    georeference : object or None
        What a GeoTIFF said of itself; written back with products.
    report : Report
        Of the latest method.
    tally : Tally
        How often the latest method looked at the surface, and how often the naive method does.

    Raises
    ------
    InputError
        If a parameter cannot be used.
    """

    def __init__(self, heights, spacing=1.0, *, nodata=None, nodata_policy="fill", curvature=False, radius=None):
        values = grid("heights", heights)
        self.spacing = spacing_of(spacing)
        self.policy = choice("nodata_policy", nodata_policy, POLICIES)
        self.radius = None if radius is None else number("radius", radius, 0.0, FARTHEST, open_low=True)
        refraction = REFRACTION if isinstance(curvature, (bool, np.bool_)) else number("curvature", curvature, 0.0, 0.999)
        on = curvature is not False
        self.curve = (1 - refraction) / (2 * EARTH) if on else 0.0
        self.valid = known(values, nodata)
        if not self.valid.any():
            raise InputError("'heights' must have at least one known height (got none: all are nodata or not finite)")
        self.heights = surface.filled(values, self.valid, self.policy, self.spacing)
        # Sweeps run in float32: centred, or heights far from zero would lose their centimetres; by whole metres, so that
        # heights that differ by whole metres still do
        self.centre = float(np.round(np.mean(self.heights[self.valid])))
        self._turned = (self.heights - self.centre).astype(np.float32)
        self.georeference = None
        self.report, self.tally = Report(), Tally()

    @classmethod
    def from_file(cls, path, **options) -> HeightField:
        """Read a height field from a .tif, .npz, .npy, .exr or .png file.

        Parameters
        ----------
        path : path-like
        **options
            As for `HeightField`; ``spacing`` and ``nodata`` override what the file says.

        Returns
        -------
        HeightField

        Raises
        ------
        InputError
            If the file cannot be read, is no height map, or an option cannot be used.
        """
        from .sources import read

        heights, found, georeference = read(path_of("path", path))
        field = cls(heights, **{**found, **options})
        field.georeference = georeference
        return field

    # --- What points see -------------------------------------------------------------------------------------------

    def horizons(self, azimuths=72, *, points=None, method="auto", progress=None) -> np.ndarray:
        """Elevation of the horizon around every point.

        Parameters
        ----------
        azimuths : int or array
            How many, equally spaced from north, or which: radians clockwise from north.
        points : (n, 2) array or (rows, columns) bool array, optional
            Receivers: rows and columns, which may be fractional, or a mask of the grid. Each ray is then marched on its own.
        method : {"auto", "tree", "march"}
            "march" looks at every edge that the ray crosses; "auto" steps over stretches too low to be seen (see `skip`),
            for large fields on a GPU where there is one (see `device`). Both are exact on the surface. "tree" finds where the
            horizon is with hulls shared by neighbouring rays, then looks only there (see `hull`), on a GPU where there is
            one. It never overrates a horizon, but may miss what is narrower than a cell; with ``radius``, or more than
            16,384 samples a line, it gives way to the march.
        progress : callable, optional
            Called with (directions done, directions).

        Returns
        -------
        (K, rows, columns) or (K, n) float32 array
            Radians above the horizontal, negative where the view goes down; −π/2 where nothing of the field lies in the
            direction; NaN at unknown points.
        """
        k = azimuths_of(azimuths)
        if points is not None:
            choice("method", method, METHODS)
            return self._at_points(points, k)[0].astype(np.float32)
        out = np.empty((len(k), *self.heights.shape), dtype=np.float32)
        with self._reported():
            for n, t in enumerate(self._tangents(k, method, progress)):
                angles(t, out[n])
        if not self.valid.all():
            out[:, ~self.valid] = np.nan
        return out

    def sky_view(self, azimuths=72, *, weighting="cosine", points=None, method="auto", progress=None) -> np.ndarray:
        """Share of the sky that every point sees.

        Parameters
        ----------
        azimuths, points, method, progress
            As in `horizons`.
        weighting : {"cosine", "solid_angle"}
            "cosine": irradiance under a uniform sky over that of an open horizontal plane; "solid_angle": solid angle of
            the visible sky over that of the upper hemisphere.

        Returns
        -------
        (rows, columns) or (n,) float32 array
            In [0, 1].
        """
        choice("weighting", weighting, ("cosine", "solid_angle"))
        choice("method", method, METHODS)
        k = azimuths_of(azimuths)
        n = surface.normals(self.heights, self.spacing, self.valid)
        if points is not None:
            elevations, n = self._at_points(points, k, n)
            tangents, known = np.tan(elevations).astype(np.float32), np.isfinite(elevations[0])
        else:
            tangents, known = map(packed, self._tangents(k, method, progress)), self.valid
        total, n = np.zeros(known.size), n.reshape(3, -1)
        with self._reported():
            for az, t in zip(k, tangents, strict=True):
                if weighting == "cosine":
                    light.add_cosine(t.ravel(), n, az, total)
                else:
                    light.add_solid_angle(t.ravel(), total)
        out = np.clip(total / len(k), 0, 1).astype(np.float32).reshape(known.shape)
        out[~known] = np.nan
        return out

    def shadow(self, azimuth: float, elevation: float, *, radius: float = light.SUN_RADIUS, method="auto") -> np.ndarray:
        """Share of the sun's disk that every point sees.

        Parameters
        ----------
        azimuth, elevation : float
            Of the sun's centre, in radians.
        radius : float
            Angular radius of the disk in radians (default 0.2666°); 0 for a point.

        Returns
        -------
        (rows, columns) float32 array
            1 in full sun, 0 in shadow. The horizon is taken as level over the width of the disk.
        """
        azimuth, elevation = number("azimuth", azimuth), number("elevation", elevation, -np.pi / 2, np.pi / 2)
        radius = number("radius", radius, 0.0, np.pi / 2)
        with self._reported():
            out = self._lit(azimuth, elevation, radius, method).astype(np.float32)
        out[~self.valid] = np.nan
        return out

    def intervisibility(self, azimuth: float, *, method="auto"):
        """Local horizons of every point in one direction (§4): where each visible stretch of the surface ends.

        Parameters
        ----------
        azimuth : float
            Radians clockwise from north.
        method : {"auto", "tree", "march"}
            All give the same result, bit for bit: "march" looks at every sample of the line, "tree" keeps the paper's convex
            hull tree, "auto" takes that too, but where a reach is set it marches and steps over what cannot be seen.
            With ``radius``, or lines of more than 65,533 samples, all but "march" do the latter.

        Returns
        -------
        offsets : (rows · columns + 1,) int64 array
            Point ``i``'s horizons are entries ``offsets[i]`` to ``offsets[i + 1]``, nearest first.
        distances : (m,) float32 array
            Horizontal metres.
        angles : (m,) float32 array
            Elevation in radians.

        Notes
        -----
        Points share lines (see `lines`): except along rows, columns and diagonals of the grid a point is
        looked from at most half a row beside it, and the surface is looked at where the line crosses columns (or rows if it
        runs closer to north). A sample is seen if its slope exceeds that of everything nearer; equal slopes are not seen.
        ``report.skipped`` says how many crossings were not looked at that the naive method looks at.
        """
        choice("method", method, METHODS)
        d = direction(number("azimuth", azimuth), self.spacing)
        with self._reported():
            *found, looked, naive = intervisibility.local_horizons(d, self._turned, self.curve, self._reach(d), method)
            self.tally.add(looked, naive, self.heights.size)
        return tuple(found)

    # --- Light -----------------------------------------------------------------------------------------------------

    def irradiance(
        self,
        sky=1.0,
        sun=None,
        albedo=0.3,
        emission=None,
        bounces=2,
        azimuths=64,
        *,
        lamps=None,
        points=None,
        tolerance=0.0,
        supersampling=1,
        sparse=1,
        method="auto",
        progress=None,
    ) -> np.ndarray:
        """Irradiance of every point from sky, sun and the rest of the field.

        Parameters
        ----------
        sky : float, (channels,) array, callable or (h, w, channels) array
            Radiance in W/(m² sr): constant; a function of azimuth and elevation arrays (radians) that returns
            (..., channels); or an environment map, its first row straight up and its columns clockwise from north, as
            Mitsuba's ``envmap`` has them after ``rotate([1, 0, 0], 90)``.
        sun : (azimuth, elevation, irradiance) or (azimuth, elevation, irradiance, radius), optional
            Direction in radians, irradiance on a plane facing the sun in W/m² (number or (channels,)), and angular radius.
        albedo : float, (channels,) array or (rows, columns[, channels]) array
            Of the diffuse surface, in [0, 1].
        emission : the same kinds, optional
            Radiance that the surface itself sends out.
        bounces : int
            Reflections on the way to the receiver; 0 is direct light.
        azimuths : int or array
            Directions over which light is gathered.
        lamps : list of (x, y, z, intensity), optional
            Point lights: metres east and north of the north-west sample, height in metres, and W/sr (number or (channels,)).
        points : (n, 2) array or (rows, columns) bool array, optional
            Receivers, as in `horizons`; the whole field is lit first, as far as it sends them light.
        tolerance : float
            Leave out of each bounce what surely adds no more than this share of π times the surface's greatest radiance;
            0 gathers everything.
        supersampling : int
            The surface's light is straight over each triangle, two a cell. S cuts each cell into S × S in which receivers see
            its direct light; what is reflected more than once is exchanged by whole triangles.
        sparse : int
            Serve only one point in so many from each azimuth, in dashes of 2 × 16 points at random, and take so many times
            more azimuths for the same time: banding turns to noise (§10.3). At most a 16th of the azimuths.
        method : {"auto", "tree", "march"}
            How the sky's and the sun's horizons are found, as in `horizons`.
        progress : callable, optional
            Called with (sweeps done, sweeps).

        Returns
        -------
        (rows, columns, channels) or (n, channels) float32 array
            W/m²; NaN at unknown points.
        """
        choice("method", method, METHODS)
        bounces, tolerance = int(number("bounces", bounces, 0, 1000, whole=True)), number("tolerance", tolerance, 0, 1)
        s = int(number("supersampling", supersampling, 1, 16, whole=True))
        k, progress = azimuths_of(azimuths), watcher(progress)
        sparse = int(number("sparse", sparse, 1, whole=True))
        if sparse > max(len(k) // 16, 1):
            got = f"got {sparse} of {len(k)}"
            raise InputError(f"'sparse' must be a 16th of the azimuths at most ({got}): take {16 * sparse} azimuths")
        if sparse > 1:
            k = np.sort(k)
        at = None if points is None else rays.positions(points, self.heights.shape)
        with self._reported():
            lights, how = (sky, sun, lamps, albedo, emission), (bounces, k, tolerance, s, sparse, method, progress, at)
            e = transport.irradiance(self, *lights, *how)
        out = np.ascontiguousarray(np.moveaxis(e, 0, -1))
        out[~(self.valid if at is None else rays.interpolated(at, self.valid, None)[0])] = np.nan
        return out

    # --- The surface itself ----------------------------------------------------------------------------------------

    def to_mitsuba(self, bsdf=None, path=None, *, smooth=False) -> dict:
        """Return the surface as a Mitsuba shape dict: the same triangles.

        Parameters
        ----------
        bsdf : dict, optional
            Mitsuba BSDF; Mitsuba's own default without.
        path : path-like, optional
            Where to write the mesh (PLY); a temporary file, removed at exit, by default.
        smooth : bool
            Shade with normals interpolated between the grid points', which hides the triangles but loses light: Mitsuba sees
            black where such a normal turns away from the viewer. By default each triangle is shaded as the plane it is.

        Returns
        -------
        dict
            x points east, y north, z up, in metres from the north-west sample; z is counted from ``centre``, the mean
            height, because Mitsuba computes in float32.
        """
        vertices, triangles = surface.mesh(self.heights - self.centre, self.spacing, self.valid)
        if not len(triangles):
            raise InputError("'heights' must span a triangle: at least 2 rows and 2 columns of known points")
        if bsdf is not None and not isinstance(bsdf, dict) and not hasattr(bsdf, "eval_pdf"):
            raise InputError(f"'bsdf' must be a dict or a Mitsuba BSDF (got {shown(bsdf)})")
        if path is None:
            folder = tempfile.mkdtemp(prefix="intervis-")
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
            path = Path(folder) / "heightfield.ply"
        path = path_of("path", path)
        n = np.moveaxis(surface.normals(self.heights, self.spacing, self.valid), 0, -1).reshape(-1, 3)
        surface.write_ply(path, vertices, n, triangles)
        shape = {"type": "ply", "filename": str(path), "face_normals": not smooth}
        return {**shape, "bsdf": bsdf} if bsdf is not None else shape

    # --- Sweeps ----------------------------------------------------------------------------------------------------

    def _reach(self, d):
        return None if self.radius is None else self.radius / d.step

    def _lit(self, azimuth, elevation, radius, method, at=None):
        # Share of the sun's disk that grid points see, or places on the surface
        if at is None:
            (t,) = self._tangents(np.array([azimuth]), method)
        else:
            (t,) = rays.tangents(self.heights, at, np.array([azimuth]), self.spacing, self.radius, self.curve, self.tally)
        return light.disk_share(np.arctan(t.astype(np.float64)), elevation, radius)

    def _at_points(self, points, azimuths, n=None):
        # Horizons in radians, (K, n), NaN beside unknown points; and normals interpolated to the points
        at = rays.positions(points, self.heights.shape)
        with self._reported():
            found = rays.tangents(self.heights, at, azimuths, self.spacing, self.radius, self.curve, self.tally)
            out = np.arctan(found)
        known, n = rays.interpolated(at, self.valid, n)
        out[:, ~known] = np.nan
        return out, n

    def _tangents(self, azimuths, method, progress=None):
        # Tangents of the horizons, a direction at a time; the same direction twice is looked at once
        choice("method", method, METHODS)
        watcher(progress)
        before, way, backend = (None, None), None, device.chosen(self.heights.shape)
        for n, azimuth in enumerate(azimuths):
            if azimuth != before[0]:
                d, looked = direction(azimuth, self.spacing), []
                reach = self._reach(d)
                if way != (d.transpose, d.flip_rows, d.flip_columns):
                    # The same for all directions of an eighth of the circle
                    way = d.transpose, d.flip_rows, d.flip_columns
                    laid = skip.lay(self._turned, d) if method == "auto" else packed(d.turn(self._turned))
                    laid = device.put(laid, backend) if method == "auto" and backend else laid
                shape = d.turn(self._turned).shape
                if method == "auto":
                    t = d.lift((device if backend else skip).horizons(laid, d, self.curve, reach, looked))
                elif method == "march" or reach is not None or shape[1] > hull.LONGEST:
                    t = d.back(march.horizons(laid, d, self.curve, reach, looked))
                else:
                    t = d.back(hull.horizons(laid, d, self.curve, tally=looked))
                self.tally.add(sum(looked), march.naive(d, shape, reach), self._turned.size)
                before = (azimuth, t)
            yield before[1]
            if progress:
                progress(n + 1, len(azimuths))

    def _reported(self):
        return _Timed(self)


class _Timed:
    # Fill the field's report with the time a method took, and with what it looked at
    def __init__(self, field):
        self.field = field

    def __enter__(self):
        self.begin, self.field.tally = time.perf_counter(), Tally()

    def __exit__(self, *_):
        tally = self.field.tally
        skipped = {"points without data": int((~self.field.valid).sum())}
        report = Report(wall_s=time.perf_counter() - self.begin, skipped=skipped)
        if tally.rays:
            skipped["crossings"] = max(tally.naive - tally.looked, 0)
            report.notes.append(str(tally))
        self.field.report = report
