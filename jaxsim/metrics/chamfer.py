"""Chamfer distances between two clouds, by k-d trees: exact, in memory that grows with the points alone.

A table of all distances of two scans of 120 000 points would have 14 billion entries.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

_Points = Float[np.ndarray, "_n d"]
LIDAR_ALPHA_PER_M2 = 1.0
"""Density-aware Chamfer's sharpness for clouds in metres: matches farther than about 1 m count as none. The
published 1000 is for objects of size 1."""


class Chamfer(NamedTuple):
    """Distances between two clouds, both directions averaged."""

    distance_m: float
    """Mean distance to the nearest point."""
    square_m2: float
    """Mean squared distance, as LiDAR-Diffusion has it (others add the directions: twice this)."""
    density_aware: float
    """0 (alike) to 1; see `chamfer`."""


def chamfer(a: _Points, b: _Points) -> Chamfer:
    """Chamfer distance and its density-aware form (Wu et al. 2021, eq. 6).

    There, a point x whose nearest is y counts 1 - exp(-alpha |x - y|^2) s / n(y), with n(y) the points that share y
    and s the ratio of both clouds' sizes: a cloud that clumps where the other is even is far from it. Raises
    ValueError for empty clouds.
    """
    for cloud in (a, b):
        if len(cloud) == 0:
            raise ValueError("chamfer: a cloud is empty; leave the frame out")
        if not np.isfinite(cloud).all():
            raise ValueError("chamfer: a cloud has points that are not finite; leave them out")
    trees = KDTree(np.asarray(a, np.float64)), KDTree(np.asarray(b, np.float64))
    means = []
    for tree, partner in (trees, trees[::-1]):
        distance, nearest = partner.query(tree.data)
        square = distance**2
        # n(y): how many points of this cloud have the same nearest point in the other.
        shared = np.bincount(nearest, minlength=partner.n)[nearest]
        # s = tree.n / partner.n is what n(y) is where this cloud is spread evenly over the other.
        density = np.mean(1 - np.exp(-LIDAR_ALPHA_PER_M2 * square) / shared * (tree.n / partner.n))
        means.append((distance.mean(), square.mean(), density))
    return Chamfer(*(float(one + other) / 2 for one, other in zip(*means, strict=True)))
