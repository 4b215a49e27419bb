"""SemanticKITTI's classes."""

import numpy as np

from jaxsim.data.cityscapes import IDS
from jaxsim.data.point_labels import LEARNING_CLASSES, NAME_OF_NUMBER, classes_in_image, read_point_labels
from jaxsim.data.synthetic import kitti_camera


def test_every_class_of_the_set_is_one_of_cityscapes():
    assert {*NAME_OF_NUMBER.values(), *LEARNING_CLASSES} <= {*IDS}
    assert len(LEARNING_CLASSES) == 20
    # Of what moves the class is that of what stands.
    assert [NAME_OF_NUMBER[252], NAME_OF_NUMBER[254], NAME_OF_NUMBER[258]] == [
        NAME_OF_NUMBER[10],
        NAME_OF_NUMBER[30],
        NAME_OF_NUMBER[18],
    ]


def test_a_surface_that_hides_another_from_the_camera_keeps_its_class():
    """The LiDAR sees, above the camera, over a fence onto a wall."""
    camera = kitti_camera()
    fence = np.stack(np.meshgrid([8.0], np.linspace(-2, 2, 80), np.linspace(-1, 0, 20)), -1).reshape(-1, 3)
    wall = np.stack(np.meshgrid([30.0], np.linspace(-8, 8, 60), np.linspace(-4, 3, 40)), -1).reshape(-1, 3)
    xyz = np.concatenate([wall, fence]).astype(np.float32)
    semantic = np.repeat(np.array([IDS["building"], IDS["fence"]], np.int32), [len(wall), len(fence)])
    of_pixel, _ = classes_in_image(xyz, semantic, semantic, camera=camera, size=(375, 1242))
    middle = of_pixel[200:260, 500:720]
    assert (middle == IDS["fence"]).mean() > 0.99


def test_labels_whose_end_was_never_written_are_told(tmp_path, caplog):
    path = tmp_path / "000000.label"
    values = np.full(3000, 40, "<u4")
    values[-1023:] = 0
    values.tofile(path)
    read_point_labels(path, 3000)
    assert not caplog.text
    values[-1024:] = 0
    values.tofile(path)
    semantic, _ = read_point_labels(path, 3000)
    assert "the last 1024 of 3000 labels" in caplog.text
    assert (semantic[:-1024] == IDS["road"]).all()
