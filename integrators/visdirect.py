"""`visdirect` and `vispath`: direct light (and more) by visibility class."""

from __future__ import annotations

import time

import drjit as dr
import mitsuba as mi

from ..errors import InputError
from ..report import Report, peak_memory
from ..visibility import VisibilityClass
from . import assemble
from .camera import Frame
from .decide import allocate, decide
from .glints import glints
from .in_view import in_view, samples_of
from .pilot import pilot
from .shading import prepare
from .spend import spend

MOST = 2**31 - 1  # of rays in a pixel, and samples
CLASSIFIERS = ("mlp", "svm", "threshold")
PROBED = 4  # samples a pixel from which a second hit is looked at
AOVS = ["visibility.class", "visibility.fraction", "rays.shadow", "error.R", "error.G", "error.B"]


def choice(name: str, value, allowed) -> str:
    """Return ``value`` if it is one of ``allowed``; say so clearly otherwise."""
    if value not in allowed:
        raise InputError(f"'{name}' must be one of {', '.join(allowed)} (got '{value}')")
    return value


def number(name: str, value, low, high=None, whole=True):
    """Return ``value`` if it is a number, a whole one by default, in [low, high]; say so clearly otherwise."""
    real = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (real and low <= value < float("inf") and (high is None or value <= high) and (not whole or value == int(value))):
        bound = f">= {low} and finite" if high is None else f"in [{low}, {high}]"
        raise InputError(f"'{name}' must be {'a whole' if whole else 'a'} number {bound} (got {value})")
    return int(value) if whole else float(value)


def switch(name: str, value) -> bool:
    """Return ``value`` if it is a truth value; say so clearly otherwise."""
    if isinstance(value, str) or value not in (False, True):
        raise InputError(f"'{name}' must be true or false (got '{value}')")
    return bool(value)


