"""Visibility-first rendering for Mitsuba 3."""

from importlib.metadata import version

from .errors import InputError
from .report import Report
from .startup import start

__all__ = ["InputError", "Report", "__version__"]
__version__ = version("intervis")

start()
