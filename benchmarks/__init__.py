"""Measurements of what the package is worth, each run as ``python -m benchmarks.NAME``."""
