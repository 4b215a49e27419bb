"""One measured sweep on its sensor's own polar grid: what a reader of LiDAR-only data gives."""

from __future__ import annotations

from dataclasses import dataclass

from jaxsim.frame import PolarGrid, PolarImage


@dataclass(frozen=True)
class Sweep:
    """A whole turn (host memory)."""

    name: str
    scene: str
    """The recording."""
    image: PolarImage
    grid: PolarGrid
    time_s: float | None = None
