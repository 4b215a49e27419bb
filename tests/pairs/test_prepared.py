from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.pairs.prepared import pairs_folder, prepared

PREPARE = PrepareConfig(inputs=("rgb", "depth"), columns=64)


def test_pairs_are_shared_by_settings_that_do_not_change_them_and_by_no_others():
    data = DataConfig()
    folder = pairs_folder(data, PREPARE)
    assert folder == pairs_folder(replace(data, train="7"), replace(PREPARE, inputs=("row",), network_size=(32, 64)))
    labelled = pairs_folder(data, replace(PREPARE, inputs=("edges",)))
    assert labelled == pairs_folder(data, replace(PREPARE, inputs=("rgb", "semantic")))
    others = [
        pairs_folder(replace(data, seed=1), PREPARE),
        pairs_folder(data, replace(PREPARE, columns=65)),
        pairs_folder(data, replace(PREPARE, denoise="non_local_means")),
        pairs_folder(replace(data, kind="kitti_raw", root=Path("a")), PREPARE),
        labelled,
    ]
    assert len({folder, *others}) == 6


def test_a_pair_is_made_once_and_read_as_it_was_made(tmp_path):
    data = DataConfig(cache=tmp_path)
    world = open_dataset("synthetic")
    first = prepared(world, [3], data, prepare=PREPARE)
    (file,) = pairs_folder(data, PREPARE).iterdir()
    assert first.keys == [f"{file.parent.name}/{file.stem}"]
    stamp = file.stat().st_mtime_ns
    again = prepared(world, [3], data, prepare=PREPARE)
    assert file.stat().st_mtime_ns == stamp
    assert again.names == [world.name_of(3)]
    pair, grid = again[0], again.record(0).grid
    assert again.windows == {pair.target.shape}
    assert pair.target.shape == (len(grid.elevation_rad), 64)
    assert pair.painted.valid.mean() > 0.8
    both = pair.painted.valid & pair.measured.valid
    assert np.median(np.abs(pair.painted.range_m - pair.measured.range_m)[both]) < 0.1


def test_pairs_made_with_labels_serve_settings_without(tmp_path):
    data, world = DataConfig(cache=tmp_path), open_dataset("synthetic")
    made = prepared(world, [3, 5], data, prepare=replace(PREPARE, inputs=("edges", "rgb")))
    assert prepared(world, [5], data, prepare=PREPARE).keys == made.keys[1:]
    assert prepared(world, [5, 6], data, prepare=PREPARE).keys != made.keys
    assert len(list(tmp_path.iterdir())) == 2


def test_a_damaged_file_of_the_cache_is_named(samples, tmp_path):
    data = DataConfig(kind="kitti_raw", root=samples / "kitti_raw", cache=tmp_path)
    plain = replace(PREPARE, depth="ip_basic_fast")
    prepared(open_dataset(data), [0], data, prepare=plain)
    (file,) = pairs_folder(data, plain).iterdir()
    file.write_bytes(file.read_bytes()[:-500])
    with pytest.raises(ValueError, match=r"-\d{10}\.npz is no readable .*; delete it"):
        prepared(open_dataset(data), [0], data, prepare=plain)


def test_labels_asked_of_frames_without_are_an_error_also_after_pairs_without_were_made(samples, tmp_path):
    data = DataConfig(kind="kitti_raw", root=samples / "kitti_raw", cache=tmp_path)
    plain = replace(PREPARE, depth="ip_basic")
    frames = open_dataset(data)
    assert len(prepared(frames, [0], data, prepare=plain)) == 1
    with pytest.raises(ValueError, match="need class labels"):
        prepared(frames, [0], data, prepare=replace(plain, inputs=("rgb", "semantic")))


class Named:
    """Frames of the embedded world, under names of their own."""

    def __init__(self, *positions: int):
        self.world, self.positions = open_dataset("synthetic"), positions
        self.spec = self.world.spec

    def __getitem__(self, index):
        return self.world[self.positions[index]]

    def name_of(self, index):
        return self.world.name_of(self.positions[index])


def test_what_is_added_to_a_data_set_moves_no_pair_that_is_kept(tmp_path):
    """A drive that sorts before others moves their positions: the pairs of old positions must not pass for the new."""
    data = DataConfig(cache=tmp_path)
    first = prepared(Named(7), [0], data, prepare=PREPARE)
    (kept,) = pairs_folder(data, PREPARE).iterdir()
    stamp = kept.stat().st_mtime_ns
    more = prepared(Named(3, 7), [0, 1], data, prepare=PREPARE)
    assert more.names == [Named(3, 7).name_of(i) for i in (0, 1)]
    assert more.keys[1:] == first.keys
    assert kept.stat().st_mtime_ns == stamp
    assert not np.array_equal(more[0].target, more[1].target)
