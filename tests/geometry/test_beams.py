"""Beams told from points, against what made the points and against another program."""

import numpy as np
import pytest

from jaxsim.data.clouds import read_scan
from jaxsim.frame import PolarGrid
from jaxsim.geometry.beams import assign_columns, beams_of_rings, column_azimuths, rings_by_elevation
from jaxsim.geometry.sensor import full_grid, preset
from tests.geometry.made_beams import cloud


@pytest.mark.parametrize("name", ["vlp16", "hdl32e", "hdl64e", "os1_128"])
def test_the_table_that_made_the_points_comes_back(name):
    xyz, ring, spec = cloud(name)
    beams = beams_of_rings(xyz, ring)
    np.testing.assert_allclose(beams.elevation_rad, spec.elevation_rad, atol=2e-5)
    np.testing.assert_allclose(beams.origin_m, spec.origin_m, atol=1e-3)
    np.testing.assert_array_equal(beams.rows_of(ring), ring)


def test_unknown_rings_have_no_row():
    xyz, ring, _ = cloud("vlp16")
    assert (beams_of_rings(xyz, ring).rows_of(np.array([-3, 16, 99])) == -1).all()


def test_rings_that_count_from_one_are_as_many_as_those_from_zero():
    xyz, ring, spec = cloud("vlp16")
    beams = beams_of_rings(xyz, ring + 1, first=1)
    np.testing.assert_allclose(beams.elevation_rad, spec.elevation_rad, atol=2e-5)
    np.testing.assert_array_equal(beams.rows_of(ring + 1), ring)
    assert len(beams_of_rings(xyz, ring + 1, rings=20, first=1).ring) == 20
    with pytest.raises(ValueError, match=r"rings are 0\.\.15 in \d+ points; they count from 1"):
        beams_of_rings(xyz, ring, first=1)


@pytest.mark.parametrize("name", ["vlp16", "hdl32e", "os1_128"])
def test_gaps_between_elevations_tell_rings(name):
    xyz, ring, spec = cloud(name)
    found = rings_by_elevation(xyz)
    np.testing.assert_array_equal(found, spec.rows - 1 - ring)
    np.testing.assert_array_equal(rings_by_elevation(xyz, lines=spec.rows), found)


@pytest.mark.slow
def test_beams_of_a_real_scan_are_those_that_another_program_finds(samples):
    """Of KITTI's first raw scan, whose beams start at two heights. alice-lri takes four minutes."""
    alice_lri = pytest.importorskip("alice_lri", reason="alice-lri is not installed")
    path = next((samples / "kitti_raw").rglob("velodyne_points/data/*.bin"))
    scan = read_scan(path, "file_order")
    xyz = np.asarray(scan.xyz_m).astype(np.float64)
    theirs = alice_lri.estimate_intrinsics(*xyz.T)
    angles = np.sort([line.vertical_angle for line in theirs.scanlines])[::-1]
    ours = beams_of_rings(np.asarray(scan.xyz_m), np.asarray(scan.row).astype(np.int64))
    assert len(angles) == 64
    np.testing.assert_allclose(np.rad2deg(ours.elevation_rad), np.rad2deg(angles), atol=0.02)


def test_columns_keep_the_distance_of_firings():
    """Against the plainest oracle: firing k of a ring that fires steadily lies k columns on."""
    grid = full_grid(preset("vlp16"), 360)
    step = 2 * np.pi / 360
    for phase in (0.1, 0.499, 0.501, 0.9):
        k = np.arange(360)
        azimuth = np.pi - (k + phase) * step + np.random.default_rng(3).uniform(-0.2, 0.2, 360) * step
        column = assign_columns(azimuth, np.zeros(360, int), grid)
        assert (np.diff(column[5:-5]) == 1).all()
        assert np.abs(column - (k + phase - 0.5))[5:-5].max() <= 0.75 + 1e-6


@pytest.mark.parametrize("lost", [0.5, 0.6])
def test_columns_are_counted_where_more_than_half_of_the_firings_are_lost(lost):
    rng = np.random.default_rng(0)
    firings = [(np.arange(1808) + rng.uniform())[rng.random(1808) >= lost] * 2 * np.pi / 1808 for _ in range(16)]
    row = np.repeat(np.arange(16), [len(one) for one in firings])
    azimuth = (np.concatenate(firings) + np.pi) % (2 * np.pi) - np.pi
    assert len(column_azimuths(azimuth.astype("f4"), row)) == 1808


def test_firings_that_are_not_evenly_spaced_have_columns_of_their_own():
    """An HDL-64E fires six times 0.18 degrees apart and then 0.09: at the median's step it would lose a seventh."""
    rng = np.random.default_rng(5)
    steps = np.deg2rad(np.resize([0.18] * 6 + [0.09], 2154))
    turn = np.pi - np.cumsum(steps)
    azimuth = np.concatenate([turn + phase for phase in rng.uniform(0, 0.003, 8)])
    row = np.repeat(np.arange(8), len(turn))
    back = rng.random(len(row)) > 0.1  # a tenth does not come back
    azimuths = column_azimuths(azimuth[back], row[back])
    assert abs(len(azimuths) - 2 * np.pi / steps.mean()) <= 3
    grid = PolarGrid(azimuths.astype("f4"), np.linspace(0.1, -0.1, 8, dtype="f4"), np.zeros(8, "f4"))
    cells = np.stack([row[back], assign_columns(azimuth[back], row[back], grid)])
    assert len(np.unique(cells, axis=1).T) > 0.99 * back.sum()
