"""What a registration says: a motion with its interval, whether it is one of a mounting, of a drive, or of time, and
what a reader of the verdict must know of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxsim.discover.register.sides import LIFT, TRAVEL
from jaxsim.discover.rules import RULES

PARTS = {"extrinsic_translation": slice(0, 3), "extrinsic_rotation": slice(3, 6), "beam_elevation_error": slice(6, 7)}
"""Parts of a motion: what each effect of a mounting, or of the table of beams, changes."""
SCAN_S = 0.1
"""Time of a turn at 10 Hz, as `motion_distortion` has it."""


@dataclass(frozen=True)
class Registration:
    """The motion of the sensor from where the simulator has it, in numbers as `sides` lists them."""

    motion: Float[np.ndarray, " 8"]
    """The motion of all frames together."""
    half: Float[np.ndarray, " 8"]
    """Half width of its interval, from the scatter between scenes."""
    frames: Float[np.ndarray, "f 8"]
    """The motion of each frame."""
    predicted_m: Float[np.ndarray, "f n"]
    """Simulated range of the points that were looked at, at each frame's motion; NaN where nothing is predicted."""
    given_m: Float[np.ndarray, "f n"]
    """The same where the simulator has the sensor."""
    measured_m: Float[np.ndarray, "f n"]
    travel_sd_m: Float[np.ndarray, " f"]
    """Standard deviation of each frame's way during the scan."""

    @property
    def rotation(self) -> dict[str, float]:
        """The rotation as `extrinsic_rotation` has it."""
        yaw, pitch, roll = Rotation.from_rotvec(self.motion[3:6]).as_euler("ZYX")
        return {"roll_rad": float(roll), "pitch_rad": float(pitch), "yaw_rad": float(yaw)}

    @property
    def translation(self) -> dict[str, float]:
        """The translation as `extrinsic_translation` has it."""
        return dict(zip(("x_m", "y_m", "z_m"), map(float, self.motion[:3]), strict=True))

    @property
    def near(self) -> Float[np.ndarray, " f"]:
        """Share of each frame's points that agree with what is predicted at its motion."""
        return _near(self.predicted_m, self.measured_m)

    @property
    def near_as_given(self) -> Float[np.ndarray, " f"]:
        """The same where the simulator has the sensor."""
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
        sd = np.array([np.linalg.norm(self.travel_sd_m[scene == k]) / np.sum(scene == k) for k in range(len(names))])
        least = np.maximum(RULES.driven_m, RULES.driven_sd * sd)
        if np.median(np.abs(of_drive) / least) < 1:
            return None
        return {str(name): float(way / SCAN_S) for name, way in zip(names, of_drive, strict=True)}

    @property
    def sure(self) -> tuple[str, ...]:
        """The effects of PARTS of which the scenes agree that there is more than a frame's own pose, or noise, would
        make."""
        least = {"extrinsic_translation": RULES.moved_m, "extrinsic_rotation": RULES.turned_rad}
        return tuple(
            name
            for name, part in PARTS.items()
            if np.linalg.norm(self.motion[part]) - np.linalg.norm(self.half[part]) > least.get(name, RULES.lifted_rad)
        )

    def __str__(self) -> str:
        moved = ", ".join(f"{v:+.2f}" for v in self.motion[:3])
        turned = ", ".join(f"{v:+.2f}" for v in np.rad2deg([*self.rotation.values()]))
        lifted = (
            f" and beams lifted by {np.rad2deg(self.motion[LIFT]):+.2f} deg"
            if "beam_elevation_error" in self.sure
            else ""
        )
        return f"moved by ({moved}) m along x, y, z and turned by ({turned}) deg in roll, pitch, yaw{lifted}"


def other_moments(registered: Registration, speed_mps: Float[np.ndarray, " f"]) -> str:
    """A note on frames that are of other moments than their partners."""
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
    """A note on drives whose speeds are not given and show in their frames."""
    lowest = min(speeds.values())
    highest = max(speeds.values())
    return (
        "grid.json gives no speed, and scans are distorted by the car's own motion: "
        f"{len(speeds)} drives were registered at {lowest:.1f} to {highest:.1f} m/s (a scan of 0.1 s), and effects of "
        "motion are asked with these speeds; they are read off the frames that are compared. Give the true ones to "
        "learn which share of the motion is left"
    )


def _near(predicted_m: Float[np.ndarray, "f n"], measured_m: Float[np.ndarray, "f n"]) -> Float[np.ndarray, " f"]:
    known = np.isfinite(predicted_m) & np.isfinite(measured_m)
    off = np.abs(np.where(known, measured_m - predicted_m, 0))
    limit = np.maximum(RULES.near_m, RULES.near_share * np.where(known, predicted_m, 0))
    # A moved sensor sees a little of what the simulated image does not hold; a street must not agree by being out of
    # sight.
    least = RULES.in_sight * np.isfinite(measured_m).sum(-1)
    return np.sum(known & (off < limit), -1) / np.maximum(known.sum(-1), np.maximum(least, 1))
