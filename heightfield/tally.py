"""How often a method looked at the surface, beside the naive method that looks at all of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Tally:
    """Sums over directions.

    Attributes
    ----------
    looked : int
        Crossings with the surface that were looked at, corners of hulls and samples of lines included.
    naive : int
        What the naive method looks at (§1): all crossings up to the border, or up to the radius.
    rays : float
        Points times directions.
    """

    looked: int = 0
    naive: int = 0
    rays: float = 0

    def add(self, looked: int, naive: int, rays: float) -> None:
        """Add what another direction, or another method, took."""
        self.looked, self.naive, self.rays = self.looked + int(looked), self.naive + int(naive), self.rays + rays

    def __str__(self) -> str:
        ours, theirs = self.looked / self.rays, self.naive / self.rays
        return f"{ours:.3g} iterations a point and direction, {theirs:.3g} by the naive method"
