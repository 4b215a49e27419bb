import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import jaxsim
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset
from jaxsim.data.turned import Turned
from jaxsim.files import code
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
    with pytest.raises(ValueError, match=r"-\d{10}\.[0-9a-f]{16}\.npz is no readable .*; delete it"):
        prepared(open_dataset(data), [0], data, prepare=plain)


def test_labels_asked_of_frames_without_are_an_error_also_after_pairs_without_were_made(samples, tmp_path):
    data = DataConfig(kind="kitti_raw", root=samples / "kitti_raw", cache=tmp_path)
    plain = replace(PREPARE, depth="ip_basic")
    frames = open_dataset(data)
    assert len(prepared(frames, [0], data, prepare=plain)) == 1
    with pytest.raises(ValueError, match="need class labels"):
        prepared(frames, [0], data, prepare=replace(plain, inputs=("rgb", "semantic")))


def test_colours_asked_of_frames_without_image_are_an_error_also_after_pairs_without_were_made(odometry_root, tmp_path):
    """They would all be black."""
    data = DataConfig(kind="kitti_odometry", root=odometry_root, cache=tmp_path / "cache")
    frames, plain = open_dataset(data), replace(PREPARE, inputs=("depth",), depth="ip_basic_fast")
    assert [frames[i].camera.has_image for i in (0, 1)] == [True, False]
    assert [record.has_image for record in map(prepared(frames, [0, 1], data, prepare=plain).record, (0, 1))] == [1, 0]
    for inputs in (("rgb", "depth"), ("depth", "surroundings")):
        coloured = replace(plain, inputs=inputs)
        assert prepared(frames, [0], data, prepare=coloured)[0].painted.rgb.any()
        with pytest.raises(ValueError, match=r"sequence_00-000001 has no image, which the inputs \w+ need; leave them"):
            prepared(frames, [0, 1], data, prepare=coloured)


@pytest.mark.parametrize("part", ["native/patches.cc", "products.py", "weights.py", "pairs/prepared.py"])
def test_pairs_of_other_code_are_kept_apart(part, tmp_path, monkeypatch):
    """All that a pair's numbers come from: a package in which one file more differs has other folders."""
    package = tmp_path / "jaxsim"
    shutil.copytree(Path(jaxsim.__file__).parent, package, ignore=lambda _, names: [n for n in names if n[0] == "_"])
    monkeypatch.setattr(code, "__file__", str(package / "files" / "code.py"))
    before = pairs_folder(DataConfig(), PREPARE)
    assert pairs_folder(DataConfig(), PREPARE) == before
    with (package / part).open("a") as file:
        file.write("\n")
    assert pairs_folder(DataConfig(), PREPARE) != before


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


FAST = replace(PREPARE, depth="ip_basic_fast")


@pytest.fixture
def drives(raw_root, tmp_path) -> DataConfig:
    """Three frames of one date, and a copy of one of them as another date's."""
    folder = raw_root / "2011_09_28" / "2011_09_28_drive_0001_sync"
    shutil.copytree(raw_root / "2011_09_26" / "2011_09_26_drive_0002_sync", folder)
    for path in raw_root.glob("2011_09_26/*.txt"):
        shutil.copy(path, folder.parent)
    return DataConfig(kind="kitti_raw", root=raw_root, cache=tmp_path / "cache")


def made(data: DataConfig, positions=(0, 1, 2, 3)):
    """The pairs as a new command finds or makes them, and when each file was written."""
    pairs = prepared(open_dataset(data), positions, data, prepare=FAST)
    folder = pairs_folder(data, FAST)
    return pairs, [(folder / f"{Path(key).name}.npz").stat().st_mtime_ns for key in pairs.keys]


def change(path: Path, *words: str) -> None:
    text = path.read_text()
    assert words[0] in text
    path.write_text(text.replace(*words))


def test_a_mended_calibration_makes_its_frames_pairs_anew_and_no_others(drives):
    """What is learned from the old projection is wrong, and nothing would say so."""
    before, written = made(drives)
    again, same = made(drives)
    assert (again.keys, same) == (before.keys, written)
    change(drives.root / "2011_09_28" / "calib_velo_to_cam.txt", "-0.2717806", "-0.9717806")
    after, rewritten = made(drives)
    assert (after.keys[:3], rewritten[:3]) == (before.keys[:3], written[:3])
    assert (after.names, rewritten[3] > written[3]) == (before.names, True)
    assert after.keys[3] != before.keys[3]  # statistics of the old pairs are not the new ones' either
    assert not np.array_equal(after[3].painted.depth_m, before[3].painted.depth_m)
    assert after.record(3).camera.cam_from_velo[2, 3] == pytest.approx(-0.97, abs=0.01)


@pytest.mark.parametrize("kind", ["velodyne_points", "image_02"])
def test_a_mended_scan_or_image_makes_its_own_pair_anew_and_no_other(drives, kind):
    before, written = made(drives)
    (file,) = (drives.root / "2011_09_26" / "2011_09_26_drive_0002_sync" / kind / "data").iterdir()
    if kind == "image_02":
        shutil.copy(file, file.with_suffix(".old"))
        cv2.imwrite(str(file), 255 - cv2.imread(str(file)))
    else:
        points = np.fromfile(file, "<f4").reshape(-1, 4)
        points[:, 3] = 0.75  # of the same size
        points.tofile(file)
    after, rewritten = made(drives)
    kept = [0, 1, 3]
    assert [after.keys[i] for i in kept] == [before.keys[i] for i in kept]
    assert [rewritten[i] for i in kept] == [written[i] for i in kept]
    assert after.keys[2] != before.keys[2]
    one = "rgb" if kind == "image_02" else "range_m"
    changed = not np.array_equal(getattr(after[2].painted, one), getattr(before[2].painted, one))
    assert changed == (kind == "image_02")
    if kind == "velodyne_points":
        assert np.unique(after[2].measured.intensity[after[2].measured.valid]) == [0.75]


def test_pairs_of_two_beam_tables_do_not_mix(drives):
    """The table is fitted to the first scan: where its points move all pairs are made anew, where they do not, one."""
    before, _ = made(drives)
    first = drives.root / "2011_09_26" / "2011_09_26_drive_0001_sync" / "velodyne_points" / "data" / "0000000000.bin"
    points = np.fromfile(first, "<f4").reshape(-1, 4)
    points[:, 3] = 0.75
    points.tofile(first)
    fainter, _ = made(drives)
    assert [a == b for a, b in zip(fainter.keys, before.keys, strict=True)] == [False, True, True, True]
    points[:, 2] += 0.05
    points.tofile(first)
    after, _ = made(drives)
    assert not {*after.keys} & {*fainter.keys}


def test_a_mended_scan_makes_its_sides_anew(drives):
    def keys():
        dataset = Turned(open_dataset(drives))
        return prepared(dataset, dataset.sides([1]), drives, prepare=replace(FAST, inputs=("depth",))).keys

    before = keys()
    (scan,) = drives.root.glob("2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000001.bin")
    points = np.fromfile(scan, "<f4").reshape(-1, 4)
    points[:, 3] = 0.75
    points.tofile(scan)
    assert not {*keys()} & {*before}
