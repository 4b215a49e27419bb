from dataclasses import replace

import numpy as np
import pytest

from jaxsim.frame import PolarGrid
from jaxsim.geometry import PRESETS, LidarSpec, full_grid, grid_difference, preset, same_grid, window_grid

GRID = PolarGrid(np.float32([0.2, 0.1, 0.0]), np.float32([0.05, -0.05]), np.float32([0.0, 0.1]))


@pytest.mark.parametrize(("name", "rows"), [("hdl64e", 64), ("hdl32e", 32), ("vlp16", 16), ("os1_128", 128)])
def test_a_preset_is_a_whole_and_hashable_sensor(name, rows):
    spec = preset(name)
    assert spec.name == name
    assert spec.rows == rows == len(spec.origin_m)
    assert hash(spec) == hash(replace(spec))
    assert (np.diff(spec.elevation_rad) < 0).all()


def test_the_hdl64e_has_two_blocks():
    spec = preset("hdl64e")
    upper, lower = spec.elevation_deg[:32], spec.elevation_deg[32:]
    assert np.mean(-np.diff(upper)) == pytest.approx(1 / 3, abs=0.02)
    assert np.mean(-np.diff(lower)) == pytest.approx(1 / 2, abs=0.02)
    assert min(spec.origin_m[:32]) - max(spec.origin_m[32:]) > 0.07


def test_an_unknown_sensor_answers_with_the_known_ones():
    with pytest.raises(ValueError, match=r"hdl46e.*known: hdl64e, hdl32e, vlp16, os1_128"):
        preset("hdl46e")


def test_a_table_of_unequal_lengths_is_refused():
    with pytest.raises(ValueError, match="3 elevations but 2 origins"):
        LidarSpec("odd", (1.0, 0.0, -1.0), (0.0, 0.0), 1024, 1.0, 100.0)


def test_a_table_from_the_bottom_up_is_refused():
    with pytest.raises(ValueError, match="top beam first"):
        LidarSpec("upside down", (-1.0, 0.0, 1.0), (0.0,) * 3, 1024, 1.0, 100.0)


def test_the_whole_turn_runs_from_left_to_right_with_forward_in_the_middle():
    grid = full_grid(preset("vlp16"), 1800)
    assert grid.azimuth_rad[0] == pytest.approx(np.pi - np.pi / 1800, abs=1e-6)
    assert grid.azimuth_rad[-1] == -grid.azimuth_rad[0]
    assert np.abs(grid.azimuth_rad[[899, 900]]) == pytest.approx(np.pi / 1800, abs=1e-6)
    assert (np.diff(grid.azimuth_rad) < 0).all()
    assert full_grid(PRESETS["vlp16"]).azimuth_rad.shape == (1808,)


def test_a_window_has_its_edges_half_a_cell_beyond_its_border_cells():
    grid = window_grid(preset("hdl64e"), 0.5, -0.3, columns=100, rows=(2, 10))
    assert grid.azimuth_rad[0] == pytest.approx(0.5 - 0.004)
    assert grid.azimuth_rad[-1] == pytest.approx(-0.3 + 0.004)
    assert grid.elevation_rad == pytest.approx(preset("hdl64e").elevation_rad[2:10], abs=1e-7)
    assert grid.origin_m == pytest.approx(preset("hdl64e").origin_m[2:10])


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ((-0.5, 0.5, 100, None), "falls from left to right"),
        ((4.0, -4.0, 100, None), "at most a turn"),
        ((0.5, -0.5, 1, None), "2 columns or more, got 1"),
        ((0.5, -0.5, 100, (4, 4)), "rows 4..4"),
        ((0.5, -0.5, 100, (0, 65)), "do not lie in the 64 lines"),
    ],
)
def test_an_impossible_window_is_refused(window, message):
    left, right, columns, rows = window
    with pytest.raises(ValueError, match=message):
        window_grid(preset("hdl64e"), left, right, columns=columns, rows=rows)


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
