"""What a prediction must beat: averages of the training frames, and the frame before.

A baseline guesses one intensity a group (all cells, a class, a row), and guesses that the group drops where
more than half of its training cells dropped.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.metrics.paired import DROP_BELOW


class GroupMeans(NamedTuple):
    """What a group of cells does on average."""

    intensity: Float[np.ndarray, " groups"]
    """Mean over the group's returns, 0..1."""
    drops: Bool[np.ndarray, " groups"]
    """Most of the group's cells drop."""


def group_means(
    frames: Iterable[
        tuple[
            Float[np.ndarray, "rows columns"],
            Bool[np.ndarray, "rows columns"],
            Bool[np.ndarray, "rows columns"],
            Int[np.ndarray, "rows columns"],
        ]
    ],
    groups: int,
) -> GroupMeans:
    """Averages of the training frames: (intensity 0..1, returned, cells that count, group 0..groups-1) each.

    A group never seen in training takes the mean of all cells. Raises ValueError where no cell counts.
    """
    total = np.zeros(groups)
    count = np.zeros(groups)
    drops = np.zeros(groups)
    seen = np.zeros(groups)
    for intensity, returned, counts, group in frames:
        both = returned & counts
        total += np.bincount(group[both], intensity[both], groups)
        count += np.bincount(group[both], minlength=groups)
        dropped = counts & (~returned | (intensity < DROP_BELOW))
        drops += np.bincount(group[dropped], minlength=groups)
        seen += np.bincount(group[counts], minlength=groups)
    if not count.sum():
        raise ValueError("baselines: no training cell is both seen by the camera and returned")
    overall = total.sum() / count.sum()
    return GroupMeans(np.where(count > 0, total / np.maximum(count, 1), overall), drops > 0.5 * seen)
