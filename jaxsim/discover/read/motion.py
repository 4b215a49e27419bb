"""Where the sensor stood, by ranges alone: the motion between two sides that show the same streets.

A measured point p = R d(a, e + l) t + o + (u - 1/2) s forward + b lies in direction d of its cell (azimuth a, elevation
e) at range t from its beam's own origin b, where the sensor was moved by o and turned by R, its beams point higher by
l, and the car drove s during the scan (u is the place within it). It is held against the plane of the simulated cell in
whose direction it lies (point-to-plane ICP with projective association; Chen & Medioni 1992, Blais & Levine 1995).

`registration` has the planes that points meet, and what comes out; `climb` is robust least squares on them, and
`search` says where it begins. Its weights are Tukey's, of a width that shrinks from what two degrees move far surfaces
by to what noise leaves; they leave out edges and moving objects.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxsim.devices import side_by_side
from jaxsim.discover.read.registration import (
    NUMBERS,
    MeasuredPoints,
    Met,
    Motion,
    RegisteredSides,
    meet,
    sensor_positions,
    turned,
)
from jaxsim.discover.rules import RULES
from jaxsim.metrics.intervals import student_reach

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


MOUNTED = Free((1.0,) * 3 + (0.1,) * 3 + (0.0, 0.0))
"""What all frames share, m and rad: what streets do not tell stays 0."""
COARSE = np.geomspace(1.0, 0.15, 12)
"""Widths of Tukey's weights, m at the sensor, from step to step ..."""
FINAL_STEPS = 6
"""... with the last so many times again ..."""
TWICE_AT_M = 15.0
"""... and twice as wide at this range."""


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
    half = np.zeros(NUMBERS)
    half[free.numbers] = half_widths(matrix.sum(0) + free.precision, right, scene)
    return half


def half_widths(
    matrix: Float[np.ndarray, "k k"], right: Float[np.ndarray, "f k"], scene: Int[np.ndarray, " f"]
) -> Float[np.ndarray, " k"]:
    """Gives half widths of intervals of what is common, from the curvature and the frames' slopes at the maximum."""
    count = int(scene.max()) + 1
    slopes = np.zeros((count, right.shape[1]))
    np.add.at(slopes, scene, right)
    inverse = np.linalg.inv(matrix)
    # At the maximum they add up to what the prior pulls, which is no scatter.
    slopes = slopes - slopes.mean(0)
    scatter = inverse @ (slopes.T @ slopes * count / max(count - 1, 1)) @ inverse
    sd = np.sqrt(np.maximum(np.diag(scatter), NOISE_M**2 * np.diag(inverse)))
    return RULES.interval_widening * float(student_reach(count)) * sd


def frame_sd(sides: RegisteredSides, motion: Motion, *, free: Free) -> Motion:
    """Gives the standard deviations of frames' numbers by what points leave over (White 1982); 0 for what is held."""
    slope, weight, off = linear(sides, motion, COARSE[-1], free=free)
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

    def of(half: slice) -> tuple[Float[np.ndarray, "h k k"], Float[np.ndarray, "h k"]]:
        own = motion if len(motion) == 1 else motion[half]
        return normal_equations(*linear(sides.of_frames(half), own, width, free=free))

    middle = (len(sides.range_m) + 1) // 2
    (matrix, right), (other, of_other) = side_by_side(partial(of, slice(middle)), partial(of, slice(middle, None)))
    return np.concatenate([matrix, other]), np.concatenate([right, of_other])


def normal_equations(
    slope: Float[np.ndarray, "f n k"], weight: Float[np.ndarray, "f n"], off: Float[np.ndarray, "f n"]
) -> tuple[Float[np.ndarray, "f k k"], Float[np.ndarray, "f k"]]:
    """Gives matrix and right side of weighted least squares, of each frame."""
    weighted = slope * weight[..., None]
    return np.swapaxes(weighted, 1, 2) @ slope, np.einsum("fni,fn->fi", weighted, off)


def linear(
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
