"""KITTI's depth completion set (Uhrig et al., 3DV 2017): sparse and accumulated depth of the raw drives' images.

    ROOT/{train,val}/DRIVE_sync/proj_depth/{velodyne_raw,groundtruth}/image_0{2,3}/NUMBER.png
    RAW/DATE/DRIVE_sync/image_0{2,3}/data/NUMBER.png     RAW/DATE/calib_*.txt

of both colour cameras (85 898 + 6852 frames), or 1000 selected validation images, already cropped to 352 x 1216:

    ROOT/{image,velodyne_raw,groundtruth_depth,intrinsics}/...

Depth is 16-bit PNG, metres times 256, 0 where there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.calibration import check_pinhole
from jaxsim.data.kitti_files import raw_camera, read_image
from jaxsim.files import files_in, numbers, placed, read_pixels, read_text
from jaxsim.frame import DepthFrame
from jaxsim.geometry.camera import crop_depth_frame

PARTS = ("train", "val")
SELECTED = ("image", "velodyne_raw", "groundtruth_depth", "intrinsics")


def read_kitti_depth(path: Path) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Depth in metres of a 16-bit PNG, and where it has any. Raises ValueError for other files."""
    if not path.is_file():
        raise ValueError(f"kitti_depth: no file {path}")
    image = read_pixels(path, cv2.IMREAD_UNCHANGED, by="kitti_depth")
    if image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(f"kitti_depth: {path} is no 16-bit grey PNG (metres times 256); copy it again")
    return image.astype(np.float32) / np.float32(256), image > 0


@dataclass(frozen=True)
class _Files:
    image: Path
    sparse: Path
    truth: Path
    calibration: Path
    """Folder of a date's calibration, or a text of nine numbers."""
    camera: int = 2
    """Of a raw drive: 2 left, 3 right."""


class KittiDepth(Sequence[DepthFrame]):
    """Frames of depth completion, cropped: bottom rows, middle columns; read from disk when asked for."""

    name = "kitti_depth"

    def __init__(
        self, root: Path, raw: Path | None = None, *, part: str = "train", crop: tuple[int, int] = (352, 1216)
    ):
        """Lists the frames of a part; `raw` holds the raw drives (2011_09_26/ ...), for images and cameras.

        Raises ValueError where there are none, where drives have no images, and where the selected validation images
        are asked for a training.
        """
        self.crop = crop
        if part not in PARTS:
            raise ValueError(f"kitti_depth: no part {part!r}; known: {', '.join(PARTS)}")
        selected = all((root / name).is_dir() for name in SELECTED)
        if selected and part == "train":
            raise ValueError(
                f"kitti_depth: {root} holds the selected validation images, not to be trained on; give the folder that "
                "holds train/ and val/ as --depth-root, and this one as --depth-validation"
            )
        self.files = _selected(root) if selected else _drives(root, raw, part)
        if not self.files:
            raise ValueError(
                f"kitti_depth: no ground truth under {root}; give the folder that holds train/ and val/ with "
                "*_sync/proj_depth (data_depth_annotated.zip, data_depth_velodyne.zip), or val_selection_cropped"
            )

    def __len__(self) -> int:
        return len(self.files)

    def name_of(self, index: int) -> str:
        """Drive, camera and number, as the truth's file has them."""
        path = self.files[index].truth
        if len(path.parts) < 5 or "_sync" not in path.parts[-5]:
            return path.stem
        return f"{path.parts[-5]}-{path.parts[-2]}-{path.stem}"

    def __getitem__(self, index: Any) -> Any:
        """One `DepthFrame`.

        Raises ValueError that names the file where rasters differ in size or are smaller than the crop.
        """
        files = self.files[index]
        rgb = read_image(files.image)
        sparse_m, given = read_kitti_depth(files.sparse)
        truth_m, known = read_kitti_depth(files.truth)
        if not rgb.shape[:2] == sparse_m.shape == truth_m.shape:
            raise ValueError(
                f"kitti_depth: {files.image} is {rgb.shape[:2]}, {files.sparse} {sparse_m.shape}, {files.truth} "
                f"{truth_m.shape}; all must be of one frame"
            )
        if files.calibration.is_dir():
            intrinsics = raw_camera(files.calibration, truth_m.shape, camera=files.camera).intrinsics
        else:
            intrinsics = _intrinsics(files.calibration, truth_m.shape)
        with placed(f"kitti_depth: {files.image}", then="lower --image-crop"):
            return crop_depth_frame(DepthFrame(rgb, sparse_m, given, truth_m, known, intrinsics), self.crop)


def _intrinsics(path: Path, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """K of a text of nine numbers. Raises ValueError where it holds others, or no camera's."""
    values = np.array(numbers(read_text(path, by="kitti_depth").split(), where=f"kitti_depth: {path}"))
    if len(values) != 9:
        raise ValueError(f"kitti_depth: {path} has {len(values)} numbers; a camera matrix has nine")
    check_pinhole(values.reshape(3, 3), size, f"kitti_depth: {path}", axis=0.2)  # of an image that was cropped
    return values.reshape(3, 3).astype(np.float32)


def _drives(root: Path, raw: Path | None, part: str) -> list[_Files]:
    files = []
    folders = sorted((root / part).glob("*_sync/proj_depth/groundtruth/image_0[23]"))
    for truth in (file for folder in folders for file in files_in(folder, ".png")):
        drive, camera = truth.parents[3].name, truth.parent.name
        if raw is None:
            raise ValueError(f"kitti_depth: {drive}'s images are in the raw drives; name their folder with --data.root")
        date = raw / drive[:10]
        sparse = truth.parents[2] / "velodyne_raw" / camera / truth.name
        files.append(_Files(date / drive / camera / "data" / truth.name, sparse, truth, date, int(camera[-2:])))
    if missing := [folder for folder in sorted({one.image.parent for one in files}) if not folder.is_dir()]:
        raise ValueError(
            f"kitti_depth: no {missing[0]}, and {len(missing) - 1} more such folders; --data.root must hold the synced "
            f"raw drives of all {len({one.truth.parents[3] for one in files})} drives of {root / part}"
        )
    return files


def _selected(root: Path) -> list[_Files]:
    files = []
    for image in files_in(root / "image", ".png"):
        sparse = root / "velodyne_raw" / image.name.replace("_sync_image_", "_sync_velodyne_raw_")
        truth = root / "groundtruth_depth" / image.name.replace("_sync_image_", "_sync_groundtruth_depth_")
        files.append(_Files(image, sparse, truth, root / "intrinsics" / f"{image.stem}.txt"))
    return files
