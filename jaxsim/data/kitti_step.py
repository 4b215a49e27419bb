"""KITTI tracking sequences with the panoptic labels of KITTI-STEP.

    ROOT/training/{image_02, velodyne}/0000/000000.{png, bin}     tracking: images and scans
    ROOT/training/{calib, label_02}/0000.txt                       one file a sequence
    ROOT/panoptic_maps/{train, val}/0000/000000.png                KITTI-STEP (or ROOT/kitti-step/panoptic_maps/...)

A panoptic map is an 8-bit RGB PNG: R the Cityscapes train id, G * 256 + B the instance (0: none). Its folders `train`
and `val` are the benchmark's split; the paper's is another, for Virtual KITTI clones five of the sequences.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Int

from jaxsim.data.cityscapes import VOID, ids_of_train_ids
from jaxsim.data.clouds import check_rows, fitted_spec, read_scan
from jaxsim.data.kitti_files import (
    NO_BOXES,
    listing,
    object_camera,
    object_rect_from_velo,
    read_image,
    read_tracking_labels,
)
from jaxsim.data.select import frame_number
from jaxsim.files import files_in, placed, read_once, read_pixels
from jaxsim.frame import Boxes, CameraFrame, Frame
from jaxsim.geometry import LidarSpec

LENGTHS = dict(
    enumerate((154, 447, 233, 144, 314, 297, 270, 800, 390, 803, 294, 373, 78, 340, 106, 376, 209, 145, 339, 1059, 837))
)
"""Frames of each labelled sequence: 8008 in all."""
SEQUENCES = tuple(f"{number:04d}" for number in LENGTHS)
EVALUATION = ("0001", "0002", "0006", "0018", "0020")
"""Those that Virtual KITTI clones: 2126 frames. The paper trains on the other 16."""
NO_SCAN = {("0001", f"{number:06d}") for number in range(177, 181)}
"""Frames that were published without a scan."""
_DIVISOR = 1000  # KITTI-STEP's own combined id is class * 1000 + instance
_labels = read_once(read_tracking_labels)


class KittiStep:
    """Frames of the 21 labelled tracking sequences: camera 2, scan, panoptic labels, boxes where they are there.

    A sequence is a scene. `sequences` chooses some; all 21 otherwise, and one that is missing is an error. With
    `panoptic=False` the panoptic maps are left out. Frames published without a scan (NO_SCAN) are left out.
    """

    name = "kitti_step"

    def __init__(
        self, root: Path, *, sequences: Sequence[str] = (), rows: str = "file_order", panoptic: bool = True
    ) -> None:
        self.root = Path(root)
        self._rows = check_rows(rows)
        self._folder = _training_folder(self.root)
        self._maps = _map_folders(self.root) if panoptic else None
        self.sequences = _present(self._folder, sequences)
        self._frames = [(s, n) for s in self.sequences for n in self._numbers(s)]

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def spec(self) -> LidarSpec:
        """The beam table, fitted to the first scan."""
        return fitted_spec(self._path("velodyne", 0, ".bin"), self._rows)

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions of the paper's two parts: `training` (16 sequences) and `evaluation` (5)."""
        judged = [sequence in EVALUATION for sequence, _ in self._frames]
        return {
            "training": [i for i, held_back in enumerate(judged) if not held_back],
            "evaluation": [i for i, held_back in enumerate(judged) if held_back],
        }

    def __getitem__(self, index: int) -> Frame:
        sequence, number = self._frames[frame_number(index, self.name, len(self))]
        rgb = read_image(self._path("image_02", index, ".png"))
        semantic, instance = None, None
        if self._maps is not None:
            semantic, instance = read_panoptic(self._maps[sequence] / f"{number}.png", rgb.shape[:2])
        calibration = self._folder / "calib" / f"{sequence}.txt"
        return Frame(
            name=self.name_of(index),
            scene=sequence,
            camera=CameraFrame(
                rgb=rgb, camera=object_camera(calibration, rgb.shape[:2]), semantic=semantic, instance=instance
            ),
            cloud=read_scan(self._path("velodyne", index, ".bin"), self._rows),
            boxes=self._boxes(sequence, int(number)),
            rect_from_velo=object_rect_from_velo(calibration),
        )

    def name_of(self, index: int) -> str:
        """The sequence and the frame's number in it."""
        return "-".join(self._frames[index])

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from, with its sequence's calibration and labels."""
        sequence, number = self._frames[index]
        files = [self._path("velodyne", index, ".bin"), self._path("image_02", index, ".png")]
        files += [self._folder / name / f"{sequence}.txt" for name in ("calib", "label_02")]
        return files if self._maps is None else [*files, self._maps[sequence] / f"{number}.png"]

    def _path(self, kind: str, index: int, suffix: str) -> Path:
        sequence, number = self._frames[index]
        return self._folder / kind / sequence / f"{number}{suffix}"

    def _boxes(self, sequence: str, number: int) -> Boxes | None:
        path = self._folder / "label_02" / f"{sequence}.txt"
        if not path.parent.is_dir():
            return None
        return _labels(path).get(number, NO_BOXES)

    def _numbers(self, sequence: str) -> list[str]:
        """Frame numbers of a sequence. Raises ValueError where a scan or a panoptic map is missing."""
        images = _files(self._folder / "image_02" / sequence, ".png")
        wanted = [number for number in images if (sequence, number) not in NO_SCAN]
        if not images:
            raise ValueError(
                f"kitti_step: no NUMBER.png in {self._folder / 'image_02' / sequence}; copy the sequence again"
            )
        needs = {"scan": _files(self._folder / "velodyne" / sequence, ".bin")}
        if self._maps is not None:
            if sequence not in self._maps:
                raise ValueError(
                    f"kitti_step: {self.root}: no panoptic maps of sequence {sequence}: neither train/ nor val/ "
                    f"holds {sequence}/; copy both folders of KITTI-STEP"
                )
            needs["panoptic map"] = _files(self._maps[sequence], ".png")
        for kind, found in needs.items():
            missing = sorted(set(wanted) - set(found))
            if missing:
                raise ValueError(
                    f"kitti_step: {self._folder}: sequence {sequence}: {len(missing)} of {len(wanted)} images have "
                    f"no {kind} ({', '.join(missing[:4])}{', ...' if len(missing) > 4 else ''}); copy them, or remove "
                    "these images (only 0001/000177-000180 were published without a scan)"
                )
        return wanted


