"""Frames on both sides of a split are told, whatever they are called."""

import logging
import shutil

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.seen import MOST, SplitSide, frames_seen, warn_of_scenes, warn_of_seen, warn_of_seen_pairs
from jaxsim.pairs.prepared import prepared

PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic_fast", columns=64)


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.WARNING)
    return caplog


def pairs(root, tmp_path, positions):
    data = DataConfig("kitti_raw", root=root, cache=tmp_path / "cache")
    return prepared(open_dataset(data), positions, data, prepare=PREPARE)


def test_frames_of_both_sides_are_counted_and_the_first_is_named(raw_root, tmp_path, said):
    warn_of_seen_pairs(pairs(raw_root, tmp_path, [0, 1]), pairs(raw_root, tmp_path, [1, 2]))
    # The three scans of the fixture hold the same points, so that the third is a copy.
    assert "2 of the 2 frames that judge are training frames too, or copies of them (the first: " in said.messages[0]


def test_a_copied_drive_is_known_by_what_was_measured(raw_root, tmp_path, said):
    for number, path in enumerate(sorted(raw_root.glob("2011_09_26/*/velodyne_points/data/*.bin"))):
        points = np.fromfile(path, "<f4").reshape(-1, 4)
        points[:, 3] = np.clip(points[:, 3] + 0.01 * number, 0, 1)
        points.tofile(path)
    learned, judged = pairs(raw_root, tmp_path, [0, 1]), pairs(raw_root, tmp_path, [2])
    warn_of_seen_pairs(learned, judged)
    assert not said.messages
    date = raw_root / "2011_09_26"
    shutil.copytree(date / "2011_09_26_drive_0001_sync", date / "2011_09_26_drive_0003_sync")
    warn_of_seen_pairs(learned, pairs(raw_root, tmp_path, [2, 3]))
    assert "1 of the 2 frames" in said.messages[0]
    assert "drive_0003" in said.messages[0]


def test_scenes_of_both_sides_are_told_where_no_frame_is(raw_root, tmp_path, said):
    path = min(raw_root.glob("2011_09_26/*_0001_sync/velodyne_points/data/*.bin"))
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    points[:, 3] /= 2
    points.tofile(path)
    warn_of_seen_pairs(pairs(raw_root, tmp_path, [0]), pairs(raw_root, tmp_path, [1]))
    assert "scenes on both sides of the split, 2011_09_26_drive_0001_sync: the network" in said.messages[0]


def test_many_frames_are_known_by_their_keys_alone():
    def values(i):
        raise AssertionError("read")

    learned = SplitSide(range(MOST), values)
    assert frames_seen(learned, SplitSide([MOST, 3, 4], values)) == [1, 2]


def test_frames_without_a_measurement_are_no_copies_of_one_another(said):
    nothing = SplitSide(["a"], lambda i: [np.zeros(0)])
    assert frames_seen(nothing, SplitSide(["b"], nothing.values)) == []
    assert not warn_of_seen(SplitSide([1, 2]), SplitSide([3]), names=["c"])
    warn_of_scenes((), who="the network")
    assert not said.messages
