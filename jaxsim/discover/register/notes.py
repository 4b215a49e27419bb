"""What a reader of the verdict must know of a registration."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from jaxsim.discover.register.registration import Registration


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
