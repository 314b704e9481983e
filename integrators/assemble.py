"""From sums over hits to an image: weights, film, layers, error estimates and the account of rays."""

from __future__ import annotations

import time

import drjit as dr
import mitsuba as mi
import numpy as np

from ..errors import InputError
from ..visibility import VisibilityClass
from .cells import window_sum
from .decide import weight_of_pilot
from .order import Order

BATCH = 1 << 22  # most hits a launch: 32 MiB of lane lists
MOVING = ("to_world", "vertex_positions", "x_fov", "principal_point_offset_x", "principal_point_offset_y")
SPREAD = 2  # places a side over which a pixel's difference is spread
RATE = 1.5  # variance of stratified hits falls as their number to this power


class Clock:
    """Seconds of each phase."""

    def __init__(self):
        self.phases, self.last = {}, time.perf_counter()

    def lap(self, name: str) -> None:
        """Close a phase (waits for its kernels)."""
        dr.sync_thread()
        now = time.perf_counter()
        self.phases[name] = self.phases.get(name, 0.0) + now - self.last
        self.last = now


def refuse_gradients(scene) -> None:
    """Say clearly where gradients would be missing, instead of returning zero.

    A plain ``render`` call has none. Where shapes or the camera move, none of the edges' share would be in them.
    """
    if dr.flag(dr.JitFlag.SymbolicScope):
        return
    parameters = mi.traverse(scene)
    # Not by iterating, which Mitsuba refuses where a parameter is None (hair)
    values = {
        name: (value if kind is None else parameters.get_property(value, kind, node), node)
        for name, (value, kind, node, _) in parameters.properties.items()
    }
    # Inside mi.render gradients are suspended
    with dr.resume_grad():
        moved = [n for n, (v, node) in values.items() if n.split(".")[-1] in MOVING and _placed(node) and dr.grad_enabled(v)]
    if moved:
        raise InputError(
            f"'{moved[0]}' moves edges, which gradients here do not see: render with Mitsuba's direct_projective, or keep it "
            "without gradient"
        )
    if any(dr.grad_enabled(v) for v, _ in values.values()):
        raise InputError(
            "'scene' has parameters with gradients enabled, which integrator.render() cannot track: "
            "call mi.render(scene, params, integrator=...) instead"
        )


def batches(hits, rays):
    """Yield a number of hits in each pixel, a launch at a time: each hit's pixel, and its number in the pixel.

    Pixels of many hits come first, so that a packet holds hits of one pixel wherever that has enough of them.
    The lists are made by Dr.Jit. Arrays that come from NumPy are borrowed, not copied, and lack the padding that kernels
    read past the end.

    Parameters
    ----------
    hits, rays : mi.UInt32
        Hits in each pixel, and rays a hit: powers of two, or no hits.
    """
    most = int(dr.max(hits)[0])
    if most == 0:
        return
    pixel = _joined([dr.compress(hits == (1 << h)) for h in reversed(range(most.bit_length()))])
    hits, rays = dr.gather(mi.UInt32, hits, pixel), dr.gather(mi.UInt32, rays, pixel)
    # In 64 bits: large films at many samples have more hits than 32 bits count
    bounds = np.cumsum(np.array(hits), dtype=np.int64)
    order = Order()
    start = 0
    while start < len(bounds):
        # As many whole pixels as fit a launch
        done = int(bounds[start - 1]) if start else 0
        stop = max(int(np.searchsorted(bounds, done + BATCH, side="right")), start + 1)
        some = dr.arange(mi.UInt32, stop - start) + dr.opaque(mi.UInt32, start)
        columns = [dr.gather(mi.UInt32, column, some) for column in (pixel, hits, rays)]
        yield _numbered(*columns, dr.cumsum(columns[1]), order, int(bounds[stop - 1]) - done)
        start = stop