def define(base):
    """Return the two integrator classes, derived from the active variant's ``ADIntegrator``."""

    class VisDirect(base):
        """Direct illumination that looks at the lights' visibility before it spends rays.

        Parameters
        ----------
        mode : str
            ``unbiased`` (default) or ``consistent`` (filters noisy penumbrae between pixels; error still vanishes
            with the budget).
        light_grid : int
            Light cells along each side, 2 to 4 (default 4).
        classifier : str
            ``mlp`` (default), ``svm`` or ``threshold``: names the configuration in the layers.
        threshold : float
            Stop where the estimated relative error of the image, the root of its mean relative squared error, is below
            this; 0 (default) spends the budget. ``spp`` stays the limit.
        max_rays : int
            Most shadow rays a pixel. Where it is not given: 512, or 32 a sample if that is more, so that busy pixels do
            not hold up a long render.
        refine : bool
            Visit undecided light cells more often (default false: it measured slower).
        aovs : bool
            Add the layers ``visibility.class``, ``visibility.fraction``, ``rays.shadow`` and ``error``.
        hide_emitters : bool
            As in Mitsuba.
        """

        path = False  # whether to go on beyond the first hit

        def __init__(self, props):
            self.mode = choice("mode", props.get("mode", "unbiased"), ("unbiased", "consistent"))
            self.grid = number("light_grid", props.get("light_grid", 4), 2, 4)
            self.classifier = choice("classifier", props.get("classifier", "mlp"), CLASSIFIERS)
            self.threshold = number("threshold", props.get("threshold", 0.0), 0, whole=False)
            self.limited = "max_rays" in props
            self.max_rays = number("max_rays", props.get("max_rays", 512), 1, MOST)
            self.refine = switch("refine", props.get("refine", False))
            self.aovs = switch("aovs", props.get("aovs", False))
            self.report = Report()
            props_depth = self._depth(props)
            super().__init__(props)
            self.depth = props_depth

        def _depth(self, props):
            for name in ("max_depth", "rr_depth"):
                if name in props:
                    raise InputError(f"'{name}' is no parameter of visdirect, which renders direct light only: use vispath")
            return 2

        def aov_names(self):
            return list(AOVS) if self.aovs else []

        def to_string(self):
            return (
                f"{type(self).__name__}[mode={self.mode}, light_grid={self.grid}, classifier={self.classifier}, "
                f"threshold={self.threshold}, max_rays={self.max_rays}, aovs={self.aovs}]"
            )

        def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
            if not develop:
                raise InputError("'develop' must be True (got False): the integrator returns a finished image")
            assemble.refuse_gradients(scene)
            if isinstance(sensor, int):
                if not 0 <= sensor < len(scene.sensors()):
                    raise InputError(f"'sensor' must be below the scene's {len(scene.sensors())} sensors (got {sensor})")
                sensor = scene.sensors()[sensor]
            spp = number("spp", spp or sensor.sampler().sample_count(), 1, MOST)
            with dr.suspend_grad():
                return self._render(scene, sensor, mi.UInt32(seed), spp)

        def sample(self, *_, **__):
            raise InputError(
                "this integrator renders whole images and cannot be inside another, such as 'aov' or 'moment': "
                "render it by itself, and the other layers apart"
            )

        def _render(self, scene, sensor, seed, spp):
            begin = time.perf_counter()
            clock = assemble.Clock()
            frame = Frame(sensor)
            film = sensor.film()
            if mi.has_flag(film.flags(), mi.FilmFlags.Special):
                raise InputError("'film' must have colour channels, such as hdrfilm (got one with channels of its own)")
            film.prepare(self.aov_names())
            shading = prepare(scene)
            shading.integrator, shading.grid, shading.hide = self, self.grid, self.hide_emitters
            shading.depth, shading.rr_depth, shading.path = self.depth, self.rr_depth, self.path
            dr.make_opaque(seed)

            # Look: one hit and up to four shadow rays a pixel, within a small share of the budget
            pilot_rays = 0 if not shading.lights.count else min(4, 2 * spp - 1, self.max_rays)
            probe = spp >= PROBED and shading.lights.count > 0
            look = pilot(shading, frame, seed, max(pilot_rays, 1), probe)
            aimed = samples_of(shading, sensor, 2 * spp * frame.pixels)
            if aimed:
                look.lamps, look.lamps_squared, traced = in_view(shading, frame, seed, aimed)
                look.traced += traced
            if look.shine is not None:
                look.glints = glints(shading, frame, look.shine)
            dr.eval(vars(look))
            clock.lap("pilot")

            # Decide
            shared = None
            if self.mode == "consistent" and shading.lights.count:
                # Not before it is needed: numba takes a while to load
                from . import consistent

                shared = consistent.Grid(frame, look)
            # Under a wide filter sharing takes away less
            trades = shared is not None and film.rfilter().is_box_filter()
            left = shared.left() if trades else 1.0
            refine = self.refine and shading.lambert
            alpha = look.alpha if mi.has_flag(film.flags(), mi.FilmFlags.Alpha) else None
            decision = decide(look, frame, self.classifier, self.grid, self.aovs, refine, left, alpha)
            dr.eval(vars(decision))
            # Without lights only outlines are worth rays
            wanted = shading.lights.count > 0 or alpha is not None
            budget = frame.pixels * max(2 * spp - 1 - pilot_rays - probe, 0) if wanted else 0
            budget = max(budget - aimed * shading.lights.count, 0)
            most = self.max_rays if self.limited else min(max(self.max_rays, 32 * spp), MOST)
            allocate(decision, frame, seed, budget, most, pilot_rays, self.threshold)
            if trades:
                # Where too few around are likely to have halves nothing is shared, and the whole error counts
                decision.need = dr.select(shared.shares(decision.hits), decision.need, decision.error)
                allocate(decision, frame, seed, budget, most, pilot_rays, self.threshold)
            dr.eval(decision.hits, decision.pilot_weight)
            clock.lap("classification")

            # Spend
            total = assemble.Totals(frame, film, look, decision, shared is not None)
            self._spend(total, shading, seed, decision.hits, dr.zeros(mi.UInt32, frame.pixels))
            image, error = total.image(), total.error()
            # Twice as many hits for as long as the error measured over the whole image is above the one wanted
            while self.threshold > 0 and total.relative_error(image, error) > self.threshold:
                done = mi.UInt32(decision.hits)
                grow = (done > 0) & (2 * done * decision.rays + pilot_rays <= most)
                cost = dr.sum(mi.Float(dr.select(grow, 2 * done, done)) * mi.Float(decision.rays + 1))[0]
                if cost > budget or not dr.any(grow):
                    break
                total.double(grow)
                self._spend(total, shading, seed, dr.select(grow, done, 0), done)
                image, error = total.image(), total.error()
            clock.lap("refinement")

            if shared is not None:
                smooth = consistent.smooth(total, image, shared)
                total.change(smooth - image)
                image = smooth
                dr.eval(image)
                clock.lap("filter")
            layers = total.layers(error) if self.aovs else []
            result = total.develop(image, layers)
            dr.eval(result)
            dr.sync_thread()
            clock.lap("film")
            self.report = self._account(total, shading, clock, begin, image, error)
            return result

        def _spend(self, total, shading, seed, hits, done):
            # ``hits`` more in each pixel, after ``done``
            d = total.decision
            for refine in (False, True) if self.refine else (False,):
                for index, s in assemble.batches(dr.select(d.refine == refine, hits, 0), d.rays):
                    s += dr.gather(mi.UInt32, done, index)
                    total.add(index, s, spend(shading, total.frame, seed, index, s, total.pilot, d, refine))

        def _account(self, total, shading, clock, begin, image, error):
            rays, skipped, classes = total.account(shading, self.aovs)
            return Report(
                wall_s=time.perf_counter() - begin,
                phases=clock.phases,
                rays=rays,
                skipped=skipped,
                classes=classes,
                memory_peak_bytes=peak_memory(),
                error=total.relative_error(image, error),
            )

        def _gradients(self):
            # Gradients are those of Mitsuba's path replay at the same depth: right inside, blind to silhouettes
            return mi.load_dict(
                {"type": "prb", "max_depth": self.depth, "rr_depth": self.rr_depth, "hide_emitters": self.hide_emitters}
            )

        def _refuse_layers(self):
            if self.aovs or self.mode == "consistent":
                raise InputError(
                    "'aovs' and mode 'consistent' have no derivatives: render with aovs=False and mode='unbiased'"
                )

        def render_forward(self, scene, params, sensor=0, seed=0, spp=0):
            self._refuse_layers()
            return self._gradients().render_forward(scene, params, sensor, seed, spp)

        def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0):
            self._refuse_layers()
            return self._gradients().render_backward(scene, params, grad_in, sensor, seed, spp)

    class VisPath(VisDirect):
        """`visdirect` at the first hit, path tracing beyond; takes Mitsuba's ``max_depth`` and ``rr_depth`` too."""

        path = True

        def _depth(self, props):
            depth = props.get("max_depth", -1)
            if not isinstance(depth, int) or not (2 <= depth <= MOST or depth == -1):
                raise InputError(f"'max_depth' must be -1 (no limit) or a whole number >= 2 and below 2**31 (got {depth})")
            return depth

    return VisDirect, VisPath


def names_of_classes() -> list[str]:
    """Names of the visibility configurations, in the order of their numbers."""
    return [c.name.lower() for c in VisibilityClass]


__all__ = ["AOVS", "CLASSIFIERS", "define", "names_of_classes"]
