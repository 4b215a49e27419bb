"""Whether two polar grids are one, and points filled up to few sizes."""

from __future__ import annotations

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Cloud, PolarGrid

SAME = 1e-4
"""Grids are one where rays differ by no more, in rad and, of their origins, in m: a centimetre at 100 m, a tenth of
the finest sensor's steps, and far above the rounding of angles that other programs wrote with six digits."""
POINTS = 2**15
"""Clouds are filled up to multiples of this, so that kernels are compiled once and not for every frame."""


def grid_difference(a: PolarGrid, b: PolarGrid) -> str:
    """In words, the first thing in which two grids differ by more than SAME; empty where they are one grid."""
    for name in ("azimuth_rad", "elevation_rad", "origin_m"):
        first = np.asarray(getattr(a, name))
        second = np.asarray(getattr(b, name))
        if first.shape != second.shape:
            return f"{name} ({first.size} and {second.size} values)"
        if not np.allclose(first, second, rtol=0, atol=SAME):
            return f"{name} (up to {np.abs(first - second).max():.4g} apart)"
    return ""


def same_grid(a: PolarGrid, b: PolarGrid) -> bool:
    """Whether two grids have the same rays: angles and origins, to SAME."""
    return not grid_difference(a, b)


def pad_cloud(cloud: Cloud, multiple: int = POINTS) -> Cloud:
    """The cloud (n points, host memory) with invalid points behind it, filled up to a multiple."""
    missing = -cloud.intensity.shape[-1] % multiple
    return jax.tree.map(lambda leaf: np.pad(leaf, [(0, missing), *[(0, 0)] * (leaf.ndim - 1)]), cloud)


def pad_points(
    points: Float[np.ndarray, "n c"], room: int
) -> tuple[Float[np.ndarray, "room c"], Bool[np.ndarray, " room"]]:
    """Points with zeros behind them, and which of them are real; `room` is n or more."""
    padded = np.zeros((room, points.shape[1]), np.float32)
    padded[: len(points)] = points
    return padded, np.arange(room) < len(points)


def room_for(points: int, multiple: int = POINTS) -> int:
    """The least multiple, one at least, that holds so many points."""
    return max(-(-points // multiple), 1) * multiple
