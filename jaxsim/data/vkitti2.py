"""Virtual KITTI 2 as frames: a renderer's view of five KITTI tracking sequences, without a LiDAR.

    ROOT/Scene01/clone/frames/rgb/Camera_0/rgb_00000.jpg
    ROOT/Scene01/clone/frames/depth/Camera_0/depth_00000.png
    ROOT/Scene01/clone/frames/classSegmentation/Camera_0/classgt_00000.png
    ROOT/Scene01/clone/frames/instanceSegmentation/Camera_0/instancegt_00000.png
    ROOT/Scene01/clone/{colors, extrinsic, intrinsic, info, bbox, pose}.txt

Names of folders are taken in any case. A frame has no cloud: it is for `jaxsim simulate`, not for training.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from jaxsim.data.calibration import check_pinhole
from jaxsim.data.kitti_files import listing, read_image
from jaxsim.data.select import frame_number
from jaxsim.data.synthetic import kitti_camera
from jaxsim.data.vkitti2_files import (
    COLOURS,
    VirtualObject,
    boxes_of,
    read_classes,
    read_colours,
    read_depth,
    read_extrinsics,
    read_instances,
    read_intrinsics,
    read_objects,
)
from jaxsim.files import read_once
from jaxsim.frame import Camera, CameraFrame, Frame
from jaxsim.geometry import LidarSpec, camera_at_lidar, preset

LENGTHS = {"Scene01": 447, "Scene02": 233, "Scene06": 270, "Scene18": 339, "Scene20": 837}
"""Frames of each scene in every variation and camera, 2126 in all: clones of the tracking sequences so numbered."""
VARIATIONS = (
    *("15-deg-left", "15-deg-right", "30-deg-left", "30-deg-right"),
    *("clone", "fog", "morning", "overcast", "rain", "sunset"),
)
_RASTERS = {
    "rgb": ("rgb", "rgb", ".jpg"),
    "depth": ("depth", "depth", ".png"),
    "classes": ("classSegmentation", "classgt", ".png"),
    "instances": ("instanceSegmentation", "instancegt", ".png"),
}
"""Folder, beginning of the file's name and its end."""
_TEXTS = ("colors.txt", "intrinsic.txt", "extrinsic.txt", "info.txt", "bbox.txt", "pose.txt")


class VirtualKitti2:
    """Frames of `scenes` (all five where none is named) in `variations`, seen by camera 0 (left) or 1 (right).

    A scene is one scene in all its variations. `lidar` places the LiDAR: where KITTI's car has it from its left
    colour camera (`kitti`), or in the camera (`camera`), so that no ray is hidden from it.

    Depth farther than `reach_m` counts as unknown, like the sky: the completed depth that a network was trained with
    goes no farther than the LiDAR's range, while this set's goes to 655 m.
    """

    name = "vkitti2"

    def __init__(
        self,
        root: Path,
        *,
        scenes: Sequence[str] = (),
        variations: Sequence[str] = ("clone",),
        camera: int = 0,
        lidar: str = "kitti",
        reach_m: float = 120.0,
    ) -> None:
        self.root = Path(root)
        self.camera, self.lidar = camera, lidar
        self.reach_m = reach_m
        if camera not in (0, 1):
            raise ValueError(f"vkitti2: camera is {camera}; it is 0 (left) or 1 (right)")
        if lidar not in ("kitti", "camera"):
            raise ValueError(f"vkitti2: lidar is {lidar!r}; it is 'kitti' (as KITTI's car has it) or 'camera'")
        strange = [name for name in variations if name not in VARIATIONS]
        if strange or not variations:
            raise ValueError(f"vkitti2: no variation {strange[0] if strange else ''!r}; known: {', '.join(VARIATIONS)}")
        drives = [_child(scene, name) for scene in _scenes(self.root, scenes) for name in dict.fromkeys(variations)]
        self._frames = [(drive, number) for drive in drives for number in self._numbers(drive)]

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def spec(self) -> LidarSpec:
        """KITTI's sensor; nothing here was measured by one."""
        return preset("hdl64e")

    def __getitem__(self, index: int) -> Frame:
        drive, number = self._frames[frame_number(index, self.name, len(self))]
        depth_m, known = read_depth(self._raster(drive, "depth", number))
        known = known & (depth_m <= self.reach_m)
        rgb = read_image(self._raster(drive, "rgb", number))
        camera = self._camera(drive, number)
        check_pinhole(np.asarray(camera.intrinsics), rgb.shape[:2], f"vkitti2: {drive}: intrinsic.txt, frame {number}")
        return Frame(
            name=self.name_of(index),
            scene=drive.parent.name,
            camera=CameraFrame(
                rgb=rgb,
                camera=camera,
                depth_m=np.where(known, depth_m, np.float32(0)),
                depth_valid=known,
                semantic=read_classes(self._raster(drive, "classes", number), _read_texts(drive).colours),
                instance=read_instances(self._raster(drive, "instances", number)),
            ),
            cloud=None,
            boxes=boxes_of(self.objects(index)),
        )

    def name_of(self, index: int) -> str:
        """The sequence, its variation, the camera and the frame's number."""
        drive, number = self._frames[index]
        return f"{drive.parent.name}-{drive.name}-Camera_{self.camera}-{number:05d}"

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from, with the text files of its scene and variation."""
        drive, number = self._frames[index]
        return [*(self._raster(drive, kind, number) for kind in _RASTERS), *(drive / name for name in _TEXTS)]

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by the name of a scene: `Scene18`."""
        scenes: dict[str, list[int]] = {}
        for position, (drive, _) in enumerate(self._frames):
            scenes.setdefault(drive.parent.name, []).append(position)
        return scenes

    def objects(self, index: int) -> list[VirtualObject]:
        """Every vehicle in the camera's frustum, the hidden and the far ones too."""
        drive, number = self._frames[index]
        return _read_texts(drive).objects.get((number, self.camera), [])

    def _camera(self, drive: Path, number: int) -> Camera:
        texts, frame = _read_texts(drive), (number, self.camera)
        intrinsics = _of_frame(texts.intrinsics, drive / "intrinsic.txt", frame).astype(np.float32)
        if self.lidar == "camera":
            return camera_at_lidar(intrinsics)
        left_from_world = _of_frame(texts.cam_from_world, drive / "extrinsic.txt", (number, 0))
        cam_from_world = _of_frame(texts.cam_from_world, drive / "extrinsic.txt", frame)
        cam_from_left = cam_from_world @ np.linalg.inv(left_from_world)
        return Camera(intrinsics, (cam_from_left @ kitti_camera().cam_from_velo).astype(np.float32))

    def _raster(self, drive: Path, kind: str, number: int) -> Path:
        _, start, end = _RASTERS[kind]
        return _folder(drive, kind, self.camera) / f"{start}_{number:05d}{end}"

    def _numbers(self, drive: Path) -> list[int]:
        """Frame numbers of one scene in one variation. Raises ValueError where an image lacks a raster."""
        files = {kind: self._files(drive, kind) for kind in _RASTERS}
        for kind, numbers in files.items():
            missing = sorted(files["rgb"] - numbers)
            if missing:
                raise ValueError(
                    f"vkitti2: {drive}: {len(missing)} of {len(files['rgb'])} images have no {kind} (the first: "
                    f"{missing[0]:05d}); unpack the archive vkitti_2.0.3_{_RASTERS[kind][0]} beside the others"
                )
        return sorted(files["rgb"])

    def _files(self, drive: Path, kind: str) -> set[int]:
        folder, (_, start, end) = _folder(drive, kind, self.camera), _RASTERS[kind]
        numbers = {int(m[1]) for p in folder.iterdir() if (m := re.fullmatch(rf"{start}_(\d{{5}}){end}", p.name))}
        if not numbers:
            raise ValueError(f"vkitti2: {listing(folder)}; expected {start}_00000{end} and so on in it")
        return numbers


