"""KITTI's labels of the things in view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.synthetic.scene import Thing
from jaxsim.frame import Boxes

MIN_PIXELS = 30
REACH_M = 90.0
# Share of the box's outline in the image that the thing itself fills when nothing hides it.
_FILL = {"Car": 0.80, "Van": 0.86, "Truck": 0.88, "Pedestrian": 0.50, "Cyclist": 0.42}


def label(
    things: Sequence[Thing],
    position_m: Float[np.ndarray, "things 3"],
    heading_rad: Float[np.ndarray, " things"],
    *,
    cam_from_world: Float[np.ndarray, "4 4"],
    intrinsics: Float[np.ndarray, "3 3"],
    instance: Int[np.ndarray, "h w"],
) -> Boxes:
    """Boxes of the labelled things of which MIN_PIXELS or more are seen; a thing's instance is its number + 1.

    `occluded` compares the pixels seen with those that the thing would fill on its own: 0 above 70 %, 1 above 35 %.
    """
    h, w = instance.shape
    pixels = np.bincount(instance.ravel(), minlength=len(things) + 1)
    rows: list[tuple] = []
    for i, thing in enumerate(things):
        if not thing.kind or pixels[i + 1] < MIN_PIXELS:
            continue
        corners = _corners(thing.size_m, position_m[i], heading_rad[i]) @ cam_from_world[:3, :3].T
        corners = corners + cam_from_world[:3, 3]
        bottom = cam_from_world[:3, :3] @ position_m[i] + cam_from_world[:3, 3]
        if bottom[2] < 0.5 or bottom[2] > REACH_M:
            continue
        whole = _outline(corners, intrinsics)
        box = np.clip(whole, 0, [w - 1, h - 1, w - 1, h - 1])
        area, seen_area = _area(whole), _area(box)
        ahead = cam_from_world[:3, :3] @ [np.cos(heading_rad[i]), np.sin(heading_rad[i]), 0.0]
        share = pixels[i + 1] / max(_FILL[thing.kind] * seen_area, 1.0)
        hidden = 0 if share > 0.7 else 1 if share > 0.35 else 2
        # rotation_y is about y, which points down: 0 along x, -pi/2 straight ahead.
        yaw = float(np.arctan2(-ahead[2], ahead[0]))
        rows.append((bottom, thing.size_m, yaw, box, 1.0 - seen_area / max(area, 1e-6), hidden, thing.kind))
    columns = list(zip(*rows, strict=True)) or [()] * 7
    return Boxes(
        np.array(columns[0], np.float32).reshape(-1, 3),
        np.array(columns[1], np.float32).reshape(-1, 3),
        np.array(columns[2], np.float32),
        np.array(columns[3], np.float32).reshape(-1, 4),
        np.array(columns[4], np.float32),
        np.array(columns[5], np.int32),
        tuple(columns[6]),
    )


def _corners(size: tuple[float, float, float], at: np.ndarray, heading: float) -> Float[np.ndarray, "8 3"]:
    signs = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) - [0.5, 0.5, 0.0]
    local = signs * size
    cos, sin = np.cos(heading), np.sin(heading)
    return local @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + at


def _outline(corners_cam: Float[np.ndarray, "8 3"], intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Left, top, right, bottom of the box's image; edges that pass behind the camera are cut just ahead of it."""
    near = 0.1
    points = [c for c in corners_cam if c[2] >= near]
    for i in range(8):
        for j in range(i):
            # Corners whose numbers differ in one bit share an edge.
            if (i ^ j).bit_count() == 1 and (corners_cam[i, 2] < near) != (corners_cam[j, 2] < near):
                a, b = corners_cam[i], corners_cam[j]
                points.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    image = np.array(points) @ intrinsics.T
    uv = image[:, :2] / image[:, 2:]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def _area(box: Float[np.ndarray, "4"]) -> float:
    return float(max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0))
