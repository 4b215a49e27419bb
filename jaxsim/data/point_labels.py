"""Classes and objects of a LiDAR's points: SemanticKITTI's files, and rasters of the camera's image of such labels.

    sequences/00/labels/000000.label     uint32 a point, in the order of velodyne/000000.bin

The lower 16 bits are the class, the upper 16 the object within the sequence, 0 none. Source: Behley et al.,
SemanticKITTI, ICCV 2019; numbers of classes from config/semantic-kitti.yaml of semantic-kitti-api.
"""

from __future__ import annotations

import logging
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.cityscapes import IDS
from jaxsim.files import check_size
from jaxsim.frame import Camera
from jaxsim.geometry.points import PAGE_BYTES
from jaxsim.geometry.rasters import nearest_known

_log = logging.getLogger(__name__)

_NUMBERS: dict[str, tuple[int, ...]] = {
    "unlabeled": (0, 1),  # 1: outliers
    "car": (10, 252),  # from 252 on: the same while they move
    "bicycle": (11,),
    "bus": (13, 257),
    "motorcycle": (15,),
    "train": (16, 256),
    "truck": (18, 258),
    "trailer": (20, 259),  # other vehicles, as the set calls trailers and machines
    "person": (30, 254),
    "rider": (31, 32, 253, 255),
    "road": (40, 60),  # 60: lane markings
    "parking": (44,),
    "sidewalk": (48,),
    "ground": (49,),
    "building": (50,),
    "fence": (51,),
    "static": (52, 99),  # other structures, other objects
    "vegetation": (70, 71),  # 71: trunks
    "terrain": (72,),
    "pole": (80,),
    "traffic sign": (81,),
}
NAME_OF_NUMBER = {number: name for name, numbers in _NUMBERS.items() for number in numbers}
"""Name of the Cityscapes class by the number in the file."""
LEARNING_CLASSES = (
    *("unlabeled", "car", "bicycle", "motorcycle", "truck", "trailer", "person", "rider", "rider"),
    *("road", "parking", "sidewalk", "ground", "building", "fence", "vegetation", "vegetation", "terrain"),
    *("pole", "traffic sign"),
)
"""Name of the Cityscapes class by the number 0..19 that the benchmark scores, as range images hold it."""
TRAINING = ("00", "01", "02", "03", "04", "05", "06", "07", "09", "10")
VALIDATION = ("08",)
"""The benchmark's split of the labelled sequences; 11 to 21 have no public labels."""

_BYTES = 4
_FROM_FILE = np.full(2**16, -1, np.int32)
_FROM_FILE[list(NAME_OF_NUMBER)] = [IDS[name] for name in NAME_OF_NUMBER.values()]


def read_point_labels(path: Path, points: int) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Cityscapes ids of the points of a scan, and numbers of their objects, unique within the scan, 0 none.

    Raises ValueError where the file is not of a scan of so many points, and for classes that the set does not have.
    """
    size = check_size(path, by="semantickitti")
    if size != _BYTES * points:
        raise ValueError(
            f"semantickitti: {path} has {size} bytes, and its scan {points} points of {_BYTES} each; labels belong to "
            "the scan of the same number in the odometry benchmark: copy both again"
        )
    values = np.fromfile(path, "<u4")
    unlabelled = points - int(np.flatnonzero(values)[-1]) - 1 if values.any() else points
    if unlabelled * _BYTES >= PAGE_BYTES:
        _log.warning(
            f"semantickitti: the last {unlabelled} of {points} labels in {path} are 0, no class: where a copy broke "
            "off they were never written; copy the file again"
        )
    semantic = _FROM_FILE[values & 0xFFFF]
    if (semantic < 0).any():
        strange = np.unique(values[semantic < 0] & 0xFFFF)
        raise ValueError(
            f"semantickitti: {path} has class {', '.join(map(str, strange[:6]))}, which is none of the set's; known: "
            f"{', '.join(map(str, NAME_OF_NUMBER))}"
        )
    # An object is told by its class and number: the set counts within a class.
    is_object = values >> 16 > 0
    instance = np.zeros(points, np.int32)
    instance[is_object] = 1 + np.unique(values[is_object], return_inverse=True)[1]
    return semantic, instance


def labels_of(scan: Path) -> Path:
    """Where the labels of a scan lie: `labels/` beside its `velodyne/`."""
    return scan.parent.parent / "labels" / f"{scan.stem}.label"


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
