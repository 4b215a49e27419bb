"""Where the sensor stood, by ranges alone: the motion between two sides that show the same streets.

A measured point p = R d(a, e + l) t + o + (u - 1/2) s forward + b lies in direction d of its cell (azimuth a, elevation
e) at range t from its beam's own origin b, where the sensor was moved by o and turned by R, its beams point higher by
l, and the car drove s during the scan (u is the place within it). It is held against the plane of the simulated cell in
whose direction it lies (point-to-plane ICP with projective association; Chen & Medioni 1992, Blais & Levine 1995).

`registration` has the planes that points meet, and what comes out; `climb` is robust least squares on them. Its weights
are Tukey's, of a width that shrinks from what two degrees move far surfaces by to what noise leaves; they leave out
edges and moving objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxsim.discover.read.registration import (
    LIFT,
    NUMBERS,
    POSE,
    TRAVEL,
    MeasuredPoints,
    Met,
    Motion,
    RegisteredSides,
    Registration,
    meet,
    predicted,
    sensor_positions,
    sides_of,
    turned,
)
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import Scan
from jaxsim.metrics.intervals import half_width, student_reach

NOISE_M = 0.05
"""Standard deviation of a point about its plane: what priors are weighed against."""


class Free(NamedTuple):
    """Standard deviations of a motion's numbers, m and rad; 0 holds one where it is."""

    sd: tuple[float, ...]

    def with_sd(self, number: int, sd: float) -> Free:
        """Gives the same standard deviations, but for that of one number."""
        return Free((*self.sd[:number], sd, *self.sd[number + 1 :]))

    @property
    def numbers(self) -> Int[np.ndarray, " k"]:
        """The numbers that are fitted."""
        return np.flatnonzero(self.sd)

    @property
    def precision(self) -> Float[np.ndarray, "k k"]:
        """The precision of their prior, in units of a point's."""
        return np.diag((NOISE_M / np.asarray(self.sd)[self.numbers]) ** 2)


START_TURNS_RAD = np.deg2rad([-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4])
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
OF_FRAME = Free((5.0, 0.3, 0.1, 0.01, 0.01, 0.02, 0.0, 3.0))
"""What a frame has besides: it may be early or late, and a car turns and drives meanwhile ..."""
FRAME_LIFT_SD = 0.003
"""... and what their lifts scatter by, where beams point higher."""
COARSE = np.geomspace(1.0, 0.15, 12)
"""Widths of Tukey's weights, m at the sensor, from step to step ..."""
FINE = np.geomspace(0.5, 0.15, 8)
"""... and where frames begin near their place ..."""
FINAL_STEPS = 6
"""... with the last so many times again ..."""
TWICE_AT_M = 15.0
"""... and twice as wide at this range."""


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
    measured = np.where(sides.counts, sides.range_m, np.nan)
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


def loss(sides: RegisteredSides, motion: Motion, width: float = COARSE[0]) -> Float[np.ndarray, " f"]:
    """Tells how badly each frame's points lie on the planes that they meet, 0..1 (Geman & McClure's loss)."""
    points = turned(sides, motion)[0] + sensor_positions(sides, motion)
    met = meet(sides, points)
    square = (_off(met, points) / _width(sides, width)) ** 2
    return np.sum(np.where(met.inside, square / (1 + square), 0), -1) / np.maximum(met.inside.sum(-1), 1)


def climb(
    sides: RegisteredSides,
    motion: Motion,
    widths: Float[np.ndarray, " k"],
    *,
    free: Free,
    pooled: bool,
    centre: Float[np.ndarray, " 8"] | None = None,
) -> Motion:
    """Finds the motions at the bottom of the valley where they begin, of all frames together (`pooled`) or of each,
    held to `centre`."""
    middle = np.zeros(NUMBERS) if centre is None else centre
    # Wide first: a motion of two degrees takes far points off their planes by more than noise ever does.
    for width in [*widths, *[widths[-1]] * FINAL_STEPS]:
        matrix, right = _equations(sides, motion, width, free=free)
        if pooled:
            matrix = matrix.sum(0, keepdims=True)
            right = right.sum(0, keepdims=True)
        # The prior pulls towards the middle as so many points would.
        right = right + (middle - motion)[:, free.numbers] @ free.precision
        step = np.zeros((len(right), NUMBERS))
        step[:, free.numbers] = np.linalg.solve(matrix + free.precision, right[..., None])[..., 0]
        # Rotations compose, their vectors do not add up.
        rotation = Rotation.from_rotvec(step[:, 3:6]) * Rotation.from_rotvec(motion[:, 3:6])
        motion = motion + step
        motion[:, 3:6] = rotation.as_rotvec()
    return motion


