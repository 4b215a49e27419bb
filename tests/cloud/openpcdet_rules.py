"""What OpenPCDet's KITTI reader demands of a tree, written down without the package's own readers.

From what pcdet/datasets/kitti/kitti_dataset.py, pcdet/utils/calibration_kitti.py and object3d_kitti.py do with the
files.
"""

from pathlib import Path

import cv2
import numpy as np


def listed(root: Path, split: str) -> list[str]:
    """Frame numbers of a split: one a line, stripped."""
    with (root / "ImageSets" / f"{split}.txt").open() as file:
        return [line.strip() for line in file]


def calibration(path: Path) -> dict[str, np.ndarray]:
    """By the number of the line, and split at single blanks; float32."""
    with path.open() as file:
        lines = file.readlines()

    def numbers(k: int, shape: tuple[int, int]) -> np.ndarray:
        return np.array(lines[k].strip().split(" ")[1:], np.float32).reshape(shape)

    return {"P2": numbers(2, (3, 4)), "P3": numbers(3, (3, 4)), "R0": numbers(4, (3, 3)), "Tr": numbers(5, (3, 4))}


def objects(path: Path) -> list[dict]:
    """One a line, split at single blanks: a blank line, or a doubled blank, ends in an error."""
    found = []
    for line in path.read_text().splitlines():
        label = line.strip().split(" ")
        numbers = [float(v) for v in label[1:]]
        assert len(numbers) == 14, line
        h, w, l = numbers[7:10]  # noqa: E741
        found.append(
            {"kind": label[0], "truncated": numbers[0], "occluded": numbers[1], "alpha": numbers[2],
             "bbox": np.array(numbers[3:7], np.float32), "lwh": np.array([l, h, w]), "place": np.array(numbers[10:13]),
             "ry": numbers[13]}
        )  # fmt: skip
    return found


def accept(root: Path, split: str = "trainval", *, keep_empty: bool = False) -> dict[str, dict]:
    """Reads every frame of a split as get_infos does; AssertionError where it would fail or read something else."""
    frames = {}
    for number in listed(root, split):
        folder = root / "training"
        assert len(number) == 6
        points = np.fromfile(str(folder / f"velodyne/{number}.bin"), np.float32).reshape(-1, 4)
        assert len(points)
        assert np.isfinite(points).all()
        assert points[:, 3].min() >= 0
        assert points[:, 3].max() <= 1
        image = cv2.imread(str(folder / f"image_2/{number}.png"))
        assert image.dtype == np.uint8
        calib = calibration(folder / f"calib/{number}.txt")
        found = objects(folder / f"label_2/{number}.txt")
        assert found or keep_empty  # np.concatenate of no box fails there
        real = [thing for thing in found if thing["kind"] != "DontCare"]
        # Objects are taken from the front, as many as are no DontCare.
        assert [thing["kind"] for thing in found[: len(real)]] == [thing["kind"] for thing in real]
        for thing in real:
            assert (thing["lwh"] > 0).all()
            assert thing["occluded"] == int(thing["occluded"])
            x, _, z = thing["place"]
            off = thing["ry"] - np.arctan2(x, z) - thing["alpha"]
            assert abs((off + np.pi) % (2 * np.pi) - np.pi) < 1e-4
        frames[number] = {"points": points, "boxes": boxes(real, calib), "calib": calib, "size": image.shape[:2]}
        frames[number] |= {"objects": real, "in_image": in_image(points[:, :3], calib, image.shape[:2])}
    return frames


def boxes(found: list[dict], calib: dict[str, np.ndarray]) -> np.ndarray:
    """gt_boxes_lidar: x, y, z of the middle, l, w, h, heading."""
    if not found:
        return np.zeros((0, 7))
    place = np.array([thing["place"] for thing in found], np.float32)
    lhw = np.array([thing["lwh"] for thing in found], np.float32)
    r0, velo = np.eye(4, dtype=np.float32), np.eye(4, dtype=np.float32)
    r0[:3, :3], velo[:3] = calib["R0"], calib["Tr"]
    homogeneous = np.column_stack([place, np.ones(len(place), np.float32)])
    lidar = (homogeneous @ np.linalg.inv((r0 @ velo).T))[:, :3]
    lidar[:, 2] += lhw[:, 1] / 2
    heading = -(np.pi / 2 + np.array([thing["ry"] for thing in found]))
    return np.column_stack([lidar, lhw[:, [0, 2, 1]], heading])


def in_image(xyz: np.ndarray, calib: dict[str, np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """FOV_POINTS_ONLY: inside the image, and not behind; divided by the rectified depth."""
    rect = np.column_stack([xyz, np.ones(len(xyz))]) @ (calib["Tr"].T @ calib["R0"].T)
    pixel = np.column_stack([rect, np.ones(len(xyz))]) @ calib["P2"].T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = pixel[:, 0] / rect[:, 2], pixel[:, 1] / rect[:, 2]
    return (u >= 0) & (u < size[1]) & (v >= 0) & (v < size[0]) & (pixel[:, 2] - calib["P2"][2, 3] >= 0)


def points_in(box: np.ndarray, points: np.ndarray, *, grown_m: float = 0.0) -> np.ndarray:
    """Which points a box holds."""
    offset = points[:, :3] - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    local = np.stack(
        [cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0], offset[:, 2]], -1
    )
    return (np.abs(local) <= box[3:6] / 2 + grown_m).all(axis=1)
