"""Where in a cloud the sensor was that measured it, where nothing says so. Host code."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxsim.geometry.beams import ENOUGH_POINTS, NoBeams

_POINTS = 4000
"""As many as are fitted: more change nothing."""
_SCALE_RAD = 0.003
_FITS_DEG = 0.15
_LEAST_RINGS = 8
_STEP = 1e-6


def fit_mount(
    xyz_m: Float[np.ndarray, "n 3"],
    ring: Int[np.ndarray, " n"],
    *,
    near_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Float[np.ndarray, "4 4"], float]:
    """`cloud_from_sensor` of a cloud whose rings are known, and the degrees by which points miss their beams (median).

    Seen from the sensor, and with its axis upright, each ring's points have one elevation. Robust least squares of the
    place (from `near_m` on, metres), roll and pitch that make it so; a spinning sensor's yaw shows in no elevation and
    is left at 0. Raises NoBeams where no place does.
    """
    known = np.flatnonzero(np.bincount(ring) >= ENOUGH_POINTS)
    if len(known) < _LEAST_RINGS:
        raise NoBeams(f"{len(known)} rings have {ENOUGH_POINTS} points or more; a mounting is fitted to {_LEAST_RINGS}")
    chosen = np.flatnonzero(np.isin(ring, known))
    # Evenly over all points: the first ones would see one side of the street alone.
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(_POINTS, len(chosen))).astype(int)]
    points, group = xyz_m[chosen].astype(np.float64), np.searchsorted(known, ring[chosen])
    size = np.bincount(group, minlength=len(known)).clip(min=1)

    def elevations(p: np.ndarray) -> np.ndarray:
        seen = Rotation.from_euler("xy", p[3:]).apply(points - p[:3], inverse=True)
        return np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))

    def misses(p: np.ndarray) -> np.ndarray:
        return elevations(p[:5]) - p[5:][group]

    columns = np.eye(len(known))[group]

    def slopes(p: np.ndarray) -> np.ndarray:
        """Differences for the pose alone: each ring's own elevation enters by -1."""
        here = elevations(p[:5])
        moved = np.stack([(elevations(p[:5] + _STEP * np.eye(5)[k]) - here) / _STEP for k in range(5)], axis=1)
        return np.concatenate([moved, -columns], axis=1)

    start = np.array([*near_m, 0.0, 0.0])
    first = np.bincount(group, elevations(start), len(known)) / size
    # SciPy's signature says that the derivative is a word; a function is what its text asks for.
    derivative: Any = slopes
    fit = least_squares(
        misses,
        np.concatenate([start, first]),
        derivative,
        loss="soft_l1",
        f_scale=_SCALE_RAD,
        x_scale="jac",
        max_nfev=60,
    )
    off_deg = float(np.rad2deg(np.median(np.abs(misses(fit.x)))))
    if off_deg > _FITS_DEG:
        raise NoBeams(
            f"from no one place do the rings look like beams (points miss them by {off_deg:.2f} degrees, median): "
            "several sensors in one cloud, or rings that are no beams"
        )
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xy", fit.x[3:5]).as_matrix()
    pose[:3, 3] = fit.x[:3]
    return pose, off_deg
