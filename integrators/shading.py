"""A scene as it is lit: its lights and materials, looked at once; and shading points, which are asked for light samples."""

from __future__ import annotations

import re
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from .clusters import ascend, descend
from .collect import collect
from .glints import GLASS, SHARP
from .lights import Lights, any_close, importance
from .proof import collect_blockers
from .rectangle import Rectangle
from .skylight import SLANT


@dataclass
class Shading:
    """What is known about a scene before the first ray, and how it is to be lit.

    Attributes
    ----------
    scene : mi.Scene
    lights : Lights
    lambert : bool
        Every surface is a plain (one- or two-sided) ``diffuse``.
    closed : bool
        The only light is a constant rectangle: on Lambertian surfaces unshadowed light has a closed form.
    plain : mi.Bool or None
        Which BSDFs are Lambertian, by what Mitsuba's registry numbers them, where ``closed`` but not all are.
    bumpy : mi.Bool or None
        Which have normals of their own, by a normal or a bump map, if any.
    blockers : Blockers or None
        What may stand before that rectangle, if it is simple enough to tell where nothing does.
    follows : bool
        BSDF samples are needed next to light samples: a surface is glossy, or may be close to a light.
    integrator : mi.Integrator
    grid : int
        Light cells along each side.
    depth, rr_depth : int
        Mitsuba's ``max_depth`` (2: direct light only) and ``rr_depth``.
    hide : bool
        Do not show emitters to the camera.
    path : bool
        Follow paths beyond the first hit, with ``path``'s conventions of what covers a pixel.
    """

    scene: object
    lights: Lights
    lambert: bool
    closed: bool
    plain: object = None
    bumpy: object = None
    blockers: object = None
    follows: bool = False
    integrator: object = None
    grid: int = 4
    depth: int = 2
    rr_depth: int = 5
    hide: bool = False
    path: bool = False


def _is_lambertian(bsdf) -> bool:
    text = str(bsdf)
    sides = re.findall(r"brdf\[\d\] = (.*)", text) if text.startswith("TwoSided") else [text]
    return bool(sides) and all(re.match(r"SmoothDiffuse\b", side) for side in sides)


def _registered(pointers) -> np.ndarray:
    # What Mitsuba's registry numbers objects, at which kernels look things up
    return np.array(dr.reinterpret_array(mi.UInt32, pointers))


def prepare(scene) -> Shading:
    """Look at a scene's lights and materials once."""
    lights = collect(scene)
    bsdfs = [s.bsdf() for s in scene.shapes()]
    lambertian = [b is not None and _is_lambertian(b) for b in bsdfs]
    lambert = all(lambertian)
    closed = any(lambertian) and lights.rectangle is not None and not mi.is_spectral
    plain = _table(bsdfs, lambertian) if closed and not lambert else None
    bumpy = _table(bsdfs, [b is not None and re.search(r"(Normal|Bump)Map\[", str(b)) is not None for b in bsdfs])
    blockers = collect_blockers(scene, lights.emitters[0]) if closed else None
    return Shading(scene, lights, lambert, closed, plain, bumpy, blockers, not lambert or lights.touched)


def _table(bsdfs: list, chosen: list):
    """Return which of Mitsuba's registry numbers are those of the BSDFs that were chosen; None if none were."""
    numbers = {int(_registered(mi.BSDFPtr(b))[0]) for b, it_is in zip(bsdfs, chosen, strict=True) if it_is}
    return mi.Bool([k in numbers for k in range(max(numbers) + 1)]) if numbers else None


def _lambert(si, bsdf, active):
    """Albedo over π and the side the viewer is on (0 where a one-sided surface is seen from behind)."""
    cos = mi.Frame3f.cos_theta(si.wi)
    both = mi.has_flag(bsdf.flags(), mi.BSDFFlags.BackSide)
    side = dr.select(cos > 0, mi.Float(1), dr.select(both & (cos < 0), mi.Float(-1), mi.Float(0)))
    return bsdf.eval_diffuse_reflectance(si, active) * dr.inv_pi, side


def _is_in(table, bsdf):
    number = dr.reinterpret_array(mi.UInt32, bsdf)
    return dr.gather(mi.Bool, table, number, number < dr.width(table))


