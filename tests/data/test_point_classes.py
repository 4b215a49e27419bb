"""Classes of points in the camera's image."""

import numpy as np

from jaxsim.data.cityscapes import IDS
from jaxsim.data.point_classes import classes_in_image
from jaxsim.data.synthetic import kitti_camera


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
