"""The sides of a scan that no camera saw, as frames to learn from.

A spinning LiDAR measures all round, and KITTI's camera sees less than a quarter of it. The rest tells what each laser
answers to range and angle just as well, on three times as many walls, cars and kerbs of the same drives. A scan that is
turned about the sensor's axis is one that a car would have measured which had turned so: the camera's place on it, and
all that is prepared, stay as they are, but for the image, which nobody took.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.data import Dataset
from jaxsim.data.select import frame_number
from jaxsim.files import files_of
from jaxsim.frame import CameraFrame, Cloud, Frame
from jaxsim.geometry import LidarSpec, turned_points

SIDES = {90: "to the left", 180: "behind", 270: "to the right"}
"""Where the car looks once it has turned by so many degrees, counter-clockwise seen from above."""
AHEAD_DEG = 20.0
FEWEST = 0.01
"""Share of the points that lie within AHEAD_DEG of straight ahead, of a scan that has this side; of a whole one about
0.1."""


class Turned:
    """The frames of a data set, and after them its sides: with n frames, position n (1 + k) + i is side k of frame i.

    A side is of the frame's scene, so that what is split by scenes stays so. It has neither image nor labels.
    """

    def __init__(self, of: Dataset):
        self.of, self.name = of, of.name

    def __len__(self) -> int:
        return len(self.of) * (1 + len(SIDES))

    @property
    def spec(self) -> LidarSpec:
        """The sensor."""
        return self.of.spec

    def __getitem__(self, index: int) -> Frame:
        """Raises ValueError for a side that the scan does not have, else as `frame_number`."""
        index = frame_number(index, self.name, len(self))
        frame = self.of[index % len(self.of)]
        degrees = self._degrees(index)
        if not degrees or frame.cloud is None:
            return frame
        view = frame.camera
        black = CameraFrame(rgb=np.zeros_like(view.rgb), camera=view.camera, has_image=False)
        cloud = _turned(frame.cloud, degrees, frame.name)
        return Frame(self.name_of(index), frame.scene, camera=black, cloud=cloud, time_s=frame.time_s)

    def name_of(self, index: int) -> str:
        """The frame's name, and by how many degrees it is turned."""
        name, degrees = self.of.name_of(index % len(self.of)), self._degrees(index)
        return f"{name}-turned-{degrees:03d}" if degrees else name

    def files_of(self, index: int) -> list[Path]:
        """The files of the frame that is turned."""
        return files_of(self.of, index % len(self.of))

    def sides(self, positions: list[int]) -> list[int]:
        """Positions of all sides of the frames at `positions`."""
        return [len(self.of) * (1 + k) + i for k in range(len(SIDES)) for i in positions]

    def _degrees(self, index: int) -> int:
        return (0, *SIDES)[frame_number(index, self.name, len(self)) // len(self.of)]


def _turned(cloud: Cloud, degrees: int, name: str) -> Cloud:
    """What a car measures there that has turned by so much."""
    xyz_m = turned_points(np.asarray(cloud.xyz_m), -np.deg2rad(degrees))
    ahead = np.abs(np.rad2deg(np.arctan2(xyz_m[:, 1], xyz_m[:, 0]))) < AHEAD_DEG
    if ahead.mean() < FEWEST:
        raise ValueError(
            f"data: {name}: the scan has no points {SIDES[degrees]}: it was cropped to what the camera sees, or its "
            "sensor does not look all round, so that it has no other sides to learn from; pass --optim.sides 0"
        )
    return replace(cloud, xyz_m=xyz_m)
