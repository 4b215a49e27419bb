"""Where the search for a sensor's motion begins, and what it comes to: all frames together, then each for itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.read.motion import COARSE, MOUNTED, Free, climb, frame_sd, loss, sandwich
from jaxsim.discover.read.registration import (
    LIFT,
    NUMBERS,
    POSE,
    TRAVEL,
    Motion,
    RegisteredSides,
    Registration,
    predicted,
    sides_of,
)
from jaxsim.discover.read.stretch import shrunk, stretch_of
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import Scan
from jaxsim.metrics.intervals import half_width

START_TURNS_RAD = np.deg2rad([-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4])
"""Yaws and pitches from the best of which the search begins ..."""
AHEAD_M = np.arange(-6.0, 6.5)
"""... and ways along the heading by which a frame may be late or early ..."""
DRIVEN_M = np.array([0.0, -2.0, -1.0, 1.0, 2.0, 3.0])
"""... and that the car may have driven meanwhile."""
EVERY = 8
"""One in so many of the points that each frame has is looked at while beginnings are tried."""
LIFTED = MOUNTED.with_sd(LIFT, 0.1)
"""What all frames share (`motion.MOUNTED`) with beams that all point higher, which a sensor that looks ahead can hardly
tell from a pitch."""
OF_FRAME = Free((5.0, 0.3, 0.1, 0.01, 0.01, 0.02, 0.0, 3.0))
"""What a frame has besides: it may be early or late, and a car turns and drives meanwhile ..."""
FRAME_LIFT_SD = 0.003
"""... and what their lifts scatter by, where beams point higher."""
FINE = np.geomspace(0.5, 0.15, 8)
"""Widths of weights (`motion.COARSE`) where frames begin near their place ..."""


def register(
    scan: Scan, range_m: Float[np.ndarray, "f r c"], valid: Bool[np.ndarray, "f r c"], *, scenes: Sequence[str]
) -> Registration:
    """Finds the motion of the sensor between simulated frames (host memory) and the measured ranges (m, where `valid`);
    `scenes` names each frame's, between which it scatters. What the streets do not tell (a yaw within a round wall) is
    0."""
    sides = sides_of(scan, np.asarray(range_m), np.asarray(valid))
    few = sides.thinned(EVERY)

    # All frames together, from the best of many turns; sides of one pose begin, and mostly stay, at 0.
    start = np.zeros((len(START_TURNS_RAD) ** 2, NUMBERS))
    yaw, pitch = np.meshgrid(START_TURNS_RAD, START_TURNS_RAD)
    start[:, 5] = yaw.ravel()
    start[:, 4] = pitch.ravel()
    # Nearest first: of two beginnings that agree as well, the smaller motion is taken.
    start = start[np.argsort(np.abs(start).sum(1), kind="stable")]
    best = int(np.argmin([loss(few, one[None]).mean() for one in start]))
    # Where the truth is no motion, the climb from there must not be missed for a better-looking beginning.
    ends = [climb(sides, start[k][None], COARSE, free=MOUNTED, pooled=True) for k in sorted({0, best})]
    free = MOUNTED
    prior = OF_FRAME
    names, scene = np.unique(list(scenes), return_inverse=True)
    common = min(ends, key=lambda one: loss(sides, one, COARSE[-1]).mean())[0]
    measured = np.where(sides.counts, sides.range_m, np.nan)
    # Ranges that are all too long move a sensor that looks ahead: asked where it seems to have moved.
    if np.linalg.norm(common[:3]) > RULES.moved_m and (stretch := stretch_of(few, scene)).sure:
        sides = shrunk(sides, stretch.share)
        few = shrunk(few, stretch.share)
        common = climb(sides, start[:1], COARSE, free=MOUNTED, pooled=True)[0]
    # Beams that point higher only where nothing else explains the ranges.
    lifted = climb(few, common[None], COARSE, free=LIFTED, pooled=True)
    if abs(lifted[0, LIFT]) - sandwich(few, lifted[0], scene, free=LIFTED)[LIFT] > RULES.lifted_rad:
        common = climb(sides, lifted, FINE, free=LIFTED, pooled=True)[0]
        free = LIFTED
        prior = OF_FRAME.with_sd(LIFT, FRAME_LIFT_SD)

    # Each frame for itself, from the best of the places and ways that it may have along its heading.
    frames = np.repeat(common[None], len(scan.range_m), axis=0)
    for number, ways in ((0, AHEAD_M), (TRAVEL, DRIVEN_M)):
        frames = _from_the_best(few, frames, ways, number=number)
    frames = climb(sides, frames, FINE, free=prior, centre=common, pooled=False)

    half = sandwich(sides, common, scene, free=free)
    if len(names) > 1:
        # Scenes' own poses scatter more than their slopes at the common one say where weights differ.
        of_scenes = np.stack([frames[scene == k].mean(0) for k in range(len(names))])
        half[POSE] = np.maximum(half[POSE], RULES.interval_widening * half_width(of_scenes[:, POSE]))
    shift_m, turn_rad, way_m = RULES.registered_least
    half = np.where(half > 0, np.hypot(half, [shift_m] * 3 + [turn_rad] * 4 + [way_m]), 0)
    given = predicted(sides, np.zeros((1, NUMBERS)))
    return Registration(
        common,
        half,
        frames,
        predicted(sides, frames),
        given_m=given,
        measured_m=measured,
        travel_sd_m=frame_sd(sides, frames, free=prior)[:, TRAVEL],
    )


def _from_the_best(sides: RegisteredSides, motion: Motion, ways: Float[np.ndarray, " k"], *, number: int) -> Motion:
    """Gives each frame's motion with that of the `ways` added to one of its numbers which agrees best."""
    tried = np.repeat(motion[None], len(ways), axis=0)
    tried[..., number] += ways[:, None]
    losses = np.stack([loss(sides, one) for one in tried])
    return tried[np.argmin(losses, axis=0), np.arange(len(motion))]
