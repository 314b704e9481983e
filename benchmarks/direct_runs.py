"""Renders of the direct-light benchmark: configurations, references, and warm interleaved timing."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, field
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

import intervis.scenes
from intervis.integrators.shading import prepare

SAMPLERS = ("independent", "multijitter", "ldsampler")
EMITTER_SAMPLES = (1, 4)
LADDER = (4, 8, 16, 32, 64, 128, 256, 512)
CHUNK = 1024  # samples a pixel of one reference render


@dataclass
class Setup:
    """A scene ready to be rendered by every competitor, and what its renders are compared with."""

    name: str
    scene: object
    sensors: dict
    diffuse: bool
    pixels: int
    reference: np.ndarray | None = None
    reference_error: float = 0.0


@dataclass
class Run:
    """One configuration and what its repeats measured."""

    family: str  # "mitsuba", "unbiased" or "consistent"
    setting: str
    budget: int  # samples a pixel (spp)
    render: object  # callable of a seed, returns the image and its integrator
    times: list = field(default_factory=list)
    errors: list = field(default_factory=list)
    rays: float = 0.0  # a pixel
    overhead: list = field(default_factory=list)  # share of time in pilot and classification
    kinds: dict = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name for tables and legends."""
        return f"direct {self.setting}" if self.family == "mitsuba" else f"visdirect {self.family}"


def setup(name: str, width: int, height: int) -> Setup:
    """Load a built-in scene with one sensor for each competing sampler."""
    description = intervis.scenes.load(name, width=width, height=height)
    key = next(k for k, v in description.items() if isinstance(v, dict) and "film" in v)
    scene = mi.load_dict(description)
    sensor = {k: v for k, v in description[key].items() if k != "sampler"}
    sensors = {s: mi.load_dict({**sensor, "sampler": {"type": s}}) for s in SAMPLERS}
    return Setup(name, scene, sensors, prepare(scene).lambert, width * height)


def image(tensor) -> np.ndarray:
    """Return the colour channels of a render as an array (H, W, 3)."""
    return np.array(tensor)[..., :3]


def direct(s: Setup, sampler: str, emitter_samples: int, spp: int, **extra) -> Run:
    """Make a configuration of Mitsuba's, with so many emitter samples for each of ``spp`` camera rays."""
    bsdf_samples = extra.pop("bsdf_samples", 0 if s.diffuse else 1)
    integrator = mi.load_dict({"type": "direct", "emitter_samples": emitter_samples, "bsdf_samples": bsdf_samples, **extra})
    render = lambda seed: (integrator.render(s.scene, s.sensors[sampler], seed=seed, spp=spp), None)  # noqa: E731
    rays = spp * (1 + emitter_samples + bsdf_samples)
    label = f"{sampler} ×{emitter_samples}" + (" + BSDF" if s.diffuse and bsdf_samples else "")
    return Run("mitsuba", label, spp, render, rays=rays)


def visdirect(s: Setup, mode: str, spp: int, **extra) -> Run:
    """Make a configuration of our integrator."""
    integrator = mi.load_dict({"type": "visdirect", "mode": mode, **extra})

    def render(seed):
        return integrator.render(s.scene, s.sensors["independent"], seed=seed, spp=spp), integrator

    return Run(mode, mode, spp, render)


def relmse(x: np.ndarray, s: Setup) -> float:
    """Relative mean squared error with the reference's own share taken off."""
    ref = s.reference
    raw = float(np.mean((x - ref) ** 2 / (ref**2 + 0.01)))
    return max(raw - s.reference_error, 0.02 * raw)


