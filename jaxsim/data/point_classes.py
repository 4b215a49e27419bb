"""Classes of a LiDAR's points as rasters of the camera's image, for data sets that label points and no pixels."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int

from jaxsim.frame import Camera
from jaxsim.geometry.rasters import nearest_known

REACH_PX = 12.0
"""A pixel takes the class of a point within this: KITTI's lines lie up to 7 pixels apart, where none is lost."""
_AROUND = np.ones((11, 7), np.uint8)
_HIDDEN = 1.1, 1.0
"""A point this share, plus so many metres, behind the nearest around it is hidden from the camera."""


def classes_in_image(
    xyz_m: Float[np.ndarray, "n 3"],
    semantic: Int[np.ndarray, " n"],
    instance: Int[np.ndarray, " n"],
    *,
    camera: Camera,
    size: tuple[int, int],
) -> tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Class and object of each pixel of an image of `size` (h, w): those of the labelled point nearest to it in the
    image, 0 where none is near (the sky above the LiDAR's lines).

    The LiDAR stands above the camera, and sees over what hides a surface from it: such points are left out.
    """
    known = semantic > 0
    here = xyz_m[known].astype(np.float64) @ np.asarray(camera.cam_from_velo, np.float64)[:3, :3].T
    here += np.asarray(camera.cam_from_velo, np.float64)[:3, 3]
    depth = here[:, 2]
    pixel = here @ np.asarray(camera.intrinsics, np.float64).T
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = np.round(pixel[:, :2] / depth[:, None]).T
    h, w = size
    inside = (depth > 0.1) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
    if not inside.any():
        return np.zeros(size, np.int32), np.zeros(size, np.int32)
    column = column[inside].astype(int)
    row = row[inside].astype(int)
    depth = depth[inside].astype(np.float32)
    # The last write to a pixel stays: the nearest point.
    order = np.argsort(-depth, kind="stable")
    column = column[order]
    row = row[order]
    depth = depth[order]
    nearest = np.full(size, np.inf, np.float32)
    nearest[row, column] = depth
    share, metres = _HIDDEN
    seen = depth <= share * cv2.erode(nearest, _AROUND)[row, column] + metres
    column, row = column[seen], row[seen]
    values, filled = np.zeros((2, *size), np.int32), np.zeros(size, bool)
    values[:, row, column] = np.stack([semantic[known], instance[known]])[:, inside][:, order][:, seen]
    filled[row, column] = True
    away_px, source = nearest_known(filled)
    classes = np.where(away_px <= REACH_PX, values.reshape(2, -1)[:, source], 0)
    return classes[0], classes[1]