def _joined(arrays):
    # `dr.concat` makes places part of its kernels: every seed would have some of its own to compile
    starts = np.cumsum([0, *(dr.width(a) for a in arrays)])
    out = dr.empty(mi.UInt32, int(starts[-1]))
    for start, a in zip(starts, arrays, strict=False):
        if dr.width(a):
            dr.scatter(out, a, dr.arange(mi.UInt32, dr.width(a)) + dr.opaque(mi.UInt32, int(start)))
    dr.eval(out)
    return out


@dr.syntax
def _numbered(pixel, hits, rays, end, order, count):
    # Every pixel writes the lanes of its own hits
    lanes, numbers = dr.empty(mi.UInt32, count), dr.empty(mi.UInt32, count)
    k = mi.UInt32(0)
    while k < hits:
        dr.scatter(lanes, pixel, end - hits + k)
        dr.scatter(numbers, order.number(k, hits, rays), end - hits + k)
        k += 1
    dr.eval(lanes, numbers)
    return lanes, numbers


def _placed(node) -> bool:
    return isinstance(node, (mi.Shape, mi.Sensor))


class Totals:
    """Sums of a render, one entry a pixel, on their way to the film."""

    def __init__(self, frame, film, pilot, decision, guided: bool):
        self.frame, self.film, self.pilot, self.decision = frame, film, pilot, decision
        # Of each half of a pixel's hits, side by side
        zeros = lambda n: [dr.zeros(mi.Float, 2 * frame.pixels) for _ in range(n)]  # noqa: E731
        self.colour, self.bright, self.straight = zeros(3), zeros(3), zeros(3)
        self.alpha = [dr.zeros(mi.Float, frame.pixels)]
        self.guided, self.alpha_wanted = guided, bool(mi.has_flag(film.flags(), mi.FilmFlags.Alpha))
        self.traced, self.spared, self.reflected = (dr.zeros(mi.UInt32, frame.pixels) for _ in range(3))
        self.plain = film.rfilter().is_box_filter() and not mi.has_flag(film.flags(), mi.FilmFlags.Special)
        self.block = None if self.plain else film.create_block()
        if self.block is not None:
            self.block.set_coalesce(False)
            self._put_pilot(1.0)

    def _put_pilot(self, share):
        value, _ = self._pilot()
        weight = self.decision.pilot_weight * share
        self.block.put(mi.Point2f(self.pilot.position), self._channels(value, self.pilot.alpha, weight))

    def double(self, grow) -> None:
        """Make room for as many hits again where ``grow``: what is there becomes the first half."""
        place = 2 * dr.arange(mi.UInt32, self.frame.pixels)
        for sums in (self.colour, self.bright, self.straight) if self.guided else (self.colour,):
            for total in sums:
                second = dr.gather(mi.Float, total, place + 1, grow)
                dr.scatter_add(total, second, place, grow)
                dr.scatter(total, mi.Float(0), place + 1, grow)
        d = self.decision
        d.hits = dr.select(grow, 2 * d.hits, d.hits)
        d.pilot_weight = weight_of_pilot(d.hits)
        dr.eval(d.hits, d.pilot_weight, self.colour, self.bright, self.straight)
        if self.block is not None:
            # Old and new halves weigh the same; only a pixel at its limit keeps a lower weight in the filter
            self.block.tensor()[:] = 0.5 * self.block.tensor()
            self._put_pilot(0.5)

    def _channels(self, colour, alpha, weight):
        # Unequal counts must not pull the filter towards busy pixels: each hit weighs one over its pixel's number
        out = [colour.x * weight, colour.y * weight, colour.z * weight]
        if self.alpha_wanted:
            out.append(alpha * weight)
        return out + [weight] + [mi.Float(0)] * (self.block.channel_count() - len(out) - 1)

    def add(self, index, s, hits) -> None:
        """Add hits to their pixels."""
        colour, bright, straight, hit, position, traced, spared, reflected = hits
        early = s < (dr.gather(mi.UInt32, self.decision.hits, index) >> 1)

        half = 2 * index + dr.select(early, mi.UInt32(0), mi.UInt32(1))

        def add(targets, values, place=index):
            for target, value in zip(targets, values, strict=True):
                dr.scatter_reduce(dr.ReduceOp.Add, target, value, place, True, dr.ReduceMode.Local)

        add(self.colour, colour, half)
        add([self.traced], [traced])
        # What is nought by construction is not added up
        if spared.state != dr.VarState.Literal:
            add([self.spared], [spared])
        if reflected.state != dr.VarState.Literal:
            add([self.reflected], [reflected])
        if self.guided:
            add(self.bright, bright, half)
            add(self.straight, straight, half)
        if self.alpha_wanted:
            add(self.alpha, [hit])
        if self.block is not None:
            share = 1 - dr.gather(mi.Float, self.decision.pilot_weight, index)
            share /= mi.Float(dr.gather(mi.UInt32, self.decision.hits, index))
            self.block.put(position, self._channels(colour, hit, share))
        extra = [self.block.tensor()] if self.block is not None else []
        counts = [self.traced, self.spared, self.reflected]
        dr.eval(self.colour, self.bright, self.straight, self.alpha, counts, *extra)

    def change(self, difference) -> None:
        """Add a difference to every pixel's colour; a wide filter sees it spread over the pixel, as its hits are."""
        if self.block is not None:
            corner = self.frame.corner(dr.arange(mi.UInt32, self.frame.pixels))
            part = difference / (SPREAD * SPREAD)
            rest = [mi.Float(0)] * (self.block.channel_count() - 3)
            for k in range(SPREAD * SPREAD):
                place = mi.Vector2f((k % SPREAD + 0.5) / SPREAD, (k // SPREAD + 0.5) / SPREAD)
                self.block.put(mi.Point2f(corner + place), [part.x, part.y, part.z, *rest])
                dr.eval(self.block.tensor())

    def _pilot(self):
        value = self.pilot.value + self.decision.mean * self.pilot.control + self.pilot.straight
        return value, self.pilot.straight

    def mix(self, pilot, sums):
        """Pool the pilot's estimate with the mean over the added hits."""
        w = self.decision.pilot_weight
        return pilot * w + sums * ((1 - w) / mi.Float(dr.maximum(self.decision.hits, 1)))

    def image(self):
        """Pixel estimates, as ``mi.Color3f``."""
        a, b = self._split(self.colour)
        return self.mix(self._pilot()[0], a + b)

    def _split(self, sums):
        place = 2 * dr.arange(mi.UInt32, self.frame.pixels)
        return [mi.Color3f([dr.gather(mi.Float, v, place + half) for v in sums]) for half in (0, 1)]

    def halves(self, sums=None):
        """Means over each half of a pixel's hits: of its colour, or of other sums that have halves."""
        hits = self.decision.hits
        low = hits >> 1
        a, b = self._split(self.colour if sums is None else sums)
        return a / mi.Float(dr.maximum(low, 1)), b / mi.Float(dr.maximum(hits - low, 1))

    def error(self):
        """Standard error a pixel and channel: from the difference of a pixel's halves, smoothed over its neighbours."""
        a, b = self.halves()
        image = self.image()
        known = dr.select(self.decision.hits >= 2, mi.Float(1), mi.Float(0))
        # Neighbours differ in brightness and hits; budgets make their relative errors alike
        level = dr.square(mi.luminance(image)) + 0.01
        # Halves of a net are worse than half as good, so their difference overstates the error of the whole
        scale = known / level * (0.25 * 2 ** (1 - RATE))
        squares = [dr.square(x - y) * scale for x, y in zip(a, b, strict=True)]
        near = window_sum(squares + [known], self.frame.width, self.frame.height, 1)
        count = near[3] + known
        guess = dr.square(self.decision.error) * dr.power(mi.Float(dr.maximum(self.decision.hits, 1)), -RATE)
        one = [dr.select(count > 0, (s + q) / dr.maximum(count, 1), guess) for s, q in zip(near[:3], squares, strict=True)]
        return mi.Color3f([dr.sqrt(v * level) for v in one])

    def relative_error(self, image, error) -> float:
        """Root of the image's expected mean relative squared error."""
        value = sum(dr.square(e) / (x * x + 0.01) for x, e in zip(image, error, strict=True)) / 3
        return float(np.sqrt(dr.mean(value)[0]))

    def layers(self, error):
        """Layers in the order of `aov_names`."""
        pilot = mi.Float(self.pilot.traced)
        return [
            mi.Float(self.decision.label),
            self.decision.mean,
            mi.Float(self.traced) + pilot,
            *error,
        ]

    def develop(self, image, layers):
        """Hand everything to the film and return its tensor."""
        if self.block is None:
            block = self.film.create_block()
            columns = list(image)
            if self.alpha_wanted:
                columns.append(self.mix(self.pilot.alpha, self.alpha[0]))
            columns += [mi.Float(1)] + layers
            block = self._filled(block, columns)
        else:
            block = self.block
            base = block.channel_count() - len(layers)
            shape = dr.shape(block.tensor())
            old = dr.reshape(block.tensor(), (shape[0] * shape[1], shape[2]))
            weight = mi.Float(dr.ravel(old[:, base - 1]))
            if layers:
                border = (shape[1] - self.frame.width) // 2
                columns = [mi.Float(dr.ravel(old[:, c])) for c in range(base)]
                columns += [self._padded(x, shape, border) * weight for x in layers]
                block = self._filled(block, columns)
        self.film.put_block(block)
        return self.film.develop()

    def _padded(self, layer, shape, border):
        index = dr.arange(mi.UInt32, shape[0] * shape[1])
        x = dr.clip(mi.Int32(index % shape[1]) - border, 0, self.frame.width - 1)
        y = dr.clip(mi.Int32(index // shape[1]) - border, 0, self.frame.height - 1)
        return dr.gather(mi.Float, layer, mi.UInt32(y * self.frame.width + x))

    def _filled(self, block, columns):
        count = len(columns)
        n = dr.width(block.tensor().array) // count
        data = dr.zeros(mi.Float, n * count)
        index = dr.arange(mi.UInt32, n) * count
        for c, column in enumerate(columns):
            dr.scatter(data, column, index + c)
        tensor = mi.TensorXf(data, dr.shape(block.tensor()))
        return mi.ImageBlock(tensor, block.offset(), block.rfilter(), block.has_border())

    def account(self, shading, named: bool):
        """Rays traced by kind, rays not traced by reason, and pixels by class."""
        total = lambda x: int(np.sum(x.numpy(), dtype=np.int64))  # noqa: E731
        d = self.decision
        planned = total(d.hits * d.rays) if shading.lights.count else 0
        rays = {
            "camera": total(d.hits) + self.frame.pixels * (1 + (self.pilot.probe_bright is not None)),
            "pilot": total(self.pilot.traced),
            "refinement": total(self.traced),
            "bsdf": total(self.reflected) + total(self.pilot.reflected),
        }
        label, hits = np.array(d.label), np.array(d.hits)
        missed = ~np.any(np.array(self.pilot.normal), axis=0)
        skipped = {
            "provably visible": total(self.spared),
            "no contribution": max(planned - total(self.spared) - rays["refinement"], 0),
            "pixels that missed": int(np.sum(missed & (hits == 0))),
            "pixels converged": int(np.sum(~missed & (hits == 0))),
        }
        if named:
            classes = {c.name.lower(): int(np.sum(label == int(c))) for c in VisibilityClass}
        else:
            full = int(np.sum(label == int(VisibilityClass.FULLY_VISIBLE)))
            none = int(np.sum(label == int(VisibilityClass.INVISIBLE)))
            classes = {"fully_visible": full, "invisible": none, "partial": self.frame.pixels - full - none}
        return rays, skipped, {k: v for k, v in classes.items() if v}
