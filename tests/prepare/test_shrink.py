import jax
import numpy as np
import pytest

from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import camera_at_lidar, unproject
from jaxsim.prepare import shrink

K = np.array([[40.0, 0, 15.5], [0, 40.0, 7.5], [0, 0, 1]], np.float32)


def view(camera: Camera | None = None) -> CameraFrame:
    """16 x 32 pixels that are all different."""
    number = np.arange(16 * 32, dtype=np.int32).reshape(16, 32)
    rgb = np.stack([number % 256, number // 256, 0 * number], axis=-1).astype(np.uint8)
    depth = 5 + number.astype(np.float32) / 100
    known = number % 7 > 0
    return CameraFrame(rgb, camera or camera_at_lidar(K), depth, known, number % 34, number)


def test_each_cell_takes_the_pixel_at_its_centre_in_every_raster():
    """Oracle: cell i of n lies over pixel floor((i + 1/2) w / n)."""
    whole, (rows, columns) = view(), (6, 13)
    small = jax.tree.map(np.asarray, shrink(whole, (rows, columns)))
    assert small.occluded.shape == (rows, columns)
    assert not np.asarray(small.occluded).any()
    for i in range(rows):
        for j in range(columns):
            v, u = int((i + 0.5) * 16 / rows), int((j + 0.5) * 32 / columns)
            assert bool(small.valid[i, j]) == bool(whole.depth_valid[v, u])
            if whole.depth_valid[v, u]:
                assert small.instance[i, j] == whole.instance[v, u]
                assert small.semantic[i, j] == whole.semantic[v, u]
                np.testing.assert_allclose(small.rgb[i, j] * 255, whole.rgb[v, u], atol=1e-4)
                assert small.depth_m[i, j] == whole.depth_m[v, u]
            else:
                assert small.instance[i, j] == small.depth_m[i, j] == small.range_m[i, j] == 0


def test_the_range_is_the_distance_from_the_camera():
    whole = view()
    xyz = np.asarray(unproject(whole.camera, whole.depth_m))  # the LiDAR stands in the camera
    small = shrink(whole, (16, 32))
    seen = whole.depth_valid
    np.testing.assert_allclose(np.asarray(small.range_m)[seen], np.linalg.norm(xyz, axis=-1)[seen], rtol=1e-5)


def test_rasters_that_the_camera_does_not_have_are_nothing():
    bare = view().replace(semantic=None, instance=None)
    small = shrink(bare, (4, 8))
    assert not np.asarray(small.semantic).any()
    assert not np.asarray(small.instance).any()


def test_fewer_pixels_than_cells_are_an_error():
    with pytest.raises(ValueError, match="32 x 16 pixels, fewer than the window's 372 x 44 cells"):
        shrink(view(), (44, 372))
    with pytest.raises(ValueError, match="no depth_m"):
        shrink(view().replace(depth_m=None), (4, 8))