def measure(s: Setup, run: Run, seed: int, keep: bool = True) -> float:
    """Render once, wait for the result, and return its error; ``keep`` stores time and error in the run."""
    dr.sync_thread()
    begin = time.perf_counter()
    tensor, integrator = run.render(seed)
    dr.eval(tensor)
    dr.sync_thread()
    seconds = time.perf_counter() - begin
    error = relmse(image(tensor), s)
    if keep:
        run.times.append(seconds)
        run.errors.append(error)
        if integrator is not None:
            phases = integrator.report.phases
            early = phases.get("pilot", 0) + phases.get("classification", 0)
            run.overhead.append(early / max(sum(phases.values()), 1e-12))
            run.kinds = integrator.report.rays
            run.rays = sum(run.kinds.values()) / s.pixels
    return seconds * error


def fingerprint(s: Setup, spp: int) -> str:
    """Hash of everything in the scene, so that a cached reference cannot outlive a change of it."""
    digest = hashlib.sha256(f"{mi.__version__} {mi.variant()} {spp} {s.sensors['multijitter']}".encode())
    for key, value in sorted(mi.traverse(s.scene), key=lambda item: item[0]):
        digest.update(key.encode())
        if key.endswith("vertex_normals"):
            continue  # sums over faces, in any order: the last bits vary
        try:
            # A transform's array would hold its address
            digest.update(np.ascontiguousarray(np.array(getattr(value, "matrix", value))).tobytes())
        except (TypeError, ValueError, RuntimeError):
            digest.update(str(value).encode())
    digest.update(str([type(b).__name__ + str(b) for b in (x.bsdf() for x in s.scene.shapes())]).encode())
    return digest.hexdigest()[:16]


def add_reference(s: Setup, cache: Path, spp: int) -> None:
    """Set the scene's reference and its own expected error, from the cache if it has been rendered before."""
    file = cache / f"{s.name}-{fingerprint(s, spp)}.npy"
    if file.exists():
        halves = np.load(file)
    else:
        run = direct(s, "multijitter", 1, min(spp // 4, CHUNK))
        chunks = spp // run.budget
        renders = [image(run.render(900_001 + c)[0]).astype(np.float64) for c in range(chunks)]
        halves = np.array([np.mean(renders[::2], axis=0), np.mean(renders[1::2], axis=0)])
        cache.mkdir(parents=True, exist_ok=True)
        np.save(file, halves)
    s.reference = halves.mean(0)
    # The mean of two independent halves has a quarter of the variance of their difference
    s.reference_error = float(np.mean((halves[0] - halves[1]) ** 2 / 4 / (s.reference**2 + 0.01)))


def compete(s: Setup, repeats: int, ladder=LADDER, budgets=(16, 64, 256)) -> list[Run]:
    """Measure all competitors on a scene: warm and interleaved, dominated ones dropped at last.

    Returns
    -------
    list of Run
    """
    settings = [(sampler, e) for sampler in SAMPLERS for e in EMITTER_SAMPLES]
    runs = [direct(s, *setting, b) for b in budgets[:-1] for setting in settings]
    product = {}
    for run in runs:
        measure(s, run, 1, keep=False)
        if run.budget == budgets[-2]:
            product[run.setting] = measure(s, run, 2, keep=False)

    # The dearest budget only where it can matter: the two best settings, and independent sampling
    best = sorted(product, key=product.get)[:2]
    last = [direct(s, *x, budgets[-1]) for x in settings if f"{x[0]} ×{x[1]}" in {*best, "independent ×1"}]
    target = np.inf
    for run in last:
        probe = warm_error(s, run)
        if run.setting in best:
            target = min(target, probe)
    runs += last

    # Our ladder goes on until it has passed the hardest target
    for mode in ("unbiased", "consistent"):
        for spp in ladder:
            run = visdirect(s, mode, spp)
            error = warm_error(s, run)
            runs.append(run)
            if spp >= 64 and error < 0.9 * target:
                break
    for r in range(repeats):
        for k, run in enumerate(runs):
            measure(s, run, 10_000 + 1000 * k + r)
    return runs


def warm_error(s: Setup, run: Run) -> float:
    """Render once so that the kernels are compiled, and return the error."""
    return relmse(image(run.render(1)[0]), s)
