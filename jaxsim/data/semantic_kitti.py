"""SemanticKITTI's labels: a class and an object for each point of a scan of KITTI's odometry benchmark.

    sequences/00/labels/000000.label     uint32 a point, in the order of velodyne/000000.bin

The lower 16 bits are the class, the upper 16 the object within the sequence, 0 none. Source: Behley et al.,
SemanticKITTI, ICCV 2019; numbers of classes from config/semantic-kitti.yaml of semantic-kitti-api.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Int

from jaxsim.data.cityscapes import IDS
from jaxsim.files import check_size

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
