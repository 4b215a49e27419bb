"""How a car moves: bounds of what a recording or a simulator may say of it."""

from __future__ import annotations

import numpy as np

FASTEST_MPS = 150.0
"""No car that carries a LiDAR drives faster: 540 km/h."""
TURNS_RAD = 4 * np.pi
"""A heading or a beam's angle beyond it is in degrees."""


def check_motion_of(speed_mps: float, heading_rad: float, where: str) -> None:
    """Raises ValueError, beginning with `where`, for a speed or a heading that no car has; it names the unit."""
    if not abs(speed_mps) <= FASTEST_MPS:
        raise ValueError(f"{where}: the speed is {speed_mps:g}; it must be in m/s, at most {FASTEST_MPS:g}")
    if not abs(heading_rad) <= TURNS_RAD:
        raise ValueError(f"{where}: the heading is {heading_rad:g}; it must be in radians, not degrees, within -pi..pi")
