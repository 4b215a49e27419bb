"""Laser lines of a cloud that lies line by line in its file, as KITTI's do (host code: a file's order is no kernel).

Inside a line the azimuth grows from straight ahead, to the left, all the way round. So the lines' seam lies in the
middle of the forward view, and a cloud that was cropped to the camera lies on both sides of it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from jaxsim.geometry.sensor import PRESETS, LidarSpec

_BACK_DEG = 20.0
"""A new line starts where the azimuth falls by more; motion compensation alone reaches 6 degrees."""


class UnorderedCloud(ValueError):
    """The order of the points does not tell their laser lines."""


def _line_starts(xyz: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " lines"]:
    azimuth = np.rad2deg(np.arctan2(xyz[:, 1].astype(np.float64), xyz[:, 0])) % 360
    return np.flatnonzero(np.diff(azimuth, prepend=np.inf) < -_BACK_DEG)


def recover_rows(xyz: Float[np.ndarray, "n 3"], lines: int = 64) -> Int[np.ndarray, " n"]:
    """Laser line of every point, 0 = top, from the order of the points in the file."""
    starts = _line_starts(xyz)
    if len(starts) > lines:
        raise UnorderedCloud(
            f"{len(starts)} laser lines found in a cloud of {len(xyz)} points of a sensor with {lines}"
        )
    line = np.zeros(len(xyz), np.int32)
    line[starts] = 1
    return (np.cumsum(line) - 1 + lines - len(starts)).astype(np.int32)


def rows_by_elevation(xyz: Float[np.ndarray, "n 3"], spec: LidarSpec) -> Int[np.ndarray, " n"]:
    """The beam that passes nearest in angle, each seen from its own origin: for clouds without order, on request."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1]).astype(np.float64)
    row, best = np.zeros(len(xyz), np.int32), np.full(len(xyz), np.inf)
    for i, (elevation, origin) in enumerate(zip(spec.elevation_rad, spec.origin_m, strict=True)):
        angle = np.abs(np.arctan2(xyz[:, 2] - origin, rho) - elevation)
        nearer = angle < best
        row[nearer], best[nearer] = i, angle[nearer]
    return row


def fit_beams(
    xyz: Float[np.ndarray, "n 3"], row: Int[np.ndarray, " n"], lines: int = 64, *, name: str = "fitted"
) -> LidarSpec:
    """This unit's own beam table from a scan with known rows (draft: the preset's)."""
    return PRESETS["hdl64e"]
