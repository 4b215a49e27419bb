from pathlib import Path

import cv2
import numpy as np
import pytest

from jaxsim.cloud.pseudo_lidar import depth_to_cloud, place_intensity
from jaxsim.data.kitti_files import object_rect_from_velo
from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import Camera
from jaxsim.geometry import camera_at_lidar, project
from tests.cloud.published import published_camera

CAMERA = kitti_camera((30, 40))


def golden_camera(calibration: Path) -> Camera:
    lines = dict(line.split(":") for line in calibration.read_text().splitlines() if ":" in line)
    projection = np.array(lines["P2"].split(), float).reshape(3, 4)
    return published_camera(projection, object_rect_from_velo(calibration))


def kept(cloud):
    return np.asarray(cloud.xyz_m)[np.asarray(cloud.valid)]


@pytest.fixture
def vectors(golden):
    return np.load(golden / "pseudo_lidar" / "arrays.npz")


@pytest.mark.parametrize("max_high_m", [1.0, 3.0])
def test_points_are_those_of_the_published_program(golden, vectors, max_high_m):
    depth = vectors["depth_small"]
    camera = golden_camera(golden / "pseudo_lidar" / "calib_scaled.txt")
    cloud = depth_to_cloud(camera, depth, np.ones(depth.shape, bool), max_high_m=max_high_m)
    theirs = vectors[f"points_small_maxhigh{max_high_m:.0f}"]
    assert kept(cloud).shape == theirs.shape
    assert np.abs(kept(cloud) - theirs).max() < 2e-4


def test_points_of_a_whole_kitti_image_are_those_of_the_published_program(golden, samples, vectors):
    png = cv2.imread(str(golden / "pseudo_lidar" / "depth_full_uint16x256.png"), cv2.IMREAD_UNCHANGED)
    camera = golden_camera(samples / "kitti_object/training/calib/000001.txt")
    depth = png.astype(np.float32) / 256
    cloud = depth_to_cloud(camera, depth, np.ones(depth.shape, bool))
    keep = np.unpackbits(vectors["full_keep_packbits"])[: depth.size].astype(bool)
    assert (np.asarray(cloud.valid) == keep).all()
    assert np.abs(kept(cloud)[vectors["full_sample_row"]] - vectors["full_sample_points"]).max() < 2e-4
    assert kept(cloud).mean(axis=0, dtype=float) == pytest.approx(vectors["full_points_float64_mean"], abs=1e-5)


def test_pixels_of_depth_0_lie_in_the_cameras_centre_if_they_are_said_to_be_valid():
    depth = np.zeros((30, 40), np.float32)
    centre = -CAMERA.cam_from_velo[:3, :3].T @ CAMERA.cam_from_velo[:3, 3]
    assert kept(depth_to_cloud(CAMERA, depth, np.ones(depth.shape, bool))) == pytest.approx(
        np.broadcast_to(centre, (1200, 3)), abs=1e-5
    )
    assert len(kept(depth_to_cloud(CAMERA, depth, depth > 0))) == 0


def test_each_pixels_point_projects_back_to_it_in_every_sample_of_a_batch():
    rng = np.random.default_rng(0)
    depth = rng.uniform(2, 60, (2, 3, 30, 40)).astype(np.float32)
    cameras = Camera(
        *(np.broadcast_to(part, (2, 3, *part.shape)) for part in (CAMERA.intrinsics, CAMERA.cam_from_velo))
    )
    valid = rng.random(depth.shape) < 0.8
    cloud = depth_to_cloud(cameras, depth, valid, max_high_m=1e3)
    uv, z = project(cameras, cloud.xyz_m)
    v, u = np.mgrid[:30, :40]
    pixels = np.broadcast_to(np.stack([u, v], -1), (*depth.shape, 2))
    assert np.asarray(uv).reshape(*depth.shape, 2)[valid] == pytest.approx(pixels[valid], abs=1e-3)
    assert np.asarray(z).reshape(depth.shape)[valid] == pytest.approx(depth[valid], rel=1e-5)
    assert (np.asarray(cloud.valid).reshape(depth.shape) == valid).all()
    alone = depth_to_cloud(CAMERA, depth[1, 2], valid[1, 2], max_high_m=1e3)
    assert np.asarray(cloud.xyz_m)[1, 2] == pytest.approx(np.asarray(alone.xyz_m), abs=1e-5)


