"""What a registration is of and what it says. Of: simulated planes, and a choice of measured points that are held
against them. It says: a motion with its interval, whether it is one of a mounting, of a drive, or of time, and what a
reader of the verdict must know of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxsim.discover.rules import RULES
from jaxsim.effects.catalogue.motion_distortion import SCAN_S
from jaxsim.effects.rays import Scan
from jaxsim.geometry import spans_turn

POINTS = 60_000
"""Points looked at in all frames together ..."""
FEWEST_POINTS, MOST_POINTS = 300, 4000
"""... and of each frame, at least and at most."""
POSE = slice(0, 6)
"""The pose among a motion's numbers: x, y, z in m and a rotation vector in rad;"""
LIFT = 6
"""how much higher beams point, rad;"""
TRAVEL = 7
"""and the way driven forward during the scan, m."""
NUMBERS = 8
"""A motion has so many numbers."""
Motion = Float[np.ndarray, "*f 8"]
MeasuredPoints = Float[np.ndarray, "f n 3"]
MOTION_PARTS = {
    "extrinsic_translation": slice(0, 3),
    "extrinsic_rotation": slice(3, 6),
    "beam_elevation_error": slice(6, 7),
}
"""Parts of a motion: what each effect of a mounting, or of the table of beams, changes."""


def least_motion(effect: str) -> float:
    """Gives the size of a motion, m or rad, up to which the effect's part of it is none of a mounting."""
    least = {"extrinsic_translation": RULES.moved_m, "extrinsic_rotation": RULES.turned_rad}
    return least.get(effect, RULES.lifted_rad)


EffectValues = Mapping[str, Mapping[str, Float[np.ndarray, "*k"] | np.floating]]
"""Values of effects' parameters."""


