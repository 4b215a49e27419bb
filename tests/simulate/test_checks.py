from dataclasses import replace

import numpy as np
import pytest

from jaxsim.config import Experiment
from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import CameraFrame
from jaxsim.geometry import preset
from jaxsim.runs.run import describe_run
from jaxsim.simulate.checks import check_field_of_view, check_image


@pytest.fixture
def run():
    """Trained on KITTI's camera 2."""
    camera = kitti_camera()
    return describe_run(Experiment(), preset("hdl64e"), CameraFrame(np.zeros((375, 1242, 3), np.uint8), camera))


@pytest.mark.parametrize("size", [(375, 1242), (370, 1224), (374, 1238), (370, 1226), (376, 1241)])
def test_every_size_that_kitti_has_is_taken(run, size):
    check_image(size, run)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((1080, 1920), r"1920 x 1080, an aspect ratio of 1\.78; .* images of 1242 x 375, 3\.31: render at 1242 x 375"),
        ((400, 1242), r"an aspect ratio of 3\.10"),
        ((187, 621), r"621 x 187 are too coarse; .* render at that size, or scale"),
        ((750, 2484), r"2484 x 750 are too fine"),
    ],
)
def test_images_of_another_aspect_ratio_or_resolution_are_an_error(run, size, message):
    with pytest.raises(ValueError, match=message):
        check_image(size, run)


def test_without_projection_the_field_of_view_must_be_the_runs(run):
    virtual = replace(run.camera, intrinsics=np.array([[725.0087, 0, 620.5], [0, 725.0087, 187], [0, 0, 1]]))
    check_field_of_view(virtual, run)
    wide = replace(virtual, intrinsics=virtual.intrinsics * [[0.8], [0.8], [1]])
    with pytest.raises(ValueError, match=r"the camera sees 92\.7 degrees, the run's 80\.2; .*--projection lidar"):
        check_field_of_view(wide, run)
