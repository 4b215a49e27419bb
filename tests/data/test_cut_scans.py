"""Scans that were cut between two points, and clouds that no LiDAR measures, come through no reader."""

import warnings

import numpy as np
import pytest

from jaxsim.data import KittiRaw
from jaxsim.data.clouds import ROAD_DEG, cloud_files, read_cloud, read_scan
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import read_frame
from jaxsim.evaluate.cloud_folder import read_points
from jaxsim.evaluate.generation import open_folder
from jaxsim.geometry import UnorderedCloud, preset, recover_rows
from tests.data.round_room import scan, write_scan


@pytest.mark.parametrize("share", [0.999, 0.995, 0.98, 0.75, 0.5, 0.1])
def test_a_scan_that_is_cut_between_two_points_is_refused(tmp_path, share):
    points = scan()
    path = tmp_path / "a.bin"
    points.tofile(path)
    assert len(read_scan(path, "file_order").xyz_m) == len(points)
    points[: int(share * len(points))].tofile(path)
    with pytest.raises(ValueError, match=r"ends in laser line \d+ of 63 .*the file is cut off"):
        read_scan(path, "file_order")


def test_a_cloud_that_was_cropped_to_a_camera_is_not_taken_for_a_cut_one(tmp_path):
    points = scan()
    ahead = points[np.abs(np.arctan2(points[:, 1], points[:, 0])) < np.deg2rad(40)]
    ahead = ahead[ahead[:, 2] > -1]
    ahead.tofile(tmp_path / "a.bin")
    assert len(read_scan(tmp_path / "a.bin", "file_order").xyz_m) == len(ahead)


def test_real_scans_are_whole_and_their_halves_are_not(samples, tmp_path):
    files = [*samples.glob("kitti_raw/2011_09_26/*/velodyne_points/data/*.bin")]
    files += [*samples.glob("kitti_object/training/velodyne/*.bin"), *samples.glob("semantickitti*/**/velodyne/*.bin")]
    assert files
    for path in files:
        read_scan(path, "file_order")
    whole = np.fromfile(files[0], "<f4").reshape(-1, 4)
    for count in [*np.linspace(1000, len(whole) - 200, 20).astype(int), len(whole) - 30]:
        whole[:count].tofile(tmp_path / "a.bin")
        with pytest.raises(ValueError, match="the file is cut off"):
            read_scan(tmp_path / "a.bin", "file_order")


def test_a_scan_of_fewer_lines_is_told(tmp_path):
    points = scan()
    row = recover_rows(points[:, :3], spec=preset("hdl64e"))
    points[(row < 30) | (row > 33)].tofile(tmp_path / "a.bin")
    with pytest.raises(ValueError, match=r"no point in laser lines 30, 31, 32, 33 of 0\.\.63.*these see the road"):
        read_scan(tmp_path / "a.bin", "file_order")
    points[row > 5].tofile(tmp_path / "b.bin")
    with pytest.warns(UserWarning, match=r"no point in laser lines 0, 1, 2, 3, 4, 5 of 0\.\.63"):
        cloud = read_scan(tmp_path / "b.bin", "file_order")
    np.testing.assert_array_equal(cloud.row, row[row > 5])


def _dimmed(points, factor):
    points[:, 3] *= factor
    return points


