"""Digital twins of scans: smooth where surfaces are, sharp where they end, and ignorant of what they were not told."""

import numpy as np
import pytest

from benchmarks.blind import twins
from benchmarks.blind.hidden.frames import Grid
from benchmarks.blind.hidden.replay import Scan
from benchmarks.blind.twins import MESH_M, NOISE, TWINS, patch_means, smoothed

ROWS, COLUMNS = 12, 80
GRID = Grid(np.linspace(0.6, -0.6, COLUMNS), np.linspace(-0.05, -0.4, ROWS))


def road_and_wall(seed: int) -> Scan:
    """A road, and before its right half a wall; brightness is each surface's own, with scatter."""
    rng = np.random.default_rng(seed)
    road = np.minimum(1.7 / np.sin(-GRID.elevation)[:, None], 60) * np.ones(COLUMNS)
    wall = 4 / np.cos(GRID.azimuth) / np.cos(GRID.elevation)[:, None]
    is_wall = (GRID.azimuth < 0) & (wall < road)
    intensity = np.where(is_wall, 0.6, 0.2) + rng.normal(0, 0.05, road.shape)
    return Scan(np.where(is_wall, wall, road), intensity.clip(0, 1), 0.0)


@pytest.fixture(autouse=True)
def _few_trees(monkeypatch):
    monkeypatch.setattr(twins, "TREES", 10)


SCANS = {f"drive {k} quarter {q}": road_and_wall(10 * k + q) for k in range(3) for q in range(2)}


def test_planes_stay_planes_and_edges_stay_sharp():
    range_m = road_and_wall(0).range_m
    np.testing.assert_allclose(smoothed(range_m), range_m, rtol=0.01)
    # On the road, whose ranges are one number a row, nothing moves at all.
    np.testing.assert_allclose(smoothed(range_m)[:, :30], range_m[:, :30], rtol=1e-12)
    assert (smoothed(np.where(range_m > 10, 0, range_m)) > 0).sum() == (range_m <= 10).sum()


def test_a_patch_has_its_own_mean_and_nothing_of_the_surface_beside_it():
    scan = road_and_wall(1)
    # At its foot a wall is as far as the road.
    scan = Scan(*(image[scan.range_m[:, 0] > 6] for image in scan[:2]), 0.0)
    exact = np.where(scan.intensity > 0.4, 0.6, 0.2)
    np.testing.assert_allclose(patch_means(exact, scan.range_m), exact, rtol=1e-12)
    assert np.std(patch_means(scan.intensity, scan.range_m) - exact) < 0.5 * np.std(scan.intensity - exact)


@pytest.mark.parametrize("twin", TWINS)
def test_a_twin_returns_where_the_scan_does_and_repeats_by_its_seed(twin):
    frames, again = (TWINS[twin](SCANS, GRID, seed=3), TWINS[twin](SCANS, GRID, seed=3))
    for scan, frame, same in zip(SCANS.values(), frames, again, strict=True):
        np.testing.assert_array_equal(frame["range"] > 0, scan.range_m > 0)
        np.testing.assert_array_equal(frame["intensity"], same["intensity"])
        off = frame["range"] - smoothed(scan.range_m)
        assert off.std() == pytest.approx(np.hypot(MESH_M, NOISE["range_m"]) if twin == "patches" else 0, abs=0.004)
        assert np.abs(frame["intensity"] - scan.intensity).mean() < 0.1


def test_trees_know_nothing_of_the_drive_that_they_stand_for():
    frames = TWINS["trees"](SCANS, GRID, seed=0)
    darker = {name: scan._replace(intensity=scan.intensity / 2) for name, scan in SCANS.items() if "drive 1" in name}
    changed = TWINS["trees"](SCANS | darker, GRID, seed=0)
    for name, before, after in zip(SCANS, frames, changed, strict=True):
        assert np.array_equal(before["intensity"], after["intensity"]) == ("drive 1" in name)


def test_trees_ask_for_drives_to_learn_on():
    with pytest.raises(ValueError, match="twins: 1 drives; trees of one group learn on two others: give 3 or more"):
        TWINS["trees"]({"drive 1 quarter 0": road_and_wall(0)}, GRID, seed=0)