class Surface:
    """A shading point, ready to be asked for the unshadowed integrand of a light sample."""

    def __init__(self, shading: Shading, si, active, mis_samples=0):
        self.shading, self.si = shading, si
        self.guide, self.tile = None, None  # where of the sky something is seen, and from where
        self.bsdf = si.bsdf()
        self.rays_per_hit = mi.Float(mis_samples)
        if shading.lambert:
            self.plain, self.transmits, self.specular = mi.Bool(True), mi.Bool(False), mi.Bool(False)
        else:
            flags = self.bsdf.flags()
            self.plain = mi.Bool(False) if shading.plain is None else active & _is_in(shading.plain, self.bsdf)
            # Not what only lets rays pass, such as masks: light samples do not
            diffuse = mi.has_flag(flags, mi.BSDFFlags.DiffuseTransmission)
            self.transmits = diffuse | mi.has_flag(flags, mi.BSDFFlags.GlossyTransmission)
            self.matt = diffuse | mi.has_flag(flags, mi.BSDFFlags.DiffuseReflection)
            self.specular = active & (mi.has_flag(flags, mi.BSDFFlags.Glossy) | mi.has_flag(flags, mi.BSDFFlags.Delta))
        self.active, self.follow = active, self.specular
        self.slant = 0.0 if shading.lambert else dr.opaque(mi.Float, SLANT)
        if shading.lambert or shading.plain is not None:
            self.albedo, self.side = _lambert(si, self.bsdf, active & self.plain)
            self.active = active & (~self.plain | (self.side != 0))
        if not shading.lambert:
            self.active = self.active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
        if shading.lights.touched:
            self.follow = self.follow | (self.active & any_close(shading.lights, si.p))

    def sample(self, l, u, active):
        """Sample a direction towards light number ``l``: as `Lights.sample`, but skies with regard for the surface."""
        lights, sky = self.shading.lights, self.shading.lights.sky
        if sky is None:
            return lights.sample(self.si, l, u, active)
        here, density = active & (l == sky.index), mi.Float(1)
        if self.guide is not None:
            u, density = self.guide.warp(self.tile, u, here)
        if sky.even:
            ds, weight = sky.around(self.si, self.facing(), self.transmits, self.slant, u, here)
            if lights.count > 1:
                other, brightness = lights.sample(self.si, l, u, active & ~here)
                ds, weight = dr.select(here, ds, other), dr.select(here, weight, brightness)
        else:
            # Mitsuba's samples, from warped numbers
            v, warped = sky.warp(self.facing(), self.transmits, u, here)
            ds, weight = lights.sample(self.si, l, dr.select(here, v, u), active)
            density *= dr.select(here, warped, 1)
        ds.pdf = dr.select(here, self.towards_sky(ds.d, ds.pdf), ds.pdf)
        return ds, weight / density

    def towards_sky(self, d, pdf):
        """Density of light samples towards a direction of the sky, which Mitsuba samples with density ``pdf``.

        Weights of light and BSDF samples add up to one whatever it is, as both are by it: it need not be exact.
        """
        p = self.shading.lights.sky.density(self.facing(), self.transmits, self.slant, d, pdf)
        return p if self.guide is None else p * dr.gather(mi.Float, self.guide.share, self.tile)

    def facing(self):
        """Shading normal on the viewer's side."""
        return dr.mulsign(self.si.sh_frame.n, mi.Frame3f.cos_theta(self.si.wi))

    def integrand(self, ds, weight, probability, active):
        """Unshadowed integrand over density, and where it can be non-zero."""
        wo = self.si.to_local(ds.d)
        if not self.shading.lambert:
            f, pdf = self.bsdf.eval_pdf(mi.BSDFContext(), self.si, wo, active & ~self.plain)
        if self.shading.lambert or self.shading.plain is not None:
            cos = dr.maximum(wo.z * self.side, 0)
            g, q = self.albedo * cos, cos * dr.inv_pi
            f, pdf = (g, q) if self.shading.lambert else (dr.select(self.plain, g, f), dr.select(self.plain, q, pdf))
        if self.shading.follows:
            # Balance heuristic against one BSDF sample a hit; points and directions cannot be hit by chance
            p = self.rays_per_hit * probability * ds.pdf
            f *= dr.select(ds.delta | ~self.follow, 1.0, p / dr.maximum(p + pdf, 1e-30))
        rho = f * weight / probability
        active = active & (ds.pdf > 0) & dr.any(rho != 0)
        return dr.select(active & dr.all(dr.isfinite(rho)), rho, 0), active

    def rectangle(self):
        """Return the rectangle light as this point sees it."""
        return Rectangle(self)

    def visible(self, p, active):
        """Trace a shadow ray to a point."""
        return active & ~self.shading.scene.ray_test(self.si.spawn_ray_to(p), active)

    @dr.syntax
    def reflect(self, s1, s2, active):
        """Follow one BSDF sample to a light.

        Returns
        -------
        value : mi.Spectrum
            Its weighted radiance.
        l : mi.UInt32
            The light's number.
        pdf, density : mi.Float
            Of BSDF and light samples.
        traced : mi.Bool
        lobe : tuple
            How the surface shines: density, strength and normal of the lobe.
        """
        scene, si = self.shading.scene, self.si
        sample, weight = self.bsdf.sample(mi.BSDFContext(), si, s1, s2, active)
        followed = active & dr.any(weight != 0)
        active = mi.Bool(followed)
        next_si = scene.ray_intersect(si.spawn_ray(si.to_world(sample.wo)), active)
        emitter = next_si.emitter(scene, active)
        ds = mi.DirectionSample3f(scene, next_si, si)
        if dr.hint(self.shading.path and self.shading.hide, mode="scalar"):
            # An environment that is hidden stays so behind surfaces passed straight through
            active &= next_si.is_valid() | ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
        value = dr.select(active & (emitter != None), weight * emitter.eval(next_si, active), 0)  # noqa: E711
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        density = emitter.pdf_direction(si, ds, active & ~delta)
        if dr.hint(self.shading.lights.sky is not None, mode="scalar"):
            density = dr.select(next_si.is_valid(), density, self.towards_sky(ds.d, density))
        lights, l = self.shading.lights, mi.UInt32(0)
        if dr.hint(lights.count > 1, mode="scalar"):
            l = lights.index(emitter, next_si.prim_index)
        if dr.hint(lights.parts is not None, mode="scalar"):
            density *= dr.gather(mi.Float, lights.parts.share, l)
        # Density and strength of the lobe, if it mirrors. A mirror's density is the chance that it was chosen: low for glass
        mirrored = followed & (sample.wo.z * si.wi.z > 0)
        glass = followed & mi.has_flag(self.bsdf.flags(), mi.BSDFFlags.DeltaReflection)
        lobe = dr.select(glass, SHARP, dr.select(mirrored, sample.pdf, 0))
        strength = dr.max(mi.unpolarized_spectrum(weight)) * dr.select(delta, sample.pdf, 1)
        strength = dr.maximum(dr.select(mirrored, strength, 0), dr.select(glass, GLASS, 0))
        n = mi.Vector3f(self.facing())
        if dr.hint(self.shading.bumpy is not None, mode="scalar"):
            # The normal that it mirrored by
            half = dr.normalize(si.to_world(sample.wo + si.wi))
            n = dr.select(mirrored & _is_in(self.shading.bumpy, self.bsdf), half, n)
        return value, l, sample.pdf, dr.select(delta, 0, density), active, (lobe, strength, n)

    def importance(self, k):
        """What a top, or any cluster of lights, might add."""
        return importance(self.shading.lights, k, self.si.p, self.facing(), self.transmits, self.specular)

    def find(self, top, u, active):
        """Choose a light below a top: its number, its chance, and what is left of the random number ``u``."""
        clusters = self.shading.lights.clusters
        return (top, mi.Float(1), u) if clusters is None else descend(clusters, self.importance, top, u, active)

    def found(self, l, active):
        """Return the top that light ``l`` is below, and its chance there."""
        clusters = self.shading.lights.clusters
        return (l, mi.Float(1)) if clusters is None else ascend(clusters, self.importance, l, active)