DAMAGED = {
    "its head alone": (lambda p: p[:10], "holds 10 points; a whole scan has about 120000"),
    "no head": (lambda p: p[int(0.3 * len(p)) :], "no point in laser lines 0, .*these see the road"),
    "every second point": (lambda p: p[::2], r"of a whole scan nearly all of 2007 firings come back.*thinned"),
    "half the points": (lambda p: p[np.random.default_rng(0).random(len(p)) < 0.5], "thinned or damaged"),
    "no intensity": (lambda p: _dimmed(p, 0), "no point has an intensity above 0; .*use the file as recorded"),
    "intensity divided twice": (lambda p: _dimmed(p, 1 / 255), r"no point has an intensity above 0\.00"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_scan_that_lost_much_is_no_truth_for_training(tmp_path, damage):
    change, message = DAMAGED[damage]
    change(scan(columns=1900)).tofile(tmp_path / "a.bin")
    with pytest.raises(ValueError, match=message):
        read_scan(tmp_path / "a.bin", "file_order")


@pytest.mark.parametrize("rows", ["file_order", "elevation"])
@pytest.mark.parametrize("part", [slice(60000, None), slice(0, 300), slice(5000, 5256)])
def test_a_scan_of_which_a_part_was_never_written_is_refused(tmp_path, rows, part):
    points = scan(columns=1900)
    points[part] = 0
    points.tofile(tmp_path / "a.bin")
    with pytest.raises(ValueError, match=rf"points hold zeros alone, from number {part.start} on: .*copy it again"):
        read_scan(tmp_path / "a.bin", rows)
    with pytest.raises(ValueError, match="zeros alone"):
        read_points(tmp_path / "a.bin")


def test_single_points_at_the_sensor_do_not_make_a_file_a_lost_one(tmp_path):
    points = scan(columns=1900)
    points[::300] = 0
    points[1000:1200] = 0
    points.tofile(tmp_path / "a.bin")
    assert len(read_cloud(tmp_path / "a.bin")) == len(points)


@pytest.mark.parametrize("damage", DAMAGED)
def test_frames_of_a_damaged_scan_say_what_is_wrong_with_it(tmp_path, damage):
    change, message = DAMAGED[damage]
    write_scan(tmp_path / "velodyne/000000.bin", change(scan(columns=1900)))
    kind, source = source_for(tmp_path)
    with pytest.raises(ValueError, match=message):
        write_log(tmp_path, kind, source, out=tmp_path / "out", options=LogOptions())


@pytest.mark.parametrize(("every", "low", "high"), [(1, 0.84, 1.07), (2, 0.4, 0.54)])
def test_the_middle_line_of_the_road_brings_back_nearly_all_firings_of_a_real_scan(samples, every, low, high):
    files = [*samples.glob("kitti_raw/2011_09_26/*/velodyne_points/data/*.bin")]
    assert files
    spec = preset("hdl64e")
    road = np.asarray(spec.elevation_deg) < ROAD_DEG
    for file in files:
        points = np.fromfile(file, np.float32).reshape(-1, 4)
        row = recover_rows(points[:, :3], lines=spec.rows, spec=spec)[::every]
        middle = np.median(np.bincount(row, minlength=spec.rows)[road])
        assert low <= middle / spec.columns <= high


def test_a_real_scan_that_was_damaged_is_refused(samples, tmp_path):
    files = [*samples.glob("kitti_raw/2011_09_26/*/velodyne_points/data/*.bin")]
    whole = np.fromfile(files[0], "<f4").reshape(-1, 4)
    for change, message in DAMAGED.values():
        change(whole.copy()).tofile(tmp_path / "a.bin")
        with pytest.raises(ValueError, match=message):
            read_scan(tmp_path / "a.bin", "file_order")


def test_a_drive_in_millimetres_is_refused(raw_root):
    for path in raw_root.glob("2011_09_26/*/velodyne_points/data/*.bin"):
        points = np.fromfile(path, "<f4").reshape(-1, 4)
        points[:, :3] *= 1000
        points.tofile(path)
    with pytest.raises(ValueError, match="must be in metres"):
        KittiRaw(raw_root)[0]


def _spoilt(k: int, value: float):
    def change(points):
        points[3, k] = value

    return change


WRONG = {
    "nan": (_spoilt(0, np.nan), "1 of 500 points are NaN or infinite"),
    "far": (_spoilt(1, 1e30), "no LiDAR sees beyond 1000 m"),
    "high": (_spoilt(3, 7.0), "it must lie in 0..1"),
    "low": (_spoilt(3, -3.0), "it must lie in 0..1"),
    "intensity nan": (_spoilt(3, np.nan), "NaN or infinite"),
}


def write(folder, suffix, points):
    folder.mkdir(exist_ok=True)
    if suffix == ".bin":
        points.astype("<f4").tofile(folder / "a.bin")
    else:
        np.savez(folder / "a.npz", xyz=points[:, :3], intensity=points[:, 3])
    return folder / f"a{suffix}"


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("suffix", [".bin", ".npz"])
def test_every_reader_of_clouds_refuses_what_no_lidar_measures(tmp_path, suffix, wrong):
    points = np.random.default_rng(0).uniform(0, 1, (500, 4))
    readers = {
        "read_cloud": read_cloud,
        "jaxsim detect": read_points,
        "eval generation": lambda path: open_folder(path.parent).points("a"),
    }
    path = write(tmp_path / "clouds", suffix, points)
    for read in readers.values():
        assert read(path).shape == (500, 4)
    change, message = WRONG[wrong]
    change(points)
    write(tmp_path / "clouds", suffix, points)
    for read in readers.values():
        with pytest.raises(ValueError, match=message):
            read(path)


def test_polar_frames_in_millimetres_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", range=np.full((2, 2), 20e3), intensity=np.ones((2, 2)))
    with pytest.raises(ValueError, match="must be in metres, and no LiDAR sees beyond 1000 m"):
        read_frame(tmp_path, "a")


@pytest.mark.parametrize(
    "arrays",
    [
        {"xyz": np.ones((3, 2))},
        {"xyz": np.ones(3)},
        {"xyz": np.full((3, 3), "x")},
        {"xyz": np.ones((3, 3)), "intensity": np.ones(2)},
        {"xyz": np.ones((3, 3)), "intensity": np.ones(3, bool)},
    ],
)
def test_arrays_that_are_no_cloud_are_refused(tmp_path, arrays):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=r"holds (no array xyz|intensity)"):
        read_cloud(tmp_path / "a.npz")


def test_intensity_is_the_fourth_column_in_whatever_order_a_file_has_it(tmp_path):
    np.savez(tmp_path / "a.npz", intensity=np.zeros(3), xyz=np.ones((3, 3)))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.npz"), np.float32([[1, 1, 1, 0]] * 3))


def test_a_name_that_comes_with_both_suffixes_is_judged_by_nobody(tmp_path):
    for suffix in (".bin", ".npz"):
        write(tmp_path / "clouds", suffix, np.random.default_rng(0).uniform(0, 1, (5, 4)))
    for read in (cloud_files, open_folder):
        with pytest.raises(ValueError, match=r"holds a twice, as \.bin and \.npz"):
            read(tmp_path / "clouds")


def test_mirrored_scans_are_refused_or_told(samples, tmp_path):
    """The rows of some are right by their elevations, and cloud and image do not fit."""
    files = sorted(samples.glob("kitti_raw/2011_09_26/*/velodyne_points/data/*.bin"))
    told = 0
    for file in files:
        points = np.fromfile(file, "<f4").reshape(-1, 4)
        points[:, 1] *= -1
        points.tofile(tmp_path / file.name)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                read_scan(tmp_path / file.name, "file_order")
            except UnorderedCloud:
                continue
        assert "its points run clockwise" in str(caught[0].message)
        told += 1
    assert files
    assert told
