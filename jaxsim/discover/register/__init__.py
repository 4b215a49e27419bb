"""Where the sensor stood, by ranges alone: the motion between two sides that show the same streets.

A measured point p = R d(a, e + l) t + o + (u - 1/2) s forward + b lies in direction d of its cell (azimuth a, elevation
e) at range t from its beam's own origin b, where the sensor was moved by o and turned by R, its beams point higher by
l, and the car drove s during the scan (u is the place within it). It is held against the plane of the simulated cell in
whose direction it lies (point-to-plane ICP with projective association; Chen & Medioni 1992, Blais & Levine 1995).

Read `sides` (the planes that points meet), `climb` (robust least squares on them), `registration` (what comes out).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.register.climb import (
    COARSE,
    FINE,
    LIFT,
    NUMBERS,
    POSE,
    TRAVEL,
    Free,
    Motion,
    climb,
    loss,
    own_sd,
    sandwich,
)
from jaxsim.discover.register.registration import Registration
from jaxsim.discover.register.sides import Sides, predicted, sides_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import half_width
from jaxsim.effects.rays import Scan

TURNS_RAD = np.deg2rad([-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4])
"""Yaws and pitches from the best of which the search begins ..."""
AHEAD_M = np.arange(-6.0, 6.5)
"""... and ways along the heading by which a frame may be late or early ..."""
DRIVEN_M = np.array([0.0, -2.0, -1.0, 1.0, 2.0, 3.0])
"""... and that the car may have driven meanwhile."""
EVERY = 8
"""One in so many of the points that each frame has is looked at while beginnings are tried."""
MOUNTED = Free((1.0,) * 3 + (0.1,) * 3 + (0.0, 0.0))
"""What all frames share, m and rad: what streets do not tell stays 0 ..."""
LIFTED = MOUNTED.with_sd(LIFT, 0.1)
"""... and with beams that all point higher, which a sensor that looks ahead can hardly tell from a pitch."""
OWN = Free((5.0, 0.3, 0.1, 0.01, 0.01, 0.02, 0.0, 3.0))
"""What a frame has besides: it may be early or late, and a car turns and drives meanwhile ..."""
LEAST_HALF = np.array([0.006] * 3 + [0.0003] * 4 + [0.02])
"""Half width, m and rad, that no number of scenes makes narrower: planes through neighbouring cells are that far off,
on development cases (`python -m benchmarks.blind.placed`)."""
OWN_LIFT_SD = 0.003
"""... and what frames' lifts scatter by, where there is one."""


def register(
    scan: Scan, range_m: Float[np.ndarray, "f r c"], valid: Bool[np.ndarray, "f r c"], *, scenes: Sequence[str]
) -> Registration:
    """The motion of the sensor between simulated frames (host memory) and the measured ranges (m, where `valid`);
    `scenes` names each frame's, between which it scatters. What the streets do not tell (a yaw within a round wall) is
    0."""
    sides = sides_of(scan, np.asarray(range_m), np.asarray(valid))
    few = sides.thinned(EVERY)

    # All frames together, from the best of many turns; sides of one pose begin, and mostly stay, at 0.
    start = np.zeros((len(TURNS_RAD) ** 2, NUMBERS))
    yaw, pitch = np.meshgrid(TURNS_RAD, TURNS_RAD)
    start[:, 5] = yaw.ravel()
    start[:, 4] = pitch.ravel()
    # Nearest first: of two beginnings that agree as well, the smaller motion is taken.
    start = start[np.argsort(np.abs(start).sum(1), kind="stable")]
    best = int(np.argmin([loss(few, one[None]).mean() for one in start]))
    # Where the truth is no motion, the climb from there must not be missed for a better-looking beginning.
    ends = [climb(sides, start[k][None], COARSE, free=MOUNTED, pooled=True) for k in sorted({0, best})]
    free = MOUNTED
    own = OWN
    names, scene = np.unique(list(scenes), return_inverse=True)
    common = min(ends, key=lambda one: loss(sides, one, COARSE[-1]).mean())[0]
    # Beams that point higher only where nothing else explains the ranges.
    lifted = climb(few, common[None], COARSE, free=LIFTED, pooled=True)
    if abs(lifted[0, LIFT]) - sandwich(few, lifted[0], scene, free=LIFTED)[LIFT] > RULES.lifted_rad:
        common = climb(sides, lifted, FINE, free=LIFTED, pooled=True)[0]
        free = LIFTED
        own = OWN.with_sd(LIFT, OWN_LIFT_SD)

    # Each frame for itself, from the best of the places and ways that it may have along its heading.
    frames = np.repeat(common[None], len(scan.range_m), axis=0)
    for number, ways in ((0, AHEAD_M), (TRAVEL, DRIVEN_M)):
        frames = _from_the_best(few, frames, ways, number=number)
    frames = climb(sides, frames, FINE, free=own, centre=common, pooled=False)

    half = sandwich(sides, common, scene, free=free)
    if len(names) > 1:
        # Scenes' own poses scatter more than their slopes at the common one say where weights differ.
        of_scenes = np.stack([frames[scene == k].mean(0) for k in range(len(names))])
        half[POSE] = np.maximum(half[POSE], RULES.interval_widening * half_width(of_scenes[:, POSE]))
    half = np.where(half > 0, np.hypot(half, LEAST_HALF), 0)
    given = predicted(sides, np.zeros((1, NUMBERS)))
    measured = np.where(sides.counts, sides.range_m, np.nan)
    return Registration(
        common,
        half,
        frames,
        predicted(sides, frames),
        given_m=given,
        measured_m=measured,
        travel_sd_m=own_sd(sides, frames, free=own)[:, TRAVEL],
    )


def _from_the_best(sides: Sides, motion: Motion, ways: Float[np.ndarray, " k"], *, number: int) -> Motion:
    """Each frame's motion with that of the `ways` added to one of its numbers which agrees best."""
    tried = np.repeat(motion[None], len(ways), axis=0)
    tried[..., number] += ways[:, None]
    losses = np.stack([loss(sides, one) for one in tried])
    return tried[np.argmin(losses, axis=0), np.arange(len(motion))]