def test_sky_and_depth_that_is_not_finite_give_no_point():
    depth = np.full((30, 40), 10.0, np.float32)
    depth[3, 5], depth[4, 6] = np.inf, np.nan
    valid = np.ones(depth.shape, bool)
    valid[0] = False
    cloud = depth_to_cloud(CAMERA, depth, valid)
    there = np.asarray(cloud.valid).reshape(depth.shape)
    assert not there[0].any()
    assert not there[3, 5]
    assert not there[4, 6]
    assert np.isfinite(np.asarray(cloud.xyz_m)).all()


def test_points_of_zero_intensity_are_dropped_or_kept_with_0_and_never_1():
    depth, valid = np.full((30, 40), 10.0, np.float32), np.ones((30, 40), bool)
    intensity = np.zeros((30, 40), np.float32)
    intensity[10:, 20:] = 0.37
    dropped = depth_to_cloud(CAMERA, depth, valid, intensity=intensity)
    kept_zero = depth_to_cloud(CAMERA, depth, valid, intensity=intensity, drop_zero=False)
    without = depth_to_cloud(CAMERA, depth, valid)
    assert (
        np.asarray(dropped.valid).reshape(30, 40) == (np.asarray(without.valid).reshape(30, 40) & (intensity > 0))
    ).all()
    assert (np.asarray(dropped.intensity)[np.asarray(dropped.valid)] == np.float32(0.37)).all()
    assert (np.asarray(kept_zero.valid) == np.asarray(without.valid)).all()
    assert (np.asarray(kept_zero.intensity) == intensity.ravel()).all()
    assert (np.asarray(without.intensity) == 0).all()


def test_a_camera_at_the_lidar_sees_from_the_lidars_origin():
    camera = camera_at_lidar(CAMERA.intrinsics)
    depth = np.full((30, 40), 10.0, np.float32)
    xyz = np.asarray(depth_to_cloud(camera, depth, depth > 0, max_high_m=1e3).xyz_m)
    assert xyz[:, 0] == pytest.approx(10.0)
    assert xyz[0, 1] > 0 > xyz[39, 1]
    assert xyz[0, 2] > 0 > xyz[-1, 2]


def test_predicted_intensity_fills_the_crop_and_leaves_the_border_0():
    rng = np.random.default_rng(1)
    predicted = rng.uniform(0.1, 0.9, (2, 44, 372)).astype(np.float32)
    placed = place_intensity(predicted, (375, 1242), crop=(352, 1216))
    assert placed.shape == (2, 375, 1242)
    assert (placed[:, 23:, 13:1229] > 0).all()
    assert not placed[:, :23].any()
    assert not placed[..., :13].any()
    assert not placed[..., 1229:].any()
    rows, columns = (2 * np.arange(352) + 1) * 44 // 704, (2 * np.arange(1216) + 1) * 372 // 2432
    assert (placed[:, 23:, 13:1229] == predicted[:, rows[:, None], columns]).all()


def test_intensity_that_does_not_fit_the_image_is_refused():
    with pytest.raises(ValueError, match=r"1000 x 300, smaller than the crop of 1216 x 352; give the size"):
        place_intensity(np.zeros((44, 372), np.float32), (300, 1000), crop=(352, 1216))
    with pytest.raises(ValueError, match=r"44 x 372 cells does not fit a crop of 352 x 300"):
        place_intensity(np.zeros((44, 372), np.float32), (375, 1242), crop=(352, 300))
