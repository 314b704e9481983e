"""Camera hits: one primary ray a lane, wherever in its pixel the lane's point falls."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .points import net_1d, net_2d, net_high, seeds, shuffle


class Frame:
    """The pixels to render, and how to shoot a primary ray through one of them.

    Parameters
    ----------
    sensor : mi.Sensor
    """

    def __init__(self, sensor):
        self.sensor, self.film = sensor, sensor.film()
        self.border = self.film.rfilter().border_size() if self.film.sample_border() else 0
        self.crop = mi.ScalarVector2i(self.film.crop_size())
        self.offset = mi.ScalarPoint2i(self.film.crop_offset())
        self.width = int(self.crop.x) + 2 * self.border
        self.height = int(self.crop.y) + 2 * self.border
        self.pixels = self.width * self.height
        self.lens = sensor.needs_aperture_sample()
        self.shutter = sensor.shutter_open_time()
        self.sample = sensor.sample_ray
        try:
            self.ray(mi.Point2f(0.5))
        except RuntimeError:
            # An irradiance meter has only this
            self.sample = sensor.sample_ray_differential

    def traverse(self, callback):  # noqa: D102
        pass

    def corner(self, index):
        """Integer film coordinates of a lane's pixel."""
        w = dr.opaque(mi.UInt32, self.width)
        y = index // w
        x = index - y * w
        corner = mi.Vector2f(mi.Float(x), mi.Float(y))
        return corner + mi.Vector2f(self.offset.x - self.border, self.offset.y - self.border)

    def shoot(self, corner, s, scramble):
        """Primary ray of sample ``s`` in the pixel at ``corner``.

        Returns
        -------
        ray : mi.Ray3f
        weight : mi.Spectrum
        position : mi.Point2f
            Film position, in pixels.
        """
        # Light samples take the first two dimensions: places in the pixel and on the light are spread together
        position = corner + net_high(s, scramble[1], scramble[2])
        lens, time, wavelength = mi.Point2f(0.5), mi.Float(self.sensor.shutter_open()), mi.Float(0)
        if self.lens:
            lens = net_2d(shuffle(s, scramble[3]), scramble[4], scramble[5])
        if self.shutter > 0:
            time += self.shutter * net_1d(shuffle(s, scramble[6]), scramble[7])
        if mi.is_spectral:
            wavelength = net_1d(shuffle(s, scramble[6]), scramble[7])
        ray, weight = self.ray(position, lens, time, wavelength)
        return ray, weight, position

    def ray(self, position, lens=(0.5, 0.5), time=0.0, wavelength=0.0):
        """Primary ray and its weight through a film position, in pixels."""
        scaled = (position - mi.Vector2f(self.offset)) / mi.Vector2f(self.crop)
        return self.sample(time, wavelength, scaled, mi.Point2f(lens))


def scramble(index, seed, salt) -> list:
    """Twelve scrambling seeds for a pixel: eight for the camera, two for the lights, two for BSDF samples."""
    return seeds(index, seed + (mi.UInt32(salt) * 7919 + 1), 12)
