import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.data import KittiObject
from jaxsim.frame import Camera, Cloud
from jaxsim.prepare import sparse_depth

SIZE = (12, 30)
CAMERA = Camera(
    np.array([[20, 0, 14.5], [0, 20, 5.5], [0, 0, 1]], np.float32),
    np.array([[0, -1, 0, 0.1], [0, 0, -1, -0.1], [1, 0, 0, -0.3], [0, 0, 0, 1]], np.float32),
)


def cloud(xyz, valid=None):
    xyz = np.asarray(xyz, np.float32)
    valid = np.ones(len(xyz), bool) if valid is None else valid
    return Cloud(xyz, np.zeros(len(xyz), np.float32), valid)


def oracle(points, valid):
    depth = np.zeros(SIZE)
    k, m = CAMERA.intrinsics.astype(float), CAMERA.cam_from_velo.astype(float)
    for p, ok in zip(points.astype(float), valid, strict=True):
        x, y, z = k @ (m[:3, :3] @ p + m[:3, 3])
        if ok and z > 0.1:
            u, v = int(np.floor(x / z + 0.5)), int(np.floor(y / z + 0.5))
            if 0 <= u < SIZE[1] and 0 <= v < SIZE[0] and (depth[v, u] == 0 or z < depth[v, u]):
                depth[v, u] = z
    return depth


@given(st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_equals_the_slow_obvious_program(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-5, -20, -8), (40, 20, 8), (400, 3)).astype(np.float32)
    valid = rng.random(400) < 0.9
    depth, known = (np.asarray(a) for a in sparse_depth(cloud(points, valid), CAMERA, SIZE))
    expected = oracle(points, valid)
    assert (known != (expected > 0)).mean() < 0.01  # a point on a pixel's border
    both = known & (expected > 0)
    assert (np.abs(depth - expected)[both] < 1e-4).mean() > 0.97


def test_the_nearest_point_wins_a_pixel_and_points_behind_are_left_out():
    depth, known = sparse_depth(cloud([[9, 0, 0], [5, 0, 0], [7, 0, 0], [-5, 0, 0], [np.nan, 0, 0]]), CAMERA, SIZE)
    assert np.asarray(depth)[np.asarray(known)].tolist() == [np.float32(5) - np.float32(0.3)]


def test_equals_the_published_sparse_depth_of_a_real_scan(samples, golden):
    frame = KittiObject(samples / "kitti_object")[0]
    size = frame.camera.rgb.shape[:2]
    depth, known = (np.asarray(a) for a in sparse_depth(frame.cloud, frame.camera.camera, size))
    published = cv2.imread(str(golden / "ip_basic/sparse_000000_uint16x256.png"), cv2.IMREAD_UNCHANGED)
    assert known.sum() > 10_000
    # In float32 a point on the border of two pixels may fall into the other one.
    assert (known != (published > 0)).sum() <= 4
    off = np.abs(np.round(depth * 256) - published)[known & (published > 0)]
    assert (off > 1).sum() <= 4
