"""Readers of other people's files: KITTI and its kin, Virtual KITTI 2, nuScenes, Ouster, clouds, labels."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np

from jaxsim.data.clouds import read_cloud, read_scan
from jaxsim.data.kitti import KittiObject, KittiRaw
from jaxsim.data.kitti_depth import KittiDepth
from jaxsim.data.kitti_depth import read_kitti_depth as read_kitti_depth
from jaxsim.data.kitti_files import (
    object_camera,
    object_rect_from_velo,
    raw_camera,
    read_image,
    read_labels,
    read_motion,
    read_plane,
    read_tracking_labels,
    read_velodyne,
)
from jaxsim.data.kitti_step import KittiStep, read_panoptic
from jaxsim.data.sweeps import read_lidar_top, read_pcap
from jaxsim.data.vkitti2 import VirtualKitti2
from jaxsim.data.vkitti2_files import (
    COLOURS,
    HEADERS,
    read_classes,
    read_colours,
    read_depth,
    read_extrinsics,
    read_instances,
    read_objects,
)
from jaxsim.metrics.detection.files import frame_list, read_detections, read_truth
from tests.data.drives import CAM_FROM_VELO
from tests.data.fixtures import CAR, DONT_CARE, P2, R0, VELO_R, VELO_T
from tests.fuzz.reader import Reader, one

SIZE = (375, 1242)
OUSTER = Path(os.environ.get("JAXSIM_SAMPLE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "ouster"
_rng = np.random.default_rng(0)


def _points(n: int = 400) -> np.ndarray:
    """A ring of points 5 to 40 m away, intensity 0..1."""
    azimuth = np.linspace(np.pi, -np.pi, n, endpoint=False)
    r, z = _rng.uniform(5, 40, n), _rng.uniform(-1.8, 1.0, n)
    return np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), z, _rng.uniform(0, 1, n)]).astype("<f4")


def _sweep() -> bytes:
    points = _points(1084 * 32)
    points[:, 3] *= 255
    return np.column_stack([points, np.arange(len(points)) % 32]).astype("<f4").tobytes()


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def _indexed(size: tuple[int, int] = (12, 20)) -> bytes:
    import io

    from PIL import Image

    image = Image.fromarray((_rng.integers(0, 5, size)).astype(np.uint8), mode="P")
    image.putpalette([k * 7 % 256 for k in range(768)])
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


def small_drive(root: Path, frames: int = 1) -> None:
    """A raw drive in 12 x 40 pixels, with its clock and its motion."""
    date = root / "2011_09_26"
    drive = date / "2011_09_26_drive_0001_sync"
    for name, content in {
        date / "calib_cam_to_cam.txt": f"calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 40 12\n"
        f"R_rect_00: {R0}\nP_rect_02: {_SMALL_P2}\n",
        date / "calib_velo_to_cam.txt": f"calib_time: 15-Mar-2012\nR: {VELO_R}\nT: {VELO_T}\n",
        drive / "velodyne_points/timestamps.txt": "2011-09-26 13:02:25.594360375\n" * frames,
    }.items():
        one(name.name, content)(name.parent)
    for k in range(frames):
        one(f"{k:010d}.txt", _OXTS)(drive / "oxts/data")
        one(f"{k:010d}.bin", _points().tobytes())(drive / "velodyne_points/data")
        one(f"{k:010d}.png", _png(_RGB))(drive / "image_02/data")


def small_object(root: Path, frames: int = 1) -> None:
    """Frames of the object benchmark in 12 x 40 pixels, with lists and road planes."""
    folder = root / "training"
    for k in range(frames):
        one(f"velodyne/{k:06d}.bin", _points().tobytes())(folder)
        one(f"image_2/{k:06d}.png", _png(_RGB))(folder)
        one(f"calib/{k:06d}.txt", _CALIB.replace(P2, _SMALL_P2))(folder)
        one(f"label_2/{k:06d}.txt", f"{CAR}\n{DONT_CARE}\n")(folder)
        one(f"planes/{k:06d}.txt", _PLANE)(folder)
    one("ImageSets/val.txt", "".join(f"{k:06d}\n" for k in range(frames)))(root)


def _object_frame(root: Path) -> object:
    frames = KittiObject(root, rows="elevation")
    return frames[0], frames.splits


def _depth_frames(root: Path) -> None:
    depth = (_rng.uniform(2, 70, (12, 40)) * 256).astype(np.uint16)
    name = "2011_09_26_drive_0002_sync_{}_0000000005_image_02.png"
    one(f"image/{name.format('image')}", _png(_RGB))(root)
    one(f"velodyne_raw/{name.format('velodyne_raw')}", _png(depth))(root)
    one(f"groundtruth_depth/{name.format('groundtruth_depth')}", _png(depth))(root)
    one(f"intrinsics/{name.format('image')[:-4]}.txt", "23.2 0.0 20.0 0.0 23.2 6.0 0.0 0.0 1.0\n")(root)


def _virtual_texts(root: Path) -> None:
    """info.txt, bbox.txt and pose.txt of two vehicles in two frames."""
    info = [HEADERS["info"], "0 Car Acura Red", "1 Van Ford Blue"]
    boxes = [HEADERS["bbox"]] + [f"{f} 0 {t} 100 200 80 160 4000 0.0 0.7 True" for f in (0, 1) for t in (0, 1)]
    pose = [HEADERS["pose"]]
    pose += [f"{f} 0 {t} -1.5 1.8 1.5 4.2 10 1 20 0.1 0 0 -3.2 1.7 15.5 -1.55 0 0" for f in (0, 1) for t in (0, 1)]
    for name, lines in (("info", info), ("bbox", boxes), ("pose", pose)):
        one(f"{name}.txt", "\n".join(lines) + "\n")(root)


def _virtual_frame(root: Path) -> None:
    """A frame of Virtual KITTI 2 in 12 x 40 pixels."""
    drive = root / "Scene01" / "clone"
    (drive / "frames").mkdir(parents=True)
    _virtual_texts(drive)
    one("colors.txt", f"{HEADERS['colors']}\nCar 255 127 80\nRoad 100 60 100\n")(drive)
    one("intrinsic.txt", f"{HEADERS['intrinsic']}\n0 0 23.36 23.36 20 6\n")(drive)
    one("extrinsic.txt", f"{HEADERS['extrinsic']}\n0 0 1 0 0 3.5 0 1 0 -2 0 0 1 9 0 0 0 1\n")(drive)
    for kind, name, data in (
        ("rgb", "rgb_00000.jpg", cv2.imencode(".jpg", _RGB)[1].tobytes()),
        ("depth", "depth_00000.png", _png(_rng.integers(200, 60000, (12, 40)).astype(np.uint16))),
        ("classSegmentation", "classgt_00000.png", _png(np.full((12, 40, 3), (80, 127, 255), np.uint8))),
        ("instanceSegmentation", "instancegt_00000.png", _indexed((12, 40))),
    ):
        one(name, data)(drive / "frames" / kind / "Camera_0")


def _step_frame(root: Path) -> None:
    """A frame of KITTI-STEP in 12 x 40 pixels."""
    one("image_02/0000/000000.png", _png(_RGB))(root / "training")
    one("velodyne/0000/000000.bin", _points().tobytes())(root / "training")
    one("calib/0000.txt", _TRACKING.replace(P2, _SMALL_P2))(root / "training")
    one("label_02/0000.txt", f"0 1 {CAR}\n")(root / "training")
    one("panoptic_maps/train/0000/000000.png", _png(np.zeros((12, 40, 3), np.uint8)))(root)


def _ouster(root: Path) -> None:
    for suffix in (".json", ".pcap"):
        shutil.copy(OUSTER / f"OS-1-32-G_v2.1.1_1024x10{suffix}", root / f"drive{suffix}")


_RGB = _rng.integers(0, 255, (12, 40, 3)).astype(np.uint8)
_SMALL_P2 = " ".join(
    f"{v:.7g}" for v in (np.array(P2.split(), float).reshape(3, 4) * [[40 / 1242], [12 / 375], [1]]).ravel()
)
_VELO = " ".join(np.column_stack([np.array(VELO_R.split()).reshape(3, 3), VELO_T.split()]).ravel())
_CALIB = f"P2: {P2}\nR0_rect: {R0}\nTr_velo_to_cam: {_VELO}\n\n"
_TRACKING = f"P2: {P2}\nR_rect {R0}\nTr_velo_cam {CAM_FROM_VELO}\n"
_OXTS = " ".join(["49.01", "8.43", "112.8", "0.03", "0.01", "-1.2", "0.1", "0.2", "9.5", *["0.1"] * 21]) + "\n"
_PLANE = "# Matrix\nWIDTH 4\nHEIGHT 1\n-7.05e-03 -9.99e-01 -1.78e-02 1.65e+00\n"
_DETECTION = f"{CAR} 0.93\n"
_LABEL = {"size_m": (0, 100), "centre_m": (-1e4, 1e4), "bbox_px": (-1e4, 1e4)}
_CLOUD = {"xyz_m": (-1e3, 1e3), "intensity": (0, 1)}
_NEAR = {"intrinsics": (-100, 1e4), "cam_from_velo": (-20, 20)}

RECORDINGS: dict[str, Reader] = {
    "kitti scan": Reader(one("a.bin", _points().tobytes()), lambda f: read_velodyne(f / "a.bin"), largest=1e3),
    "kitti scan, lines": Reader(
        one("a.bin", _points().tobytes()), lambda f: read_scan(f / "a.bin", "elevation"), within=_CLOUD
    ),
    "kitti image": Reader(one("a.png", _png(_RGB)), lambda f: read_image(f / "a.png")),
    "kitti object camera": Reader(one("c.txt", _CALIB), lambda f: object_camera(f / "c.txt", SIZE), within=_NEAR),
    "kitti object rect": Reader(one("c.txt", _CALIB), lambda f: object_rect_from_velo(f / "c.txt"), largest=20),
    "kitti tracking camera": Reader(one("c.txt", _TRACKING), lambda f: object_camera(f / "c.txt", SIZE), within=_NEAR),
    "kitti tracking rect": Reader(one("c.txt", _TRACKING), lambda f: object_rect_from_velo(f / "c.txt"), largest=20),
    "kitti raw camera": Reader(
        small_drive, lambda f: raw_camera(f / "2011_09_26", (12, 40)), ("*/calib*.txt",), within=_NEAR
    ),
    "kitti raw drive": Reader(
        small_drive, lambda f: KittiRaw(f, rows="elevation")[0], within={**_CLOUD, **_NEAR}, largest=1e10
    ),
    "kitti object frame": Reader(small_object, _object_frame, within={**_CLOUD, **_NEAR, **_LABEL}),
    "kitti labels": Reader(
        one("l.txt", f"{CAR}\n{CAR}\n{DONT_CARE}\n"), lambda f: read_labels(f / "l.txt"), within=_LABEL
    ),
    "kitti tracking labels": Reader(
        one("l.txt", f"0 1 {CAR}\n1 1 {CAR}\n"), lambda f: read_tracking_labels(f / "l.txt"), within=_LABEL
    ),
    "kitti motion": Reader(one("o.txt", _OXTS), lambda f: read_motion(f / "o.txt"), largest=200),
    "kitti plane": Reader(one("p.txt", _PLANE), lambda f: read_plane(f / "p.txt"), largest=100),
    "kitti depth png": Reader(
        one("d.png", _png((_rng.uniform(2, 70, (12, 20)) * 256).astype(np.uint16))),
        lambda f: read_kitti_depth(f / "d.png"),
    ),
    "kitti depth frame": Reader(_depth_frames, lambda f: KittiDepth(f, part="val", crop=(12, 40))[0], largest=1e4),
    "kitti panoptic map": Reader(
        one("m.png", _png(np.zeros((12, 20, 3), np.uint8))), lambda f: read_panoptic(f / "m.png", (12, 20))
    ),
    "vkitti2 depth": Reader(
        one("d.png", _png(_rng.integers(200, 60000, (12, 20)).astype(np.uint16))), lambda f: read_depth(f / "d.png")
    ),
    "vkitti2 classes": Reader(
        one("c.png", _png(np.full((12, 20, 3), (80, 127, 255), np.uint8))), lambda f: read_classes(f / "c.png", COLOURS)
    ),
    "vkitti2 instances": Reader(one("i.png", _indexed()), lambda f: read_instances(f / "i.png")),
    "vkitti2 colours": Reader(
        one("colors.txt", f"{HEADERS['colors']}\nCar 255 127 80\nRoad 100 60 100\n"),
        lambda f: read_colours(f / "colors.txt"),
        largest=255,
    ),
    "vkitti2 frame": Reader(
        _virtual_frame,
        lambda f: VirtualKitti2(f, scenes=("Scene01",), variations=("clone",))[0],
        within=_NEAR,
        largest=1e6,
    ),
    "kitti step frame": Reader(
        _step_frame,
        lambda f: KittiStep(f, sequences=("0000",), rows="elevation")[0],
        within={**_CLOUD, **_NEAR, **_LABEL},
    ),
    "vkitti2 extrinsics": Reader(
        one("e.txt", f"{HEADERS['extrinsic']}\n0 0 1 0 0 3.5 0 1 0 -2 0 0 1 9 0 0 0 1\n"),
        lambda f: read_extrinsics(f / "e.txt"),
        largest=1e5,
    ),
    "vkitti2 objects": Reader(_virtual_texts, read_objects, largest=1e6),
    "nuscenes sweep": Reader(
        one("n015__LIDAR_TOP__1532402927647951.pcd.bin", _sweep()),
        lambda f: read_lidar_top(f / "n015__LIDAR_TOP__1532402927647951.pcd.bin"),
        within={"range_m": (0, 1e3), "intensity": (0, 1)},
        largest=1e11,
    ),
    "cloud bin": Reader(one("a.bin", _points().tobytes()), lambda f: read_cloud(f / "a.bin"), largest=1e3),
    "detections": Reader(one("000000.txt", _DETECTION), read_detections, largest=1e5),
    "truth": Reader(one("000000.txt", f"{CAR}\n{DONT_CARE}\n"), lambda f: read_truth(f, ["000000"]), largest=1e5),
    "frame list": Reader(one("val.txt", "000000\n000003\n000007\n"), lambda f: frame_list(f / "val.txt")),
}
"""By what they read."""
if OUSTER.is_dir():
    RECORDINGS["ouster recording"] = Reader(_ouster, lambda f: next(iter(read_pcap(f / "drive.pcap"))), largest=1e12)
