"""Six frames that take no time, for trees of them."""

import numpy as np
import pytest

from jaxsim.data import DATASETS, DatasetKind
from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import Boxes, CameraFrame, Cloud, Frame
from jaxsim.geometry import preset

SIZE = (38, 124)


def boxes_at(*places, kind="Car"):
    n = len(places)
    return Boxes(
        np.array(places, np.float32).reshape(-1, 3),
        np.tile(np.float32([4, 1.6, 1.5]), (n, 1)),
        np.zeros(n, np.float32),
        np.tile(np.float32([10, 5, 40, 30]), (n, 1)),
        np.zeros(n, np.float32),
        np.zeros(n, np.int32),
        (kind,) * n,
    )


class Six:
    """Frame 1 has no object, frame 2 one that is too far; frames 0-2 are one scene, 3-5 another."""

    name = "synthetic"
    spec = preset("hdl64e")
    made: list[int]

    def __init__(self, boxes=None):
        self.made, self.boxes = [], boxes

    def __len__(self):
        return 6

    def name_of(self, index):
        return f"six-{index}"

    def __getitem__(self, index):
        self.made.append(index)
        places = {1: [], 2: [(0, 1.5, 90)]}.get(index, [(0, 1.5, 10 + index), (30, 1.5, 80)])
        depth = np.full(SIZE, 20.0 + index, np.float32)
        rgb = np.full((*SIZE, 3), index, np.uint8)
        view = CameraFrame(rgb, kitti_camera(SIZE), depth, depth > 0)
        cloud = Cloud(np.float32([[10, 0, 0], [12, 1, -1]]), np.float32([0.25, 0.5]), np.ones(2, bool))
        boxes = boxes_at(*places) if self.boxes is None else self.boxes(index)
        return Frame(f"six-{index}", f"street-{index // 3}", view, cloud, boxes=boxes)


@pytest.fixture
def six(monkeypatch):
    dataset = Six()
    for kind in ("synthetic", "kitti_object"):
        monkeypatch.setitem(DATASETS, kind, DatasetKind(lambda config: dataset))
    return dataset
