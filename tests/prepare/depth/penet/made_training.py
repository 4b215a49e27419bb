"""What tests of training are made of."""

import numpy as np

from jaxsim.frame import Camera, CameraFrame, DepthFrame

INTRINSICS = np.array([[60.0, 0, 40], [0, 60, 20], [0, 0, 1]], np.float32)


def plane(seed: int, size=(48, 96)) -> DepthFrame:
    """A slanted wall, its colours random, a tenth of its pixels given."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: size[0], : size[1]]
    truth = (10 + 0.1 * u + 0.05 * v).astype(np.float32)
    given = rng.random(size) < 0.1
    rgb = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    return DepthFrame(rgb, np.where(given, truth, 0), given, truth, np.ones(size, bool), intrinsics=INTRINSICS)


def view(size=(64, 96)):
    frame = plane(3, size)
    return CameraFrame(rgb=frame.rgb, camera=Camera(INTRINSICS, np.eye(4, dtype=np.float32))), frame
