"""Detections as KITTI writes them: one line an object, in the frame of the labels, with the rectangle in the image.

Columns: kind, truncated, occluded, alpha, left, top, right, bottom, height, width, length, x, y, z, rotation_y, score
(the devkit's readme). What a detector does not know, truncated and occluded, is -1.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from jaxsim.detect.scenes import View
from jaxsim.files import write_text
from jaxsim.geometry.boxes import camera_boxes, corners_of, wrapped_heading

# Corners nearer than this, or behind the camera, have no pixel that says anything.
NEAR_M = 0.1


@dataclass(frozen=True)
class Detected:
    """The detections of one frame on the host, best first."""

    boxes: Float32[np.ndarray, "n 7"]
    """Boxes in `velo`."""
    score: Float32[np.ndarray, " n"]
    """0..1."""


def outlines(boxes: Float[np.ndarray, "n 7"], view: View) -> Float[np.ndarray, "n 4"]:
    """Left, top, right, bottom in pixels of the corners that lie ahead, cut at the image's borders; all 0 where none
    lies ahead."""
    cam = corners_of(boxes) @ view.cam_from_velo[:3, :3].T + view.cam_from_velo[:3, 3]
    ahead = cam[..., 2] > NEAR_M
    pixel = cam @ view.intrinsics.T
    uv = pixel[..., :2] / np.where(ahead, pixel[..., 2], 1)[..., None]
    low = np.where(ahead[..., None], uv, np.inf).min(axis=1, initial=np.inf)
    high = np.where(ahead[..., None], uv, -np.inf).max(axis=1, initial=-np.inf)
    rows, columns = view.size
    outline = np.clip(np.concatenate([low, high], axis=1), 0, [columns - 1, rows - 1] * 2)
    return np.where(ahead.any(axis=1, keepdims=True), outline, 0.0)


def result_lines(detected: Detected, kind: str, view: View) -> list[str]:
    """The lines of a result file."""
    centre, size, yaw = camera_boxes(detected.boxes, view.rect_from_velo)
    # KITTI's alpha: heading less the direction of sight; in `velo` -y is right and x ahead.
    alpha = wrapped_heading(yaw - np.arctan2(-detected.boxes[:, 1], detected.boxes[:, 0]))
    rectangle = outlines(detected.boxes.astype(np.float64), view)
    return [
        f"{kind} -1 -1 {' '.join(f'{v:.4f}' for v in (a, *r, *s[::-1], *c, y, score))}"
        for a, r, s, c, y, score in zip(alpha, rectangle, size, centre, yaw, detected.score, strict=True)
    ]


def write_lines(path: Path, lines: list[str]) -> None:
    """Writes a label or result file whole; one without lines says that nothing is there."""
    write_text(path, "".join(line + "\n" for line in lines))
