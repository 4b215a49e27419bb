"""The data set that docs/data-sets.md shows is one, and its commands name what there is."""

import re
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from jaxsim.data import DATASETS, Dataset
from jaxsim.data.cityscapes import IDS
from jaxsim.geometry import project
from tests.data.drives import CAM_FROM_VELO, PROJECTION, RECTIFY
from tests.data.round_room import scan, write_image, write_scan

PAGE = (Path(__file__).parents[2] / "docs" / "data-sets.md").read_text()


@pytest.fixture
def kitti_360(tmp_path) -> Path:
    """One frame, and a scan without image."""
    drive = "2013_05_28_drive_0000_sync"
    for number in ("0000000001", "0000000002"):
        write_scan(tmp_path / f"data_3d_raw/{drive}/velodyne_points/data/{number}.bin", scan())
    write_image(tmp_path / f"data_2d_raw/{drive}/image_00/data_rect/0000000001.png")
    classes = tmp_path / f"data_2d_semantics/train/{drive}/image_00/semantic/0000000001.png"
    classes.parent.mkdir(parents=True)
    raster = np.full((375, 1242), 11, np.uint8)
    raster[0] = 37
    cv2.imwrite(str(classes), raster)
    (tmp_path / "calibration").mkdir()
    projection = PROJECTION.format("0", "0", "0")
    (tmp_path / "calibration/perspective.txt").write_text(f"P_rect_00: {projection}\n\nR_rect_00: {RECTIFY}\n")
    cam_from_velo = np.vstack([np.array(CAM_FROM_VELO.split(), float).reshape(3, 4), [0, 0, 0, 1]])
    np.savetxt(tmp_path / "calibration/calib_cam_to_velo.txt", np.linalg.inv(cam_from_velo)[:3].reshape(1, 12))
    return tmp_path


def block_with(text: str) -> str:
    """The page's one block of Python that holds `text`."""
    (block,) = (b for b in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if text in b)
    return block


def test_the_pages_class_is_a_data_set(kitti_360):
    names: dict = {}
    exec(block_with("class Kitti360"), names)
    dataset = names["Kitti360"](kitti_360, "2013_05_28_drive_0000_sync")
    assert isinstance(dataset, Dataset)
    assert len(dataset) == 1
    frame = dataset[0]
    assert frame.name == dataset.name_of(0) == "2013_05_28_drive_0000_sync-0000000001"
    assert set(np.unique(frame.camera.semantic)) == {0, 11}
    np.testing.assert_array_equal(frame.cloud.row, np.round(frame.cloud.intensity * 100))
    uv, depth = project(frame.camera.camera, np.array([[20.0, 0, 0]], np.float32))
    assert depth[0] == pytest.approx(20, abs=0.5)
    np.testing.assert_allclose(uv, [[610, 173]], atol=20)


def test_every_kind_is_on_the_page_and_every_command_is_of_a_known_one():
    assert set(re.findall(r"^\| `(\w+)`", PAGE, re.MULTILINE)) == set(DATASETS)
    assert set(re.findall(r"(?:--data|--data\.kind) (\w+)", PAGE)) <= set(DATASETS)


def test_the_pages_lines_for_carla_hand_a_view_to_the_sensor():
    h, w = 375, 1242
    place = SimpleNamespace(get_matrix=lambda: np.eye(4).tolist())
    image = SimpleNamespace(height=h, width=w, fov=81.43, transform=place, raw_data=bytes([1, 2, 14, 255]) * (h * w))
    handed: dict = {}
    names = {
        "rgb": image,
        "depth": image,
        "instances": image,
        "lidar": SimpleNamespace(get_transform=lambda: place),
        "sensor": SimpleNamespace(simulate=lambda **view: handed.update(view)),
    }
    exec(block_with("jaxsim.data import carla"), names)
    assert handed["camera"].intrinsics[0, 0] == pytest.approx(721.5377, rel=1e-4)  # KITTI's focal length
    assert (handed["semantic"] == IDS["car"]).all()
    assert handed["depth_m"].shape == (h, w)