@dataclass(frozen=True)
class _Texts:
    """What the text files of one scene in one variation say."""

    colours: dict[str, tuple[int, int, int]]
    intrinsics: dict[tuple[int, int], np.ndarray]
    cam_from_world: dict[tuple[int, int], np.ndarray]
    objects: dict[tuple[int, int], list[VirtualObject]]


@partial(read_once, files=lambda drive: [drive / name for name in _TEXTS])
def _read_texts(drive: Path) -> _Texts:
    colours = drive / "colors.txt"
    return _Texts(
        colours=COLOURS | read_colours(colours) if colours.is_file() else COLOURS,
        intrinsics=read_intrinsics(drive / "intrinsic.txt"),
        cam_from_world=read_extrinsics(drive / "extrinsic.txt"),
        objects=read_objects(drive),
    )


def _of_frame(table: dict[tuple[int, int], np.ndarray], path: Path, frame: tuple[int, int]) -> np.ndarray:
    """What a text file has for (frame, camera)."""
    if frame not in table:
        number, camera = frame
        raise ValueError(f"vkitti2: {path} has no line for frame {number} and camera {camera}; copy it again")
    return table[frame]


@lru_cache(maxsize=256)
def _folder(drive: Path, kind: str, camera: int) -> Path:
    folder = _child(_child(drive, "frames"), _RASTERS[kind][0])
    return _child(folder, f"Camera_{camera}")


def _child(folder: Path, name: str) -> Path:
    """The folder of that name in any case. Raises ValueError where there is none."""
    if folder.is_dir():
        for path in folder.iterdir():
            if path.is_dir() and path.name.lower() == name.lower():
                return path
    raise ValueError(f"vkitti2: no {name}/: {listing(folder)}; unpack the data set's archives into one folder")


def _scenes(root: Path, wanted: Sequence[str]) -> list[Path]:
    """Folders of the scenes to read. Raises ValueError for one that is unknown or missing."""
    known = {name.lower(): name for name in LENGTHS}
    strange = [name for name in wanted if name.lower() not in known]
    if strange:
        raise ValueError(f"vkitti2: no scene {strange[0]!r}; there are {', '.join(LENGTHS)}")
    chosen = sorted({known[name.lower()] for name in wanted}) or list(LENGTHS)
    have = {p.name.lower(): p for p in root.iterdir() if p.is_dir()} if root.is_dir() else {}
    missing = [name for name in chosen if name.lower() not in have]
    if missing:
        scenes = [name for name in LENGTHS if name.lower() in have]
        raise ValueError(
            f"vkitti2: no {', '.join(missing)}: {listing(root)}; pass the folder that holds Scene01/, or name the "
            f"scenes to use: --data.scenes {' '.join(scenes) or 'Scene01'}"
        )
    return [have[name.lower()] for name in chosen]
