"""KITTI's depth completion set (Uhrig et al., 3DV 2017): sparse and accumulated depth of the raw drives' images.

    ROOT/{train,val}/DRIVE_sync/proj_depth/{velodyne_raw,groundtruth}/image_02/NUMBER.png
    RAW/DATE/DRIVE_sync/image_02/data/NUMBER.png     RAW/DATE/calib_*.txt

or the selected validation images, already cropped to 352 x 1216:

    ROOT/{image,velodyne_raw,groundtruth_depth,intrinsics}/...

Depth is 16-bit PNG, metres times 256, 0 where there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.kitti_files import raw_camera, read_image
from jaxsim.frame import DepthFrame

Array = np.ndarray
PARTS = ("train", "val")
SELECTED = ("image", "velodyne_raw", "groundtruth_depth", "intrinsics")


def read_depth(path: Path) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """Depth in metres of a 16-bit PNG, and where it has any. Raises ValueError for other files."""
    if not path.is_file():
        raise ValueError(f"kitti_depth: no file {path}")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(f"kitti_depth: {path} is no 16-bit grey PNG (metres times 256); copy it again")
    return image.astype(np.float32) / np.float32(256), image > 0


def write_depth(path: Path, depth_m: Float[Array, "h w"], valid: Bool[Array, "h w"]) -> None:
    """Depth in the benchmark's own form. Raises ValueError where a depth does not fit: 1/256 to 255.99 m."""
    scaled = np.round(np.where(valid, depth_m, 0) * 256)
    if not np.isfinite(scaled).all() or scaled.max(initial=0) > 65535 or (valid & (scaled < 1)).any():
        raise ValueError("kitti_depth: valid depths must lie between 1/256 and 255.99 m; mask out the others")
    cv2.imwrite(str(path), scaled.astype(np.uint16))


@dataclass(frozen=True)
class _Files:
    image: Path
    sparse: Path
    truth: Path
    camera: Path
    """Folder of a date's calibration, or a text of nine numbers."""


class KittiDepth:
    """Frames of depth completion, cropped: bottom rows, middle columns."""

    name = "kitti_depth"

    def __init__(
        self, root: Path, raw: Path | None = None, *, part: str = "train", crop: tuple[int, int] = (352, 1216)
    ):
        self.crop = crop
        if part not in PARTS:
            raise ValueError(f"kitti_depth: no part {part!r}; known: {', '.join(PARTS)}")
        selected = all((root / name).is_dir() for name in SELECTED)
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
        return path.stem if len(path.parts) < 5 or "_sync" not in path.parts[-5] else f"{path.parts[-5]}-{path.stem}"

    def __getitem__(self, index: int) -> DepthFrame:
        """Raises ValueError that names the file where rasters differ in size or are smaller than the crop."""
        files = self.files[index]
        rgb = read_image(files.image)
        sparse_m, given = read_depth(files.sparse)
        truth_m, known = read_depth(files.truth)
        if not rgb.shape[:2] == sparse_m.shape == truth_m.shape:
            raise ValueError(
                f"kitti_depth: {files.image} is {rgb.shape[:2]}, {files.sparse} {sparse_m.shape}, {files.truth} "
                f"{truth_m.shape}; all must be of one frame"
            )
        (h, w), (rows, columns) = truth_m.shape, self.crop
        if h < rows or w < columns:
            raise ValueError(
                f"kitti_depth: {files.image} is {h} x {w}, smaller than the crop {rows} x {columns}; lower --image-crop"
            )
        if files.camera.is_dir():
            intrinsics = np.array(raw_camera(files.camera, (h, w)).intrinsics, np.float32)
        else:
            intrinsics = np.array(files.camera.read_text().split(), np.float32).reshape(3, 3)
        top, left = h - rows, round((w - columns) / 2)
        intrinsics[:2, 2] -= left, top
        view = np.s_[top:, left : left + columns]
        return DepthFrame(rgb[view], sparse_m[view], given[view], truth_m[view], known[view], intrinsics)


def _drives(root: Path, raw: Path | None, part: str) -> list[_Files]:
    files = []
    for truth in sorted((root / part).glob("*_sync/proj_depth/groundtruth/image_02/*.png")):
        drive = truth.parents[3].name
        if raw is None:
            raise ValueError(f"kitti_depth: {drive}'s images are in the raw drives; name their folder with --data.root")
        date = raw / drive[:10]
        sparse = truth.parents[2] / "velodyne_raw" / "image_02" / truth.name
        files.append(_Files(date / drive / "image_02" / "data" / truth.name, sparse, truth, date))
    return files


def _selected(root: Path) -> list[_Files]:
    files = []
    for image in sorted((root / "image").glob("*.png")):
        one = lambda folder: image.name.replace("_sync_image_", f"_sync_{folder}_")  # noqa: B023, E731
        files.append(
            _Files(
                image,
                root / "velodyne_raw" / one("velodyne_raw"),
                root / "groundtruth_depth" / one("groundtruth_depth"),
                root / "intrinsics" / f"{image.stem}.txt",
            )
        )
    return files
