"""Two sequences of the odometry benchmark with SemanticKITTI's labels, in few points."""

from pathlib import Path

import numpy as np
import pytest

from tests.data.fixtures import P2, R0, VELO_R, VELO_T
from tests.data.round_room import scan, write_image, write_scan

ROAD, BUILDING = 40, 50
"""Labels of SemanticKITTI."""


@pytest.fixture
def odometry_root(tmp_path: Path) -> Path:
    """Sequence 00 with two labelled scans, the first of them with an image; 08 with one labelled, 11 with one bare."""
    rectify = np.array(R0.split(), float).reshape(3, 3)
    place = rectify @ np.column_stack([np.array(VELO_R.split(), float).reshape(3, 3), np.array(VELO_T.split(), float)])
    calibration = "".join(f"P{k}: {P2}\n" for k in range(4)) + f"Tr: {' '.join(map(str, place.ravel()))}\n"
    points = scan()
    labels = np.where(points[:, 2] < -1.7, ROAD, BUILDING | 3 << 16).astype("<u4")
    for name, count in (("00", 2), ("08", 1), ("11", 1)):
        folder = tmp_path / "kitti/sequences" / name
        for k in range(count):
            write_scan(folder / f"velodyne/{k:06d}.bin", points)
            if name != "11":
                (folder / "labels").mkdir(exist_ok=True)
                labels.tofile(folder / f"labels/{k:06d}.label")
        (folder / "calib.txt").write_text(calibration)
    write_image(tmp_path / "kitti/sequences/00/image_2/000000.png")
    (tmp_path / "kitti/sequences/00/times.txt").write_text("0.000000e+00\n1.039e-01\n")
    return tmp_path / "kitti"
