"""Mitsuba integrators that look at visibility first."""

from .register import register

__all__ = ["register"]
