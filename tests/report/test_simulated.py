"""The page and the pictures of simulated frames."""

import numpy as np

from jaxsim.data import open_dataset
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import Cloud, Painted, PolarGrid, PolarImage
from jaxsim.report.simulated import draw_simulated, write_simulated

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
