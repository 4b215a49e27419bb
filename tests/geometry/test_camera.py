import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsim.frame import Camera
from jaxsim.geometry import (
    camera_from_projection,
    camera_rows,
    camera_window,
    crop_camera,
    fit_beams,
    invert,
    preset,
    project,
    recover_rows,
    transform,
    unproject,
)
from tests.geometry.kitti_scans import CROP, OBJECT, RAW, camera, cropped_camera, points

SPEC = preset("hdl64e")
CAM_FROM_VELO = np.array([[0, -1, 0, 0.1], [0, 0, -1, -0.1], [1, 0, 0, -0.3], [0, 0, 0, 1]], np.float32)
CAMERA = Camera(np.array([[700, 0.5, 600], [0, 710, 170], [0, 0, 1]], np.float32), CAM_FROM_VELO)


def rigid(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = q * np.sign(np.linalg.det(q)), rng.uniform(-5, 5, 3)
    return out.astype(np.float32)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_transforms_follow_the_matrix_and_their_chains_cancel(seed):
    rng = np.random.default_rng(seed)
    a_from_b = np.stack([rigid(rng), rigid(rng)])
    xyz = rng.uniform(-50, 50, (2, 30, 3)).astype(np.float32)
    moved = transform(a_from_b, xyz)
    oracle = np.einsum("bij,bnj->bni", a_from_b[:, :3, :3].astype(float), xyz) + a_from_b[:, None, :3, 3]
    assert moved == pytest.approx(oracle, abs=3e-5)
    assert transform(invert(a_from_b), moved) == pytest.approx(xyz, abs=1e-4)
    assert np.asarray(invert(a_from_b)) @ a_from_b == pytest.approx(np.stack([np.eye(4)] * 2), abs=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_projection_follows_the_matrices_and_unproject_undoes_it(seed):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 80, (20, 30)).astype(np.float32)
    xyz = unproject(CAMERA, depth)
    uv, z = project(CAMERA, np.asarray(xyz).reshape(-1, 3))
    v, u = np.mgrid[:20, :30]
    assert np.asarray(uv).reshape(20, 30, 2) == pytest.approx(np.stack([u, v], -1), abs=2e-3)
    assert np.asarray(z).reshape(20, 30) == pytest.approx(depth, rel=1e-5)
    points_h = np.concatenate([np.asarray(xyz, np.float64).reshape(-1, 3), np.ones((600, 1))], axis=1)
    pixel = points_h @ CAM_FROM_VELO.astype(float)[:3].T @ CAMERA.intrinsics.astype(float).T
    assert uv == pytest.approx(pixel[:, :2] / pixel[:, 2:], abs=1e-3)


def test_depth_in_half_precision_counts_all_pixels_of_a_wide_image():
    depth = np.full((2, 3840), 16, np.float32)
    np.testing.assert_array_equal(unproject(CAMERA, depth.astype(np.float16)), unproject(CAMERA, depth))


def test_points_behind_the_camera_have_no_pixel():
    uv, depth = project(CAMERA, np.array([[-5, 0, 0], [0.3, 1, 0], [5, 0, 0]], np.float32))
    assert np.isnan(uv[:2]).all()
    assert (depth[:2] <= 0).all()
    assert np.isfinite(uv[2]).all()


def test_the_way_through_the_camera_has_a_gradient_behind_it_too():
    xyz = np.array([[-5, 0, 0], [5, 1, 0]], np.float32)
    slope = jax.grad(lambda xyz: project(CAMERA, xyz)[1].sum())(xyz)
    assert slope == pytest.approx(np.array([[1.0, 0, 0]] * 2))


def test_a_batch_of_cameras_is_its_cameras():
    rng = np.random.default_rng(0)
    cameras = [dataclasses.replace(CAMERA, cam_from_velo=rigid(rng) @ CAM_FROM_VELO) for _ in range(3)]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *cameras)
    depth = rng.uniform(1, 50, (3, 4, 5)).astype(np.float32)
    xyz = unproject(batch, depth)
    uv, z = project(batch, np.asarray(xyz).reshape(3, -1, 3))
    for i, one in enumerate(cameras):
        assert xyz[i] == pytest.approx(np.asarray(unproject(one, depth[i])), abs=1e-5)
        assert uv[i] == pytest.approx(np.asarray(project(one, np.asarray(xyz[i]).reshape(-1, 3))[0]), abs=1e-3)
    assert z == pytest.approx(depth.reshape(3, -1), abs=1e-3)


