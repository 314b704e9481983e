"""Single figures of the direct-light benchmark: light noise, penumbra share, peak memory."""

from __future__ import annotations

import subprocess
import sys
from unittest.mock import patch

import mitsuba as mi
import numpy as np

from .direct_runs import Setup, image, visdirect

_MEMORY = """
import sys
import intervis, intervis.scenes
import mitsuba as mi
from intervis.report import peak_memory
mi.set_variant(sys.argv[2])
scene = mi.load_dict(intervis.scenes.load(sys.argv[1], width=1280, height=720))
image = mi.load_dict({"type": "visdirect"}).render(scene, seed=1, spp=64)
print(peak_memory())
"""


def light_noise(s: Setup, spp: int = 64) -> dict[str, float]:
    """Measure the noise that light sampling leaves where the light is fully visible.

    Camera rays go through pixel centres here: the picture's own variation within a pixel is no light noise.

    Returns
    -------
    dict
        ``noise``: largest relative difference between two seeds over all lit pixels; ``jittered``: the same with
        camera rays anywhere in their pixels; ``shadow_rays``: a pixel.
    """
    from intervis.integrators import camera

    def largest():
        run = visdirect(s, "unbiased", spp)
        a, b = (image(run.render(seed)[0]) for seed in (1, 2))
        lit = np.minimum(a, b) > 1e-6 * a.max()
        rays = run.render(3)[1].report.rays
        difference = np.abs(a - b)[lit] / (0.5 * (a + b))[lit]
        return float(difference.max()), (rays["pilot"] + rays["refinement"]) / s.pixels

    jittered, shadow_rays = largest()
    with patch.object(camera, "net_high", lambda i, s0, s1: mi.Point2f(0.5, 0.5)):
        noise, _ = largest()
    return {"noise": noise, "jittered": jittered, "shadow_rays": shadow_rays}


def penumbra_share(s: Setup) -> float:
    """Share of pixels whose visible light fraction lies between 0.01 and 0.99."""
    tensor, integrator = visdirect(s, "unbiased", 64, aovs=True).render(5)
    names = integrator.aov_names()
    fraction = np.array(tensor)[..., names.index("visibility.fraction") - len(names)]
    return float(np.mean((fraction > 0.01) & (fraction < 0.99)))


def peak_memory(name: str) -> float:
    """Peak resident bytes of a fresh process that renders a scene at 1280×720 with 64 samples a pixel.

    Infinite where the process died: a render that fails has not met any limit.
    """
    command = [sys.executable, "-c", _MEMORY, name, mi.variant()]
    out = subprocess.run(command, capture_output=True, text=True)
    if out.returncode:
        last = (out.stderr.strip().splitlines() or ["no message"])[-1]
        print(f"{name} at 1280×720: the render failed with status {out.returncode}: {last}", file=sys.stderr)
        return float("inf")
    return float(out.stdout.split()[-1])
