"""Writes frames of the embedded world in the exact on-disk formats of KITTI-STEP: there are no samples to be had.

The formats are those of the KITTI devkits and of KITTI-STEP's description; `test_kitti_step.py` checks the files
against each fact, without the reader.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from jaxsim.data.cityscapes import IDS, TRAIN_CLASSES
from jaxsim.frame import Frame

TRAIN_ID = {IDS[name]: number for number, name in enumerate(TRAIN_CLASSES)}
STEP_THINGS = (IDS["person"], IDS["car"])
"""The two classes whose instances KITTI-STEP numbers."""
PROJECTION = "721.5377 0 609.5593 {} 0 721.5377 172.854 {} 0 0 1 {}"
FOURTH = ("0 0 0", "-387.5744 0 0", "44.85728 0.2163791 0.002745884", "-339.5242 2.199936 0.002729905")
RECTIFY = "0.9999239 0.00983776 -0.007445048 -0.009869795 0.9999421 -0.004278459 0.007402527 0.004351614 0.9999631"
CAM_FROM_VELO = (
    "0.007533745 -0.9999714 -0.000616602 -0.004069766 0.01480249 0.0007280733 -0.9998902 -0.07631618 "
    "0.9998621 0.00752379 0.01480755 -0.2717806"
)
VELO_FROM_IMU = "0.9999976 0.0007553071 -0.002035826 -0.8086759 -0.0007854027 0.9998898 -0.01482298 0.3195559 "
VELO_FROM_IMU += "0.002024406 0.01482454 0.9998881 -0.7997231"


def write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def write_step(root: Path, part: str, sequence: str, frames: dict[int, Frame], *, without_scan: tuple[int, ...] = ()):
    """One sequence of KITTI tracking with KITTI-STEP's panoptic maps in `part` (train or val)."""
    folder = root / "training"
    labels = []
    for number, frame in frames.items():
        name = f"{number:06d}"
        write_png(folder / "image_02" / sequence / f"{name}.png", frame.camera.rgb[..., ::-1])
        write_png(root / "panoptic_maps" / part / sequence / f"{name}.png", panoptic(frame)[..., ::-1])
        labels += tracking_lines(number, frame)
        if number in without_scan:
            continue
        scan = folder / "velodyne" / sequence / f"{name}.bin"
        scan.parent.mkdir(parents=True, exist_ok=True)
        points = np.column_stack([np.round(frame.cloud.xyz_m, 3), frame.cloud.intensity])
        points.astype("<f4").tofile(scan)
    calibration = [f"P{k}: " + PROJECTION.format(*fourth.split()) for k, fourth in enumerate(FOURTH)]
    calibration += [f"R_rect {RECTIFY}", f"Tr_velo_cam {CAM_FROM_VELO}", f"Tr_imu_velo {VELO_FROM_IMU}"]
    for kind, lines in (("calib", calibration), ("label_02", labels)):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        (folder / kind / f"{sequence}.txt").write_text("\n".join(lines) + "\n")


def panoptic(frame: Frame) -> np.ndarray:
    """R: train id, 255 void; G * 256 + B: instances of persons and cars, each class counting from 1."""
    semantic, instance = frame.camera.semantic, frame.camera.instance
    out = np.zeros((*semantic.shape, 3), np.uint8)
    out[..., 0] = np.vectorize(lambda i: TRAIN_ID.get(int(i), 255), otypes=[np.uint8])(semantic)
    for thing in STEP_THINGS:
        for number, of in enumerate(np.unique(instance[(semantic == thing) & (instance > 0)]), 1):
            out[(semantic == thing) & (instance == of), 1:] = number // 256, number % 256
    return out


def tracking_lines(number: int, frame: Frame) -> list[str]:
    """17 columns: frame, track, type, truncated (a level), occluded, alpha, box, h w l, x y z, rotation_y."""
    boxes, lines = frame.boxes, []
    assert boxes is not None
    for k, kind in enumerate(boxes.kind):
        (x, y, z), (length, width, height) = boxes.centre_m[k], boxes.size_m[k]
        yaw = float(boxes.yaw_rad[k])
        alpha = (yaw - np.arctan2(x, z) + np.pi) % (2 * np.pi) - np.pi
        numbers = [alpha, *boxes.bbox_px[k], height, width, length, x, y, z, yaw]
        level = int(boxes.truncated[k] > 0) + int(boxes.truncated[k] > 0.5)
        values = " ".join(f"{value:.6f}" for value in numbers)
        lines.append(f"{number} {k} {kind} {level} {boxes.occluded[k]} {values}")
    return [*lines, f"{number} -1 DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1000 -1000 -1000 -10 -1 -1 -1"]
