"""Chamfer distances between two clouds, by k-d trees: exact, in memory that grows with the points alone.

A table of all distances of two scans of 120 000 points would have 14 billion entries.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

Points = Float[np.ndarray, "_n d"]
LIDAR_ALPHA_PER_M2 = 1.0
"""Density-aware Chamfer's sharpness for clouds in metres: matches farther than about 1 m count as none. The
published 1000 is for objects of size 1."""


class Nearest(NamedTuple):
    """From each point of one cloud to the nearest of the other."""

    square: Float[np.ndarray, " n"]
    index: np.ndarray


def _nearest(a: Points, b: Points) -> tuple[Nearest, Nearest]:
    for cloud in (a, b):
        if len(cloud) == 0:
            raise ValueError("chamfer: a cloud is empty; leave the frame out")
        if not np.isfinite(cloud).all():
            raise ValueError("chamfer: a cloud has points that are not finite; leave them out")
    first = KDTree(np.asarray(a, np.float64))
    second = KDTree(np.asarray(b, np.float64))
    (d1, i1), (d2, i2) = second.query(first.data), first.query(second.data)
    return Nearest(d1**2, np.asarray(i1)), Nearest(d2**2, np.asarray(i2))


class Chamfer(NamedTuple):
    """Distances between two clouds, both directions averaged."""

    distance_m: float
    """Mean distance to the nearest point."""
    square_m2: float
    """Mean squared distance, as LiDAR-Diffusion has it (others add the directions: twice this)."""
    density_aware: float
    """0 (alike) to 1; see `chamfer`."""


def chamfer(a: Points, b: Points) -> Chamfer:
    """Chamfer distance and its density-aware form (Wu et al. 2021, eq. 6).

    There, a point x whose nearest is y counts 1 - exp(-alpha |x - y|^2) s / n(y), with n(y) the points that share y
    and s the ratio of both clouds' sizes: a cloud that clumps where the other is even is far from it. Raises
    ValueError for empty clouds.
    """
    to_b, to_a = _nearest(a, b)

    def density(near: Nearest, here: int, there: int) -> float:
        shared = np.bincount(near.index, minlength=there)[near.index]
        return float(np.mean(1 - np.exp(-LIDAR_ALPHA_PER_M2 * near.square) / shared * (here / there)))

    return Chamfer(
        distance_m=float(np.sqrt(to_b.square).mean() + np.sqrt(to_a.square).mean()) / 2,
        square_m2=float(to_b.square.mean() + to_a.square.mean()) / 2,
        density_aware=(density(to_b, len(a), len(b)) + density(to_a, len(b), len(a))) / 2,
    )
