import json

import jax
import numpy as np
import pytest

from jaxsim.data import KittiObject
from jaxsim.data.kitti_files import object_camera, read_image, read_velodyne


@pytest.fixture(scope="session")
def published(golden):
    """Reads one archive of the detector's golden vectors."""

    def read(name):
        with np.load(golden / "voxel_rcnn" / f"{name}.npz") as archive:
            return dict(archive)

    return read


@pytest.fixture(scope="session")
def values(golden):
    return json.loads((golden / "voxel_rcnn" / "values.json").read_text())


@pytest.fixture(scope="session")
def scan(samples, published):
    """Scan 000001 as x, y, z, intensity, and which of its points the camera sees, as the published program says."""
    xyz, intensity = read_velodyne(samples / "kitti_object" / "training" / "velodyne" / "000001.bin")
    packed = published("backbone")["fov_keep_packbits"]
    return np.column_stack([xyz, intensity]), np.unpackbits(packed)[: len(xyz)].astype(bool)


@pytest.fixture(scope="session")
def camera_000001(samples):
    folder = samples / "kitti_object" / "training"
    size = read_image(folder / "image_2" / "000001.png").shape[:2]
    return object_camera(folder / "calib" / "000001.txt", size), size


@pytest.fixture(scope="module")
def kitti(samples):
    return KittiObject(samples / "kitti_object")


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield
