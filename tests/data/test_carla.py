"""CARLA's buffers, built byte by byte from its documented encoding."""

import numpy as np
import pytest

from jaxsim.data import carla
from jaxsim.data.cityscapes import IDS
from jaxsim.geometry import project, unproject

SIZE = (4, 6)


def bgra(red, green, blue) -> bytes:
    channels = [np.broadcast_to(np.asarray(c, np.uint8), SIZE) for c in (blue, green, red, 255)]
    return np.stack(channels, axis=-1).tobytes()


def encoded(depth_m: np.ndarray) -> bytes:
    """in_meters = 1000 * (R + G * 256 + B * 256 * 256) / (256 * 256 * 256 - 1)"""
    code = np.round(depth_m / 1000 * (256**3 - 1)).astype(int)
    return bgra(code % 256, code // 256 % 256, code // 65536)


def test_colours_are_turned_from_bgra():
    image = carla.read_rgb(bgra(10, 20, np.arange(6)), SIZE)
    np.testing.assert_array_equal(image[2, 3], [10, 20, 3])


def test_depth_has_24_bits_and_ends_in_the_sky():
    depth = np.linspace(0.5, 900, 24).reshape(SIZE)
    depth[0, 0] = 1000
    metres, known = carla.decode_depth(encoded(depth), SIZE)
    np.testing.assert_allclose(metres, depth, atol=1e-4)
    assert not known[0, 0]
    assert known.sum() == 23
    assert metres.dtype == np.float32


def test_a_picture_of_the_depth_is_an_error():
    grey = np.arange(24).reshape(SIZE)
    with pytest.raises(ValueError, match=r"ColorConverter\.Depth's .*pass the raw buffer"):
        carla.decode_depth(bgra(grey, grey, grey), SIZE)


@pytest.mark.parametrize(
    ("version", "classes"),
    [
        (
            "0.9.13",
            {0: "unlabeled", 1: "building", 2: "fence", 4: "person", 5: "pole", 6: "road", 7: "road", 8: "sidewalk",
             9: "vegetation", 10: "car", 11: "wall", 12: "traffic sign", 13: "sky", 14: "ground", 15: "bridge",
             16: "rail track", 17: "guard rail", 18: "traffic light", 19: "static", 20: "dynamic", 22: "terrain"},
        ),
        (
            "0.9.14",
            {0: "unlabeled", 1: "road", 2: "sidewalk", 3: "building", 4: "wall", 5: "fence", 6: "pole",
             7: "traffic light", 8: "traffic sign", 9: "vegetation", 10: "terrain", 11: "sky", 12: "person",
             13: "rider", 14: "car", 15: "truck", 16: "bus", 17: "train", 18: "motorcycle", 19: "bicycle",
             20: "static", 21: "dynamic", 24: "road", 25: "ground", 26: "bridge", 27: "rail track", 28: "guard rail"},
        ),
    ],
)  # fmt: skip
def test_tags_are_those_of_the_version(version, classes):
    for tag, name in classes.items():
        assert (carla.read_semantic(bgra(tag, 0, 0), SIZE, version=version) == IDS[name]).all()
    rest = set(range(len(carla.tags_of(version)))) - set(classes)
    for tag in rest:  # Other and Water
        assert (carla.read_semantic(bgra(tag, 0, 0), SIZE, version=version) == 0).all()
    with pytest.raises(ValueError, match=rf"tag 40 is none of CARLA {version}'s 0\.\.{max(classes)}"):
        carla.read_semantic(bgra(40, 0, 0), SIZE, version=version)


def test_versions_are_compared_as_numbers():
    assert carla.tags_of("0.10.0") is carla.tags_of("0.9.16") is carla.tags_of("0.9.15-dirty") is carla.TAGS_0_9_14
    assert carla.tags_of("0.9.6") is carla.TAGS_0_9_13
    with pytest.raises(ValueError, match="version is 'latest'"):
        carla.tags_of("latest")


def test_instances_join_green_and_blue_and_stay_apart_over_classes():
    numbers = carla.read_instance(bgra(np.where(np.arange(6) < 3, 14, 12), 55, 20), SIZE)
    assert len(np.unique(numbers)) == 2
    np.testing.assert_array_equal(numbers[:, 0] % 65536, 55 + 20 * 256)
    assert (carla.read_instance(bgra(14, 0, 0), SIZE) == 0).all()
    assert (carla.read_semantic(bgra(14, 55, 20), SIZE, version="0.9.15") == IDS["car"]).all()


def pose_matrix(*, x=0, y=0, z=0, pitch=0, yaw=0, roll=0):
    """`carla.Transform.get_matrix()` of a place in metres and angles in degrees.

    Pitch is positive upwards, yaw to the right, roll to the right (clockwise ahead).
    """
    cos, sin = np.cos(np.deg2rad([pitch, yaw, roll])), np.sin(np.deg2rad([pitch, yaw, roll]))
    turn_yaw = np.array([[cos[1], -sin[1], 0], [sin[1], cos[1], 0], [0, 0, 1]])
    turn_pitch = np.array([[cos[0], 0, -sin[0]], [0, 1, 0], [sin[0], 0, cos[0]]])
    turn_roll = np.array([[1, 0, 0], [0, cos[2], sin[2]], [0, -sin[2], cos[2]]])
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn_yaw @ turn_pitch @ turn_roll, (x, y, z)
    return out


@pytest.mark.parametrize(
    ("angles", "forward", "up"),
    [
        ({}, (1, 0, 0), (0, 0, 1)),
        ({"yaw": 90}, (0, 1, 0), (0, 0, 1)),  # to the right, where CARLA's y points
        ({"pitch": 90}, (0, 0, 1), (-1, 0, 0)),
        ({"roll": 90}, (1, 0, 0), (0, 1, 0)),
        ({"yaw": 90, "pitch": 30}, (0, np.cos(np.pi / 6), 0.5), (0, -0.5, np.cos(np.pi / 6))),
    ],
)
def test_poses_turn_as_unreal_does(angles, forward, up):
    matrix = pose_matrix(x=1, y=2, z=3, **angles)
    np.testing.assert_allclose(matrix[:3, 0], forward, atol=1e-12)
    np.testing.assert_allclose(matrix[:3, 2], up, atol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], [1, 2, 3])


def test_left_handed_mounts_become_a_proper_rotation():
    """A camera 0.3 m before, 0.2 m right of and 0.1 m above the LiDAR, both on a car that looks to the east."""
    car = pose_matrix(x=50, y=-30, z=1, yaw=77, pitch=2, roll=-1)
    lidar, camera = car @ pose_matrix(z=1.8), car @ pose_matrix(x=0.3, y=0.2, z=1.9)
    cam_from_velo = carla.cam_from_velo(camera, lidar)
    assert np.linalg.det(cam_from_velo[:3, :3]) == pytest.approx(1, abs=1e-5)
    # In velo y is LEFT: a point 10 m ahead, 2 m left, 1 m up is left of and above the axis in the image.
    point = cam_from_velo @ [10, 2, 1, 1]
    np.testing.assert_allclose(point[:3], [-2.2, -0.9, 9.7], atol=1e-4)
    with pytest.raises(ValueError, match="the lidar's transform is no rigid 4 x 4 matrix"):
        carla.cam_from_velo(camera, np.ones((4, 4)))


def test_points_of_a_depth_buffer_lie_where_carlas_own_formula_puts_them():
    """K of CARLA's documentation has its axis at (w / 2, h / 2), with a pixel's centre at u + 1/2."""
    size, fov = (90, 160), 100.0
    k = carla.intrinsics(size, fov)
    focal = 160 / (2 * np.tan(np.deg2rad(fov) / 2))
    u, v, depth = 30, 70, 20.0
    unreal = np.array(
        [depth, (u + 0.5 - 80) * depth / focal, -(v + 0.5 - 45) * depth / focal]
    )  # x ahead, y right, z up
    raw = np.zeros((*size, 4), np.uint8)
    code = round(depth / 1000 * (2**24 - 1))
    raw[..., 2], raw[..., 1], raw[..., 0] = code % 256, code // 256 % 256, code // 65536
    at = carla.cam_from_velo(pose_matrix(), pose_matrix())
    view = carla.read_view(raw, raw, size=size, fov_deg=fov, version="0.9.15", cam_from_velo=at)
    assert view.camera.intrinsics[0, 0] == pytest.approx(k[0, 0])
    xyz = np.asarray(unproject(view.camera, view.depth_m))[v, u]
    np.testing.assert_allclose(xyz, carla.mirror_y(unreal), atol=1e-3)
    uv, _ = project(view.camera, xyz[None])
    np.testing.assert_allclose(uv, [[u, v]], atol=1e-2)


def test_a_view_has_classes_from_either_camera():
    depth = encoded(np.full(SIZE, 5.0))
    at = carla.cam_from_velo(np.eye(4), np.eye(4))
    common = {"size": SIZE, "fov_deg": 90, "version": "0.9.15", "cam_from_velo": at}
    view = carla.read_view(bgra(1, 2, 3), depth, instance=bgra(14, 7, 0), **common)
    assert (view.semantic == IDS["car"]).all()
    assert (view.instance == 14 * 65536 + 7).all()
    house = carla.read_view(bgra(1, 2, 3), depth, instance=bgra(3, 7, 0), **common)
    assert (house.semantic == IDS["building"]).all()
    assert (house.instance == 0).all()
    view = carla.read_view(bgra(1, 2, 3), depth, bgra(1, 0, 0), **common)
    assert (view.semantic == IDS["road"]).all()
    assert view.instance is None


def test_a_buffer_of_another_size_is_an_error():
    with pytest.raises(ValueError, match=r"the buffer has 96 bytes; an image of 8 x 4 has 128"):
        carla.read_rgb(bgra(0, 0, 0), (4, 8))
    with pytest.raises(ValueError, match="field of view is 200"):
        carla.intrinsics(SIZE, 200)
