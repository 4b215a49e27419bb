"""Pages and pictures of simulated clouds, and of those that a detector has looked at."""

import numpy as np

from jaxsim.data import open_dataset
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.detect.results import Detected
from jaxsim.evaluate.cloud_folder import AT_LIDAR, CloudFolder, write_detections
from jaxsim.frame import Cloud, Painted, PolarGrid, PolarImage
from jaxsim.report.clouds import draw_simulated, write_detected, write_simulated
from tests.detect.tiny import EXPERIMENT

ROWS, COLUMNS = 4, 16
RANGE_M = np.full((ROWS, COLUMNS), 9.0, np.float32)
IMAGE = PolarImage(RANGE_M, RANGE_M / 20, RANGE_M > 0)


def test_the_page_turns_frames_beside_what_the_data_set_measured(tmp_path):
    azimuth = np.linspace(0.6, -0.6, COLUMNS).astype(np.float32)
    elevation = np.linspace(0.0, -0.3, ROWS).astype(np.float32)
    world = open_dataset("synthetic")
    write_grid(tmp_path / "polar", PolarGrid(azimuth, elevation, np.zeros(ROWS, np.float32)))
    write_frame(tmp_path / "polar", world.name_of(3), IMAGE)
    page = write_simulated(tmp_path, world, [3], run="demo")
    assert page == tmp_path / "clouds.html"
    assert "The sensor of demo, simulated beside what was measured." in page.read_text()


def test_a_frame_has_a_picture_of_its_cloud_and_one_of_its_rasters(tmp_path):
    cells = np.zeros((ROWS, COLUMNS), np.int32)
    rgb = np.zeros((ROWS, COLUMNS, 3), np.float32)
    painted = Painted(RANGE_M, RANGE_M, rgb, cells, cells, valid=RANGE_M > 0, occluded=RANGE_M < 0)
    cloud = Cloud(np.ones((5, 3), np.float32), np.ones(5, np.float32), np.ones(5, bool))
    draw_simulated(tmp_path, "a", cloud, image=IMAGE, painted=painted)
    assert {path.name for path in (tmp_path / "previews").iterdir()} == {"a.png", "a_cloud.png"}


def test_what_result_files_hold_is_drawn_and_turned(tmp_path):
    rng = np.random.default_rng(0)
    boxes = np.array([[10, 2, -1, 4, 2, 1.5, 0.3]], np.float32)
    clouds, out = tmp_path / "clouds", tmp_path / "out"
    clouds.mkdir()
    for name in ("a", "b"):
        rng.uniform(0, 1, (50, 4)).astype(np.float32).tofile(clouds / f"{name}.bin")
        found = Detected(boxes, np.array([0.7], np.float32))
        write_detections(out / "results" / f"{name}.txt", found, "Car", view=AT_LIDAR)
    folder = CloudFolder(clouds)
    page = write_detected(folder, [clouds / "a.bin"], out, experiment=EXPERIMENT, sentence="Cars in two clouds.")
    assert page == out / "clouds.html"
    assert "Cars in two clouds." in page.read_text()
    assert [path.name for path in (out / "pictures").iterdir()] == ["a_above.png"]
