"""Passes over all directions on a GPU: `passes` with the field, the receivers and their sums in its memory."""

from __future__ import annotations

import drjit as dr
import numpy as np

from . import device, device_light
from .passes import Passes


class DevicePasses(Passes):
    """As `Passes`, looking from a GPU.

    Parameters
    ----------
    backend : str
        Of Dr.Jit.
    field, n, s, tolerance, sparse
        As `Passes` has them.
    """

    def __init__(self, backend: str, *which, **how):
        super().__init__(*which, **how)
        self.backend = backend

    def _laid(self, d, s):
        return device.put(super()._laid(d, s), self.backend)

    def _stretches(self, laid, d, s):
        return device.stretches(laid, d, s)

    def _look(self, d, laid, tops, r):
        own, horizon = (device.types(self.backend).Float(v.ravel()) for v in (r.heights, r.horizon()))
        for way, _, _, count in self._sides(d, laid.shape, tops, r):
            horizon, looked = device.steepest(laid, way, own, r.heights.shape[1], horizon)
            self.field.tally.add(int(looked.numpy()[0]), *count)
        return horizon.numpy().reshape(r.heights.shape)

    def _gained(self, some, each, laid, receivers, lit, width, busy, step):
        Float = device.types(self.backend).Float
        light = None if lit is None else [Float(channel.ravel()) for channel in lit]
        there = [device_light.put(laid, r.heights, r.normals, r.facets) for r in receivers]
        sums = [[dr.zeros(Float, r.heights.size) for _ in range(int(np.prod(each)))] for r in receivers]
        crossed, s = self._crossed(some[0][1], laid, lit)
        for (az, d, table), those in zip(some, busy, strict=True):
            tops, toward = self._stretches(crossed, d, s), (np.sin(az), np.cos(az))
            for n, (r, to, b) in enumerate(zip(receivers, there, those, strict=True)):
                before = horizon = Float(r.horizon(b).ravel())
                for way, shown, part, count in self._sides(d, crossed.shape, tops, r, None if lit is None else lit.shape, b):
                    if light is None:
                        horizon, looked = device.steepest(crossed, way, to.heights, to.pitch, before)
                    else:
                        which = light, to, toward, way, shown, self.tolerance / 2
                        horizon, gains, looked = device_light.surface(laid, *which, before)
                        sums[n] = _added(sums[n], gains, width * part)
                    self.field.tally.add(int(looked.numpy()[0]), *count)
                if table is not None:
                    sums[n] = _added(sums[n], device_light.sky(laid, to, toward, table, horizon), width)
            if step:
                step()
        numbers = (np.stack([v.numpy() for v in s]) for s in sums)
        return [v.reshape(*each, *r.heights.shape) for v, r in zip(numbers, receivers, strict=True)]


def _added(sums, gains, width):
    # A kernel for all widths
    width = dr.opaque(type(sums[0]), width)
    sums = [dr.fma(g, width, s) for s, g in zip(sums, gains, strict=True)]
    dr.eval(sums)
    return sums
