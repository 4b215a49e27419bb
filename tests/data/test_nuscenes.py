import numpy as np
import pytest

from jaxsim.data import read_lidar_top
from jaxsim.geometry import polar_to_points, preset

NAME = "n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951.pcd.bin"


@pytest.fixture
def sweep_file(tmp_path):
    """One firing every 2 degrees, clockwise from the rear; ring k (0 lowest) sees a wall at 10 m + k / 10."""
    elevation = preset("hdl32e").elevation_rad[::-1]
    azimuth = np.deg2rad(179 - 2.0 * np.arange(180))[:, None]
    r = 10 + np.arange(32) / 10
    forward, left, up = (
        r * np.cos(elevation) * np.cos(azimuth),
        r * np.cos(elevation) * np.sin(azimuth),
        r * np.sin(elevation) + 0 * azimuth,
    )
    ring = np.arange(32) + 0 * azimuth
    points = np.stack([-left, forward, up, 5 * ring, ring], axis=-1).astype("<f4")
    path = tmp_path / NAME
    points.tofile(path)
    return path


def test_rings_become_rows_top_first_and_forward_is_in_the_middle(sweep_file):
    sweep = read_lidar_top(sweep_file, columns=180)
    assert sweep.image.valid.all()
    np.testing.assert_allclose(sweep.image.range_m[:, 90], 10 + np.arange(31, -1, -1) / 10, rtol=1e-5)
    np.testing.assert_allclose(sweep.image.intensity[:, 0], 5 * np.arange(31, -1, -1) / 255, rtol=1e-6)
    points = polar_to_points(sweep.image, sweep.grid).xyz_m.reshape(32, 180, 3)
    assert points[0, 90, 0] > 10
    assert points[0, 45, 1] > 10  # left of forward stands left of the middle


def test_name_drive_and_time_come_from_the_file_name(sweep_file):
    sweep = read_lidar_top(sweep_file)
    assert sweep.scene == "n015-2018-07-24-11-22-45+0800"
    assert sweep.time_s == pytest.approx(1532402927.647951, abs=1e-5)


def test_a_beam_that_did_not_come_back_is_no_point_at_the_sensor(sweep_file):
    points = np.fromfile(sweep_file, "<f4").reshape(180, 32, 5)
    points[40:50, 3, :3] = (0.0, -0.45, -0.01)
    points.tofile(sweep_file)
    valid = read_lidar_top(sweep_file, columns=180).image.valid
    assert not valid[28, 40:50].any()
    assert valid.sum() == valid.size - 10


def _scaled(points):
    points[:, 3] /= 255


def _nan(points):
    points[5, 0] = np.nan


def _ring(points):
    points[:, 4] += 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_scaled, r"intensity spans 0\.\.0\.6\d*; nuScenes stores 0\.\.255"),
        (_nan, "1 of 5760 points are NaN"),
        (_ring, r"fifth value spans 1\.\.32; it must be the ring"),
    ],
)
def test_a_spoilt_file_says_what_is_wrong(sweep_file, change, message):
    points = np.fromfile(sweep_file, "<f4").reshape(-1, 5)
    change(points)
    points.tofile(sweep_file)
    with pytest.raises(ValueError, match=message):
        read_lidar_top(sweep_file)


def test_a_truncated_or_missing_file(sweep_file, tmp_path):
    sweep_file.write_bytes(sweep_file.read_bytes()[:-8])
    with pytest.raises(ValueError, match="no whole number of points"):
        read_lidar_top(sweep_file)
    with pytest.raises(ValueError, match="there is no"):
        read_lidar_top(tmp_path / "none.pcd.bin")


def test_the_real_sweep_has_no_gaps_from_sampling(samples):
    path = next((samples / "nuscenes/samples/LIDAR_TOP").glob("*.bin"))
    sweep = read_lidar_top(path)
    valid = sweep.image.valid
    assert valid.shape == (32, 900)
    assert 0.7 < valid.mean() < 0.85
    lonely = ~valid[:, 1:-1] & valid[:, :-2] & valid[:, 2:]
    assert lonely.mean() < 0.025
    assert sweep.image.intensity.max() <= 1
