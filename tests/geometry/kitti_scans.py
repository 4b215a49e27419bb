"""The sample scans of KITTI as plain arrays, read without the package's own readers."""

from pathlib import Path

import numpy as np

from jaxsim.frame import Camera
from jaxsim.geometry import camera_from_projection, crop_camera

CROP = (352, 1216)
DRIVE = "kitti_raw/2011_09_26/2011_09_26_drive_XXXX_sync"
RAW = [f"{DRIVE}/velodyne_points/data/{i:010d}.bin" for i in range(6)]
OBJECT = [f"kitti_object/training/velodyne/{i:06d}.bin" for i in range(3)]
COMPENSATED = "semantickitti/sequences/XX/velodyne/000000.bin"
CROPPED = "kitti_object_fovcrop/training/velodyne_reduced/000134.bin"
FULL = [*RAW, *OBJECT, COMPENSATED]


def points(samples: Path, scan: str) -> np.ndarray:
    """(n, 4): x, y, z, intensity."""
    return np.fromfile(samples / scan, np.float32).reshape(-1, 4)


def _numbers(path: Path) -> dict[str, np.ndarray]:
    lines = (line.partition(":") for line in path.read_text().splitlines() if ":" in line)
    return {key: np.array(text.split(), float) for key, _, text in lines if key != "calib_time"}


def _square(rotation: np.ndarray, shift: np.ndarray | None = None) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = rotation.reshape(3, 3)
    if shift is not None:
        out[:3, 3] = shift
    return out


def camera(samples: Path, scan: str) -> tuple[Camera, tuple[int, int]]:
    """Camera 2 of a scan's frame and the size (h, w) of its image."""
    stem = Path(scan).stem
    if scan in RAW:
        folder = samples / "kitti_raw/2011_09_26"
        cams, velo = (_numbers(folder / f"calib_{name}.txt") for name in ("cam_to_cam", "velo_to_cam"))
        cam0_from_velo = _square(cams["R_rect_00"]) @ _square(velo["R"], velo["T"])
        projection, image = cams["P_rect_02"], samples / DRIVE / f"image_02/data/{stem}.png"
    else:
        folder = samples / scan.partition("/velodyne")[0]
        calib = _numbers(folder / f"calib/{stem}.txt")
        velo_to_cam = calib["Tr_velo_to_cam"].reshape(3, 4)
        cam0_from_velo = _square(calib["R0_rect"]) @ _square(velo_to_cam[:, :3], velo_to_cam[:, 3])
        projection, image = calib["P2"], folder / f"image_2/{stem}.png"
    width, height = np.frombuffer(image.read_bytes()[16:24], ">u4")
    return camera_from_projection(projection.reshape(3, 4), cam0_from_velo), (int(height), int(width))


def cropped_camera(samples: Path, scan: str) -> Camera:
    """Camera 2 with its image cut to 352 x 1216, bottom and middle."""
    full, (height, width) = camera(samples, scan)
    return crop_camera(full, height - CROP[0], round((width - CROP[1]) / 2))
