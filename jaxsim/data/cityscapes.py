"""Cityscapes' classes: the ids that frames carry, and the train ids that KITTI-STEP stores.

Source: the label table of cityscapesScripts (helpers/labels.py). Train id 255 is void: not evaluated there,
`unlabeled` here.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt8

IDS: dict[str, int] = {
    "unlabeled": 0,
    "ego vehicle": 1,
    "rectification border": 2,
    "out of roi": 3,
    "static": 4,
    "dynamic": 5,
    "ground": 6,
    "road": 7,
    "sidewalk": 8,
    "parking": 9,
    "rail track": 10,
    "building": 11,
    "wall": 12,
    "fence": 13,
    "guard rail": 14,
    "bridge": 15,
    "tunnel": 16,
    "pole": 17,
    "polegroup": 18,
    "traffic light": 19,
    "traffic sign": 20,
    "vegetation": 21,
    "terrain": 22,
    "sky": 23,
    "person": 24,
    "rider": 25,
    "car": 26,
    "truck": 27,
    "bus": 28,
    "caravan": 29,
    "trailer": 30,
    "train": 31,
    "motorcycle": 32,
    "bicycle": 33,
}

TRAIN_CLASSES = (
    *("road", "sidewalk", "building", "wall", "fence", "pole", "traffic light", "traffic sign", "vegetation"),
    *("terrain", "sky", "person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
)
"""By train id, 0..18."""
VOID = 255

_FROM_TRAIN = np.full(256, -1, np.int32)
_FROM_TRAIN[: len(TRAIN_CLASSES)] = [IDS[name] for name in TRAIN_CLASSES]
_FROM_TRAIN[VOID] = IDS["unlabeled"]


def ids_of_train_ids(train_ids: UInt8[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """Cityscapes ids of a raster of train ids. Raises ValueError for a value that is neither 0..18 nor 255."""
    ids = _FROM_TRAIN[train_ids]
    if (ids < 0).any():
        values = sorted({int(value) for value in train_ids[ids < 0]})
        raise ValueError(f"class {', '.join(map(str, values[:6]))} is no train id of Cityscapes (0..18, 255 void)")
    return ids
