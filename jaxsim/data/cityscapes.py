"""Cityscapes' classes: the ids that frames carry, and the train ids that KITTI-STEP stores.

Source: the label table of cityscapesScripts (helpers/labels.py). Train id 255 is void: not evaluated there,
`unlabeled` here.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt8

IDS: dict[str, int] = {
    name: number
    for number, name in enumerate(
        (
            *("unlabeled", "ego vehicle", "rectification border", "out of roi", "static", "dynamic", "ground"),
            *("road", "sidewalk", "parking", "rail track"),  # flat: 7 to 10
            *("building", "wall", "fence", "guard rail", "bridge", "tunnel"),  # construction: 11 to 16
            *("pole", "polegroup", "traffic light", "traffic sign"),  # objects: 17 to 20
            *("vegetation", "terrain", "sky"),  # 21 to 23
            *("person", "rider"),  # humans: 24 and 25
            *("car", "truck", "bus", "caravan", "trailer", "train", "motorcycle", "bicycle"),  # vehicles: 26 to 33
        )
    )
}
NAMES = {number: name for name, number in IDS.items()}
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
