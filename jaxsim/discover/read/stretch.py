"""How far all measured ranges are too long, beside where the sensor stood.

A sensor that looks ahead alone can hardly tell ranges that are all a hundredth too long from a place that lies behind:
both lengthen what is far off. What is near tells them apart, so both are fitted together, and a motion is looked for in
ranges of the right length.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.read.motion import COARSE, FINAL_STEPS, MOUNTED, NOISE_M, half_widths, linear, normal_equations
from jaxsim.discover.read.registration import NUMBERS, Motion, RegisteredSides, turned
from jaxsim.discover.rules import RULES

STRETCH_SD = 0.03
"""Of the prior: what is wrong by more is another unit."""


class Stretch(NamedTuple):
    """By which share measured ranges are too long, and the half width of its interval."""

    share: float
    half: float

    @property
    def sure(self) -> bool:
        """Whether scenes agree that there is one which is no noise."""
        return bool(abs(self.share) - self.half > RULES.stretched)


def shrunk(sides: RegisteredSides, share: float) -> RegisteredSides:
    """Gives sides whose measured ranges are shorter by a share."""
    return replace(sides, range_m=sides.range_m / (1 + share))


def stretch_of(sides: RegisteredSides, scene: Int[np.ndarray, " f"]) -> Stretch:
    """Fits the stretch of all frames' ranges together with one motion of the sensor, as `motion.climb` does the motion
    alone; `scene` numbers the scene of each frame, between which it scatters."""
    motion = np.zeros((1, NUMBERS))
    numbers = MOUNTED.numbers
    share = 0.0
    prior = np.diag([*np.diag(MOUNTED.precision), (NOISE_M / STRETCH_SD) ** 2])
    for width in [*COARSE, *[COARSE[-1]] * FINAL_STEPS]:
        matrix, right = _equations(sides, motion, share, width=width)
        pulled = right.sum(0) - prior @ np.append(motion[0, numbers], share)
        step = np.linalg.solve(matrix.sum(0) + prior, pulled)
        # Turns are small enough here for their vectors to add up.
        motion[0, numbers] += step[:-1]
        share = float(share + step[-1])
    matrix, right = _equations(sides, motion, share, width=COARSE[-1])
    return Stretch(share, float(half_widths(matrix.sum(0) + prior, right, scene)[-1]))


def _equations(
    sides: RegisteredSides, motion: Motion, share: float, *, width: float
) -> tuple[Float[np.ndarray, "f k k"], Float[np.ndarray, "f k"]]:
    """Gives Gauss and Newton's equations of each frame: of what `motion.MOUNTED` frees, and last of the stretch."""
    right_length = shrunk(sides, share)
    slope, weight, off = linear(right_length, motion, width, free=MOUNTED)
    # The first three columns are the planes' normals, along which points move as their ranges shrink.
    nearer = -np.sum(slope[..., :3] * turned(right_length, motion)[0], -1)
    slope = np.concatenate([slope, nearer[..., None]], axis=-1)
    return normal_equations(slope, weight, off)