def sandwich(
    sides: RegisteredSides, motion: Float[np.ndarray, " 8"], scene: Int[np.ndarray, " f"], *, free: Free
) -> Float[np.ndarray, " 8"]:
    """Gives half widths of the common motion's interval (White 1982): the filling is the scatter of the scenes' slopes,
    or the curvature's where that is wider. 0 for what is held."""
    matrix, right = _equations(sides, motion[None], COARSE[-1], free=free)
    count = int(scene.max()) + 1
    slopes = np.zeros((count, right.shape[1]))
    np.add.at(slopes, scene, right)
    inverse = np.linalg.inv(matrix.sum(0) + free.precision)
    # At the maximum they add up to what the prior pulls, which is no scatter.
    slopes = slopes - slopes.mean(0)
    scatter = inverse @ (slopes.T @ slopes * count / max(count - 1, 1)) @ inverse
    sd = np.sqrt(np.maximum(np.diag(scatter), NOISE_M**2 * np.diag(inverse)))
    half = np.zeros(NUMBERS)
    half[free.numbers] = RULES.interval_widening * float(student_reach(count)) * sd
    return half


def frame_sd(sides: RegisteredSides, motion: Motion, *, free: Free) -> Motion:
    """Gives the standard deviations of frames' numbers by what points leave over (White 1982); 0 for what is held."""
    slope, weight, off = _linear(sides, motion, COARSE[-1], free=free)
    matrix = np.swapaxes(slope * weight[..., None], 1, 2) @ slope + free.precision
    left_over = slope * (weight * off)[..., None]
    inverse = np.linalg.inv(matrix)
    variance = inverse @ (np.swapaxes(left_over, 1, 2) @ left_over) @ inverse
    sd = np.zeros((len(motion), NUMBERS))
    sd[:, free.numbers] = np.sqrt(np.diagonal(variance, axis1=1, axis2=2))
    return sd


def _equations(
    sides: RegisteredSides, motion: Motion, width: float, *, free: Free
) -> tuple[Float[np.ndarray, "f k k"], Float[np.ndarray, "f k"]]:
    """Gives Gauss and Newton's equations of each frame at its motion: matrix and right side of the step in what is
    free."""
    slope, weight, off = _linear(sides, motion, width, free=free)
    weighted = slope * weight[..., None]
    return np.swapaxes(weighted, 1, 2) @ slope, np.einsum("fni,fn->fi", weighted, off)


def _linear(
    sides: RegisteredSides, motion: Motion, width: float, *, free: Free
) -> tuple[Float[np.ndarray, "f n k"], Float[np.ndarray, "f n"], Float[np.ndarray, "f n"]]:
    """Gives how points' distances from their planes change with what is free, Tukey's weights, and the distances, m."""
    ray, lifted = turned(sides, motion)
    points = ray + sensor_positions(sides, motion)
    met = meet(sides, points)
    off = _off(met, points)
    weight = np.where(met.inside, np.maximum(1 - (off / _width(sides, width)) ** 2, 0) ** 2, 0)
    # A point's derivative off its plane: the normal in its place, the moment about the sensor in its rotation.
    driven = met.normal[..., 0] * sides.late
    lift = np.sum(met.normal * lifted, -1)
    slope = np.concatenate([met.normal, np.cross(ray, met.normal), lift[..., None], driven[..., None]], axis=-1)
    return slope[..., free.numbers], weight, off


def _off(met: Met, points: MeasuredPoints) -> Float[np.ndarray, "f n"]:
    """Tells how far planes lie beyond points, m."""
    return met.away_m - np.sum(met.normal * points, -1)


def _width(sides: RegisteredSides, width: float) -> Float[np.ndarray, "f n"]:
    # Neighbouring rays, and so the planes' errors, lie farther apart far off.
    return width * (1 + sides.range_m / TWICE_AT_M)