def as_effects(motion: Motion) -> EffectValues:
    """Gives motions as parameters of the effects of MOTION_PARTS, whose one of beams has a number for all of them."""
    yaw, pitch, roll = np.moveaxis(Rotation.from_rotvec(motion[..., 3:6]).as_euler("ZYX"), -1, 0)
    x, y, z = np.moveaxis(motion[..., :3], -1, 0)
    return {
        "extrinsic_translation": {"x_m": x, "y_m": y, "z_m": z},
        "extrinsic_rotation": {"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw},
        "beam_elevation_error": {"error_rad": motion[..., LIFT]},
    }


@dataclass(frozen=True)
class RegisteredSides:
    """The simulated images, and n measured points of each frame."""

    azimuth_rad: Float[np.ndarray, " c"]
    elevation_rad: Float[np.ndarray, " r"]
    origin_m: Float[np.ndarray, " r"]
    full: bool
    """Whether the image closes."""
    planes_m: Float[np.ndarray, "f r c"]
    """Simulated ranges; 0 where nothing is hit."""
    slopes: Float[np.ndarray, "f r c 2"]
    row: Int[np.ndarray, "f n"]
    range_m: Float[np.ndarray, "f n"]
    direction: MeasuredPoints
    upward: MeasuredPoints
    """Change of the direction with the elevation."""
    late: Float[np.ndarray, "f n"]
    """Place within the scan, from its middle, -1/2..1/2."""
    counts: Bool[np.ndarray, "f n"]
    """Whether there is such a point: frames with fewer returns have fewer."""

    def thinned(self, every: int) -> RegisteredSides:
        """Gives the same sides with some of the points alone."""
        of_points = ("row", "range_m", "direction", "upward", "late", "counts")
        return replace(self, **{name: getattr(self, name)[:, ::every] for name in of_points})

    def of_frames(self, frames: slice) -> RegisteredSides:
        """Gives the same sides of some of the frames."""
        of_frame = ("planes_m", "slopes", "row", "range_m", "direction", "upward", "late", "counts")
        return replace(self, **{name: getattr(self, name)[frames] for name in of_frame})


@dataclass(frozen=True)
class Met:
    """The planes that points are held against."""

    normal: MeasuredPoints
    away_m: Float[np.ndarray, "f n"]
    """Distance of the plane from the origin."""
    inside: Bool[np.ndarray, "f n"]
    """Whether the point meets a plane at all."""


def sides_of(scan: Scan, range_m: Float[np.ndarray, "f r c"], valid: Bool[np.ndarray, "f r c"]) -> RegisteredSides:
    """Sets a simulated scan beside points of the measured ranges, which are drawn evenly."""
    grid = scan.grid
    count = int(np.clip(POINTS // len(range_m), FEWEST_POINTS, MOST_POINTS))
    azimuth = np.asarray(grid.azimuth_rad, float)
    elevation = np.asarray(grid.elevation_rad, float)
    rng = np.random.default_rng(0)
    # Frames of fewer points are filled up with ones that do not count.
    cell = np.zeros((len(range_m), count), int)
    counts = np.zeros(cell.shape, bool)
    for k, returned in enumerate(valid & (range_m > 0)):
        at = rng.permutation(np.flatnonzero(returned))[:count]
        cell[k, : len(at)] = at
        counts[k, : len(at)] = True
    row, column = np.unravel_index(cell, range_m.shape[1:])
    frame = np.arange(len(cell))[:, None]
    a = azimuth[column]
    e = elevation[row]
    return RegisteredSides(
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        origin_m=np.asarray(grid.origin_m, float),
        full=bool(spans_turn(grid)),
        planes_m=np.where(scan.hit, scan.range_m, 0).astype(float),
        slopes=np.asarray(scan.slopes, float),
        row=row,
        range_m=np.where(counts, range_m[frame, row, column], 1).astype(float),
        direction=np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1),
        upward=np.stack([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)], axis=-1),
        late=np.asarray(scan.phase, float)[frame, row, column] - 0.5,
        counts=counts,
    )


def sensor_positions(sides: RegisteredSides, motion: Motion) -> MeasuredPoints:
    """Gives where the sensor was as each point was measured, m."""
    driven = motion[:, TRAVEL, None] * sides.late
    return motion[:, None, :3] + np.stack([driven, 0 * driven, 0 * driven], axis=-1)


def turned(sides: RegisteredSides, motion: Motion) -> tuple[MeasuredPoints, MeasuredPoints]:
    """Gives the points from their beam's origin along the simulator's axes, and how they change with beams' lift."""
    lift = motion[:, LIFT, None, None]
    ahead = np.cos(lift) * sides.direction + np.sin(lift) * sides.upward
    upward = np.cos(lift) * sides.upward - np.sin(lift) * sides.direction
    frames = len(sides.range_m)
    matrix = np.broadcast_to(Rotation.from_rotvec(motion[:, 3:6]).as_matrix(), (frames, 3, 3))
    far = sides.range_m[..., None]
    return (far * ahead) @ np.swapaxes(matrix, 1, 2), (far * upward) @ np.swapaxes(matrix, 1, 2)


def meet(sides: RegisteredSides, points: MeasuredPoints) -> Met:
    """Finds the planes of the cells in whose direction points lie, from their beams' own origins."""
    x, y, z = np.moveaxis(points, -1, 0)
    rows = len(sides.elevation_rad)
    columns = len(sides.azimuth_rad)
    down = np.interp(-np.arctan2(z, np.hypot(x, y)), -sides.elevation_rad, np.arange(rows), left=-1, right=rows)
    step = (sides.azimuth_rad[0] - sides.azimuth_rad[-1]) / (columns - 1)
    off = np.arctan2(y, x) - (sides.azimuth_rad[0] + sides.azimuth_rad[-1]) / 2
    # From the middle of the image: an arc that crosses the back has no jump in it.
    off -= 2 * np.pi * np.round(off / (2 * np.pi))
    column = np.round((columns - 1) / 2 - off / step).astype(int)
    row = np.round(down).astype(int)
    inside = sides.counts & (row >= 0) & (row < rows) & (sides.full | ((column >= 0) & (column < columns)))
    row = np.clip(row, 0, rows - 1)
    column = column % columns if sides.full else np.clip(column, 0, columns - 1)
    at = (np.arange(len(points))[:, None], row, column)
    # Of each column and row once, and not of each point.
    cos_a, sin_a = np.cos(sides.azimuth_rad)[column], np.sin(sides.azimuth_rad)[column]
    cos_e, sin_e = np.cos(sides.elevation_rad)[row], np.sin(sides.elevation_rad)[row]
    u, v = np.moveaxis(sides.slopes[at], -1, 0)
    # The cell's ray, its left and its up, in which slopes are written.
    ahead = cos_e - v * sin_e
    normal = np.stack([ahead * cos_a - u * sin_a, ahead * sin_a + u * cos_a, sin_e + v * cos_e], axis=-1)
    length = np.sqrt(1 + u * u + v * v)
    normal = normal / length[..., None]
    # Planes are written from the origin of the cell's beam, points from that of their own.
    away = sides.planes_m[at] / length + normal[..., 2] * (sides.origin_m[row] - sides.origin_m[sides.row])
    return Met(normal, away, inside & (sides.planes_m[at] > 0))


def predicted(sides: RegisteredSides, motion: Motion) -> Float[np.ndarray, "f n"]:
    """Gives the simulated range of every point's ray at the frames' motions, m; NaN where it meets nothing."""
    ray, _ = turned(sides, motion)
    origin = sensor_positions(sides, motion)
    met = meet(sides, ray + origin)
    towards = np.sum(met.normal * ray, -1) / sides.range_m
    away = met.away_m - np.sum(met.normal * origin, -1)
    # A plane that lies behind the ray, or that it sees from behind, predicts nothing.
    meets = met.inside & (towards > 0) & (away > 0)
    return np.where(meets, away / np.where(meets, towards, 1), np.nan)


@dataclass(frozen=True)
class Registration:
    """The motion of the sensor from where the simulator has it, in the order of NUMBERS."""

    motion: Float[np.ndarray, " 8"]
    """The motion of all frames together."""
    half: Float[np.ndarray, " 8"]
    """Half width of its interval, from the scatter between scenes."""
    frames: Float[np.ndarray, "f 8"]
    """The motion of each frame."""
    predicted_m: Float[np.ndarray, "f n"]
    """Simulated range of the points that were looked at, at each frame's motion; NaN where nothing is predicted."""
    given_m: Float[np.ndarray, "f n"]
    """The same with the sensor where the simulator has it."""
    measured_m: Float[np.ndarray, "f n"]
    travel_sd_m: Float[np.ndarray, " f"]
    """Standard deviation of each frame's way during the scan."""

    @property
    def near(self) -> Float[np.ndarray, " f"]:
        """Share of each frame's points that agree with what is predicted at its motion."""
        return _near(self.predicted_m, self.measured_m)

    @property
    def near_as_given(self) -> Float[np.ndarray, " f"]:
        """The same with the sensor where the simulator has it."""
        return _near(self.given_m, self.measured_m)

    @property
    def early_or_late(self) -> bool:
        """Whether frames of one name are of different moments: along the heading they are apart from frame to frame, or
        farther than a mounting can be."""
        along = self.frames[:, 0]
        # Medians: a frame that was registered to another street must not decide for all.
        one_by_one = float(np.median(np.abs(along - np.median(along))))
        return one_by_one > RULES.apart_m or abs(float(np.median(along))) > RULES.farthest_mounted_m

    def apart_s(self, speed_mps: Float[np.ndarray, " f"]) -> float | None:
        """Seconds by which the measured side is late (early, if negative), by the frames' speeds; None where these tell
        nothing."""
        moving = float(speed_mps @ speed_mps)
        # Least squares through the origin: one delay for all frames, whatever their speed.
        return float(self.frames[:, 0] @ speed_mps) / moving if moving > 0 else None

    def speeds(self, scenes: Sequence[str]) -> dict[str, float] | None:
        """Each drive's speed (m/s), by the way that rays of the beginning and of the end of a
        scan are apart; None where that is no more than noise makes."""
        names, scene = np.unique(list(scenes), return_inverse=True)
        of_drive = np.array([self.frames[scene == k, TRAVEL].mean() for k in range(len(names))])
        # A drive's way is the mean of its frames', whose errors are independent.
        sd = np.array([np.linalg.norm(self.travel_sd_m[scene == k]) / np.sum(scene == k) for k in range(len(names))])
        least = np.maximum(RULES.driven_m, RULES.driven_sd * sd)
        if np.median(np.abs(of_drive) / least) < 1:
            return None
        return {str(name): float(way / SCAN_S) for name, way in zip(names, of_drive, strict=True)}

    @property
    def sure(self) -> tuple[str, ...]:
        """The effects of MOTION_PARTS of which the scenes agree that there is more than a frame's own pose, or noise,
        would make."""
        return tuple(
            name
            for name, part in MOTION_PARTS.items()
            if np.linalg.norm(self.motion[part]) - np.linalg.norm(self.half[part]) > least_motion(name)
        )

    def __str__(self) -> str:
        moved = ", ".join(f"{v:+.2f}" for v in self.motion[:3])
        turned = ", ".join(f"{v:+.2f}" for v in np.rad2deg([*as_effects(self.motion)["extrinsic_rotation"].values()]))
        lifted = (
            f" and beams lifted by {np.rad2deg(self.motion[LIFT]):+.2f} deg"
            if "beam_elevation_error" in self.sure
            else ""
        )
        return f"moved by ({moved}) m along x, y, z and turned by ({turned}) deg in roll, pitch, yaw{lifted}"


def other_moments(registered: Registration, speed_mps: Float[np.ndarray, " f"]) -> str:
    """Gives a note on frames that are of other moments than their partners."""
    late_s = registered.apart_s(speed_mps)
    by_speed = "" if late_s is None else f", {abs(late_s):.2f} s {'later' if late_s > 0 else 'earlier'} by their speeds"
    along = registered.frames[:, 0]
    return (
        "the measured frames are of other moments than the simulated ones: "
        f"{np.median(along):+.2f} m along the heading "
        f"({along.min():+.2f} to {along.max():+.2f}){by_speed}. Each simulated frame was brought to where its partner "
        "stood, and only rays whose ranges then agree are compared: what moved, and what came out from behind "
        "something, tells nothing; nor do early returns. Pair frames of one moment"
    )


def speeds_read(speeds: Mapping[str, float]) -> str:
    """Gives a note on drives whose speeds are not given and show in their frames."""
    lowest = min(speeds.values())
    highest = max(speeds.values())
    return (
        "grid.json gives no speed, and scans are distorted by the car's own motion: "
        f"{len(speeds)} drives were registered at {lowest:.1f} to {highest:.1f} m/s (a scan of 0.1 s), and effects of "
        "motion are asked with these speeds; they are read off the frames that are compared. Give the true ones to "
        "learn which share of the motion is left"
    )


def _near(predicted_m: Float[np.ndarray, "f n"], measured_m: Float[np.ndarray, "f n"]) -> Float[np.ndarray, " f"]:
    both = np.isfinite(predicted_m) & np.isfinite(measured_m)
    off = np.abs(np.where(both, measured_m - predicted_m, 0))
    limit = np.maximum(RULES.near_m, RULES.near_share * np.where(both, predicted_m, 0))
    # A moved sensor sees a little of what the simulated image does not hold; a street must not agree by being out of
    # sight.
    least = RULES.in_sight * np.isfinite(measured_m).sum(-1)
    return np.sum(both & (off < limit), -1) / np.maximum(both.sum(-1), np.maximum(least, 1))
