from dataclasses import replace

import numpy as np

from jaxsim.frame import Cloud, PolarGrid
from jaxsim.geometry import grid_difference, pad_cloud, pad_points, room_for, same_grid

GRID = PolarGrid(np.float32([0.2, 0.1, 0.0]), np.float32([0.05, -0.05]), np.float32([0.0, 0.1]))


def test_rounded_angles_are_the_same_grid_and_half_a_step_is_another():
    rounded = replace(GRID, azimuth_rad=GRID.azimuth_rad + np.float32(5e-6), origin_m=GRID.origin_m + np.float32(5e-5))
    assert same_grid(GRID, rounded)
    assert grid_difference(GRID, rounded) == ""
    assert not same_grid(GRID, replace(GRID, azimuth_rad=GRID.azimuth_rad + np.float32(8e-4)))


def test_what_differs_is_told_by_name():
    fewer = replace(GRID, elevation_rad=GRID.elevation_rad[:1])
    assert grid_difference(GRID, fewer) == "elevation_rad (2 and 1 values)"
    higher = replace(GRID, origin_m=GRID.origin_m + np.float32(0.25))
    assert grid_difference(GRID, higher) == "origin_m (up to 0.25 apart)"


def test_a_cloud_is_filled_up_with_invalid_points():
    cloud = Cloud(np.ones((3, 3), np.float32), np.ones(3, np.float32), np.ones(3, bool))
    padded = pad_cloud(cloud, 4)
    assert padded.xyz_m.shape == (4, 3)
    assert padded.valid.tolist() == [True, True, True, False]
    assert padded.row is None
    assert pad_cloud(padded, 4).valid.shape == (4,)


def test_points_are_filled_up_to_a_room_that_is_never_empty():
    assert [room_for(n, 4) for n in (0, 1, 4, 5)] == [4, 4, 4, 8]
    padded, real = pad_points(np.ones((3, 2), np.float32), room_for(3, 4))
    np.testing.assert_array_equal(padded, [[1, 1], [1, 1], [1, 1], [0, 0]])
    assert real.tolist() == [True, True, True, False]
