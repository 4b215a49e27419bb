"""What a calibration can be: a pinhole camera and a rigid transform between sensors of one car."""

from __future__ import annotations

import numpy as np
from jaxtyping import Real

APART_M = 20.0
"""Sensors of one car lie no farther apart: more is millimetres."""
_ROTATION = 1e-3  # what three written digits leave of a rotation
_SQUARE = 0.05  # pixels are square to this
_VIEW_DEG = (10.0, 115.0)  # KITTI's 81; half its focal length would be 120


def check_rigid(matrix: Real[np.ndarray, "r 4"], where: str, *, apart_m: float = APART_M) -> None:
    """Raises ValueError, beginning with `where`, for a transform that is no rotation and translation of a car's
    sensors."""
    rotation, shift = np.asarray(matrix[:3, :3], np.float64), np.asarray(matrix[:3, 3], np.float64)
    if not np.isfinite(matrix).all():
        raise ValueError(f"{where} holds NaN or infinite numbers; copy it again")
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off > _ROTATION or np.linalg.det(rotation) < 0:
        raise ValueError(
            f"{where} is no rotation (R times its transpose is {off:.2g} off 1, its determinant "
            f"{np.linalg.det(rotation):.2g}); copy the calibration again"
        )
    if np.abs(shift).max() > apart_m:
        raise ValueError(
            f"{where} moves by {np.abs(shift).max():g}; it must be in metres, and here at most {apart_m:g}: copy the "
            "calibration again"
        )


def check_pinhole(intrinsics: Real[np.ndarray, "3 3"], size: tuple[int, int], where: str, *, axis: float = 0.1) -> None:
    """Raises ValueError, beginning with `where`, for what is no camera matrix of an image of `size` (rows, columns).

    `axis` is how far the optical axis may lie from the middle, of the image's size.
    """
    k = np.asarray(intrinsics, np.float64)
    fx = k[0, 0]
    fy = k[1, 1]
    h, w = size
    if (
        not np.isfinite(k).all()
        or not (fx > 0 and fy > 0)
        or not np.allclose([k[0, 1], k[1, 0], *k[2]], [0, 0, 0, 0, 1])
    ):
        raise ValueError(
            f"{where} is no camera matrix (focal lengths {fx:g} and {fy:g}, rows {k.tolist()}); it must be "
            "[fx 0 cx; 0 fy cy; 0 0 1] with fx, fy above 0"
        )
    view = 2 * np.degrees(np.arctan(w / (2 * fx)))
    if abs(fx / fy - 1) > _SQUARE or not _VIEW_DEG[0] < view < _VIEW_DEG[1]:
        raise ValueError(
            f"{where} has focal lengths of {fx:g} and {fy:g} pixels, a view of {view:.0f} degrees over {w} columns; "
            f"both must be alike, and the view {_VIEW_DEG[0]:g} to {_VIEW_DEG[1]:g} degrees: calibration and image do "
            "not belong together, or the image was resized"
        )
    if abs(k[0, 2] - w / 2) > axis * w or abs(k[1, 2] - h / 2) > axis * h:
        raise ValueError(
            f"{where} puts the optical axis at ({k[0, 2]:.0f}, {k[1, 2]:.0f}), far from the middle of its image of {w} "
            f"x {h}: calibration and image do not belong together, or the image was resized"
        )