def read_panoptic(path: Path, size: tuple[int, int]) -> tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Cityscapes ids and instance numbers (class * 1000 + instance, 0 none) of a panoptic map of `size` (h, w)."""
    if not path.is_file():
        raise ValueError(f"kitti_step: there is no {path}; copy the panoptic maps of KITTI-STEP")
    image = read_pixels(path, cv2.IMREAD_UNCHANGED, by="kitti_step")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(
            f"kitti_step: {path} is {image.dtype} with shape {image.shape}; a panoptic map is an 8-bit RGB PNG (class, "
            "instance, instance)"
        )
    if image.shape[:2] != tuple(size):
        h, w = image.shape[:2]
        raise ValueError(f"kitti_step: {path} is {w} x {h}, its image {size[1]} x {size[0]}; they must be one frame's")
    blue, green, red = np.moveaxis(image, -1, 0)
    with placed(f"kitti_step: {path}", then="a panoptic map keeps the class in R and the instance in G * 256 + B"):
        semantic = ids_of_train_ids(red)
    number = green.astype(np.int32) * 256 + blue
    if number.max() >= _DIVISOR:
        raise ValueError(
            f"kitti_step: {path}: instance {number.max()}, but they stay below {_DIVISOR} in G * 256 + B; are the "
            "channels in another order?"
        )
    known = (number > 0) & (red != VOID)
    return semantic, np.where(known, red.astype(np.int32) * _DIVISOR + number, 0)


def _training_folder(root: Path) -> Path:
    folder = root / "training"
    if (folder / "image_02").is_dir():
        return folder
    if (root / "image_02").is_dir():
        raise ValueError(f"kitti_step: {root} is a split of the tracking set; pass the folder above it")
    if (folder / "image_2").is_dir():
        raise ValueError(f"kitti_step: {root} is the object benchmark; use --data.kind kitti_object")
    raise ValueError(f"kitti_step: no training/image_02/: {listing(root)}; pass the folder that holds training/")


def _map_folders(root: Path) -> dict[str, Path]:
    """Folder of each sequence's panoptic maps."""
    for folder in (root / "panoptic_maps", root / "kitti-step" / "panoptic_maps", root / "training" / "panoptic_maps"):
        if folder.is_dir():
            return {p.name: p for part in ("train", "val") for p in sorted((folder / part).glob("[0-9]*"))}
    raise ValueError(
        f"kitti_step: no panoptic_maps/: {listing(root)}; put KITTI-STEP's panoptic_maps/ beside training/, or use "
        "--data.kind kitti_tracking, which has no classes"
    )


def _present(folder: Path, wanted: Sequence[str]) -> tuple[str, ...]:
    """The sequences to read. Raises ValueError for one that is unknown or missing."""
    unknown = [sequence for sequence in wanted if sequence not in SEQUENCES]
    if unknown:
        raise ValueError(
            f"kitti_step: no labelled sequence {unknown[0]!r}; there are {SEQUENCES[0]} to {SEQUENCES[-1]}"
        )
    chosen = tuple(sorted(set(wanted))) or SEQUENCES
    missing = [s for s in chosen if not (folder / "image_02" / s).is_dir()]
    if missing:
        have = [s for s in SEQUENCES if s not in missing and (folder / "image_02" / s).is_dir()]
        raise ValueError(
            f"kitti_step: no sequence {', '.join(missing)} in {folder / 'image_02'}; copy "
            f"{'it' if len(missing) == 1 else 'them'}, or name those to use: --data.scenes {' '.join(have) or '0000'}"
        )
    return chosen


def _files(folder: Path, suffix: str) -> list[str]:
    return [path.stem for path in files_in(folder, suffix)]