def test_the_fourth_column_of_a_projection_moves_the_camera():
    """Against KITTI's own chain P2 R0 Tr, in float64."""
    rng = np.random.default_rng(1)
    projection = np.array([[721.5, 0, 609.6, 44.86], [0, 721.5, 172.9, 0.2164], [0, 0, 1, 0.0027]])
    xyz = rng.uniform([5, -10, -2], [60, 10, 2], (100, 3))
    chain = np.concatenate([xyz, np.ones((100, 1))], axis=1) @ (projection @ CAM_FROM_VELO.astype(np.float64)).T
    uv, depth = project(camera_from_projection(projection, CAM_FROM_VELO), xyz.astype(np.float32))
    assert uv == pytest.approx(chain[:, :2] / chain[:, 2:], abs=2e-3)
    assert depth == pytest.approx(chain[:, 2], abs=1e-4)


def test_a_cropped_camera_sees_the_same_in_shifted_pixels():
    xyz = np.array([[10, 1, 0.5], [20, -3, 1]], np.float32)
    whole, _ = project(CAMERA, xyz)
    part, _ = project(crop_camera(CAMERA, 23, 13), xyz)
    assert np.asarray(whole) - np.asarray(part) == pytest.approx(np.array([[13, 23]] * 2), abs=1e-3)


@pytest.mark.parametrize("scan", [*RAW, *OBJECT])
def test_the_cropped_camera_sees_44_lines_in_372_columns(samples, scan):
    one = cropped_camera(samples, scan)
    data = points(samples, scan)
    row = recover_rows(data[:, :3])
    for spec in (SPEC, fit_beams(data[:, :3], row)):
        window = camera_window(one, CROP, spec, columns=372)
        assert window.elevation_rad.shape == (44,)
        assert window.azimuth_rad.shape == (372,)
        assert camera_rows(one, CROP, spec) == (0, 44)
    span = np.rad2deg(window.azimuth_rad[0] - window.azimuth_rad[-1]) * 372 / 371
    assert span == pytest.approx(81.38 if scan == OBJECT[0] else 80.23, abs=0.01)
    # Coarser than the sensor's own step of 0.179 degrees.
    assert 0.21 < span / 372 < 0.22


def test_the_window_is_what_the_image_spans(samples):
    one, size = camera(samples, RAW[0])
    window = camera_window(one, size, SPEC, columns=100)
    step = window.azimuth_rad[0] - window.azimuth_rad[1]
    for edge, u in ((window.azimuth_rad[0] + step / 2, -0.5), (window.azimuth_rad[-1] - step / 2, size[1] - 0.5)):
        far = 1e4 * np.array([[np.cos(edge), np.sin(edge), 0.0]], np.float32)
        uv, _ = project(one, far)
        assert uv[0, 0] == pytest.approx(u, abs=1.0)


def test_lines_above_a_low_image_are_left_out():
    """A camera that sees from 10 degrees above the horizon down, on a sensor that begins at 22.5."""
    narrow = Camera(np.array([[500, 0, 500], [0, 500, 88], [0, 0, 1]], np.float32), CAM_FROM_VELO)
    spec = preset("os1_128")
    first, stop = camera_rows(narrow, (176, 1000), spec)
    assert spec.elevation_deg[first] == pytest.approx(10, abs=2.5)
    assert spec.elevation_deg[stop - 1] == pytest.approx(-8, abs=2.5)
    assert first > 30


def test_a_camera_to_the_rear_has_a_window_across_the_cut():
    turned = CAM_FROM_VELO @ np.diag([-1, -1, 1, 1]).astype(np.float32)
    window = camera_window(dataclasses.replace(CAMERA, cam_from_velo=turned), (375, 1200), SPEC, columns=50)
    assert window.azimuth_rad[0] > np.pi > window.azimuth_rad[-1] > 2


def test_a_camera_that_sees_no_line_is_refused():
    up = CAM_FROM_VELO.copy()
    up[:3, :3] = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with pytest.raises(ValueError, match="sees no line of hdl64e"):
        camera_rows(dataclasses.replace(CAMERA, cam_from_velo=up), (375, 1200), SPEC)


def test_a_batch_of_cameras_has_no_one_window():
    batch = jax.tree.map(lambda leaf: np.stack([leaf] * 2), CAMERA)
    with pytest.raises(ValueError, match="takes one camera"):
        camera_rows(batch, (375, 1200), SPEC)
