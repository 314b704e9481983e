"""Registration of the plugins with the active Mitsuba variant."""

from __future__ import annotations

import mitsuba as mi

from ..errors import InputError


def register() -> None:
    """Register ``visdirect`` and ``vispath`` with the active variant.

    Scalar and polarised variants get plugins that say, when loaded, that they need another variant.
    """
    variant = mi.variant()
    if variant is None:
        return
    if variant.startswith("scalar") or "polarized" in variant or "_ad_" not in variant:
        for name in ("visdirect", "vispath"):
            mi.register_integrator(name, _refusal(name, variant))
        return
    # The base must come from this module, which set_variant reloads; its twin under mitsuba.ad goes stale
    from mitsuba.python.ad.integrators.common import ADIntegrator

    from .visdirect import define

    direct, path = define(ADIntegrator)
    mi.register_integrator("visdirect", lambda props: direct(props))
    mi.register_integrator("vispath", lambda props: path(props))


def _refusal(name: str, variant: str):
    def refuse(props):
        raise InputError(
            f"'{name}' needs an unpolarised llvm_ad_* or cuda_ad_* variant (got '{variant}'): "
            "call mitsuba.set_variant('llvm_ad_rgb')"
        )

    return refuse
