"""Recordings of makers and data sets: real ones, and small ones in their formats."""

import os
import shutil

import numpy as np
import pytest

from jaxsim.data import open_dataset
from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.made_logs import frames_of


def test_what_is_no_regular_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "x.ply")
    pytest.importorskip("plyfile", reason="plyfile is not installed")
    with pytest.raises(ValueError, match=r"ply: .*x.ply is no regular file"):
        frames_of(tmp_path / "x.ply", tmp_path / "out")


def test_times_of_a_drive_are_times(tmp_path):
    kind, source = source_for(tmp_path, "kitti")
    folder = tmp_path / "velodyne_points/data"
    folder.mkdir(parents=True)
    (folder / "0000000000.bin").write_bytes(bytes(16))
    for name, content, message in (
        ("timestamps.txt", "yesterday\n", r"timestamps.txt, line 1: 'yesterday' is no time such as 2011-09-26"),
        ("times.txt", "1_0\n", r"times.txt, line 1: '1_0' is no number"),
    ):
        path = folder.parent / name
        path.write_text(content)
        with pytest.raises(ValueError, match=message):
            write_log(tmp_path, kind, source, out=tmp_path / "out", options=LogOptions())
        path.unlink()


@pytest.mark.parametrize(
    ("kind", "drive", "times", "line"),
    [
        (
            "kitti_raw",
            "2011_09_26/2011_09_26_drive_0001_sync",
            "velodyne_points/timestamps.txt",
            "1970-01-01 00:00:0{}.500000000\n",
        ),
        ("kitti_odometry", "sequences/00", "times.txt", "{}.5\n"),
    ],
)
def test_a_scan_has_the_time_of_its_number_where_a_drive_lacks_scans(request, tmp_path, kind, drive, times, line):
    root = request.getfixturevalue("raw_root" if kind == "kitti_raw" else "odometry_root")
    for file in (root / drive).rglob("*1.*"):
        file.rename(file.with_stem(file.stem[:-1] + "3"))
    (root / drive / times).write_text("".join(map(line.format, range(4))))
    _, frames = frames_of(root / drive, tmp_path / "out")
    assert [about["time"] for about in frames.about.values()] == [0.5, 3.5]
    dataset = open_dataset(kind, root)
    assert [dataset[k].time_s for k in range(2)] == [0.5, 3.5]


def test_frames_of_the_object_benchmark_have_the_names_that_the_data_set_gives_them(object_root, tmp_path):
    whole = object_root / "training/velodyne"
    shutil.copytree(whole, whole.with_name("velodyne_reduced"))
    shutil.copytree(object_root / "training", object_root / "testing")
    _, frames = frames_of(object_root, tmp_path / "out")
    dataset = open_dataset("kitti_object", object_root)
    assert {*frames.names} == {dataset.name_of(k) for k in range(len(dataset))} == {"000007", "testing-000007"}
    assert {about["scene"] for about in frames.about.values()} == {*frames.names}


def test_points_of_a_shuffled_scan_lie_on_the_nearest_beams_where_the_sensor_is_named(object_root, tmp_path):
    path = object_root / "training/velodyne/000007.bin"
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    np.random.default_rng(0).permutation(points).tofile(path)
    with pytest.raises(ValueError, match=r"000007\.bin: .* take the nearest beam: .*--log\.sensor hdl64e"):
        frames_of(object_root, tmp_path / "out")
    with pytest.raises(ValueError, match=r"--log\.sensor is 'vlp16'; these scans are of hdl64e"):
        frames_of(object_root, tmp_path / "out", sensor="vlp16")
    _, frames = frames_of(object_root, tmp_path / "out", sensor="hdl64e")
    image, _ = frames.read("000007")
    line = np.arange(64)[:, None] / 100  # as the scan was made
    np.testing.assert_allclose(image.intensity[image.valid], np.broadcast_to(line, image.valid.shape)[image.valid])


def test_ousters_recording(samples, tmp_path):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    kind, frames = frames_of(samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap", tmp_path)
    image, more = frames.read(frames.names[0])
    assert kind == "ouster"
    assert image.range_m.shape == (32, 1024)
    with pytest.raises(
        ValueError, match=r"--log\.columns is 512, and .* comes on the 1024 columns of its sensor's own"
    ):
        frames_of(samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap", tmp_path / "narrow", columns=512)
    assert 0.08 < more["time"].max() < 0.11
    # Without the sensor's description the packets are taken for another maker's, and are none of those.
    shutil.copy(samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap", tmp_path / "alone.pcap")
    with pytest.raises((ValueError, ModuleNotFoundError), match="velodyne: "):
        frames_of(tmp_path / "alone.pcap", tmp_path / "out")


def test_ousters_own_format_holds_the_same_frames_as_its_packets(samples, tmp_path):
    """An OSF that ouster-sdk writes of a recording; it needs no description beside it."""
    sdk = pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    osf = pytest.importorskip("ouster.sdk.osf", reason="ouster-sdk is not installed")
    recording = samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap"
    source = sdk.open_source(str(recording))
    writer = osf.Writer(str(tmp_path / "drive.osf"), source.sensor_info)
    for scan in source:
        writer.save(scan)
    writer.close()
    _, packets = frames_of(recording, tmp_path / "of_packets")
    kind, frames = frames_of(tmp_path / "drive.osf", tmp_path / "of_osf")
    assert kind == "ouster"
    assert len(frames.names) == len(packets.names)
    for ours, theirs in zip(frames.names, packets.names, strict=True):
        image, more = frames.read(ours)
        expected, beside = packets.read(theirs)
        np.testing.assert_array_equal(image.range_m, expected.range_m)
        np.testing.assert_array_equal(image.intensity, expected.intensity)
        np.testing.assert_array_equal(more["time"], beside["time"])


def test_of_an_ousters_two_returns_the_one_is_taken_that_was_asked_for(samples, tmp_path):
    """A recording as its profile of two returns would hold it: every other column has a second echo, 1 m behind."""
    sdk = pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    osf = pytest.importorskip("ouster.sdk.osf", reason="ouster-sdk is not installed")
    source = sdk.open_source(str(samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap"))
    recorded, info = next(iter(source))[0], source.sensor_info[0]
    info.format.udp_profile_lidar = sdk.core.UDPProfileLidar.RNG19_RFL8_SIG16_NIR16_DUAL
    frame = sdk.core.LidarFrame(info)
    for name in recorded.fields:
        frame.field(name)[:] = recorded.field(name)
    for name in ("timestamp", "status", "measurement_id"):
        getattr(frame, name)[:] = getattr(recorded, name)
    twice = recorded.field("RANGE") > 0
    twice[:, ::2] = False
    frame.field("RANGE2")[:] = np.where(twice, recorded.field("RANGE") + 1000, 0)
    frame.field("REFLECTIVITY2")[:] = 7
    writer = osf.Writer(str(tmp_path / "twice.osf"), info)
    writer.save(0, frame)
    writer.close()
    images = {}
    for returns in ("strongest", "last"):
        _, frames = frames_of(tmp_path / "twice.osf", tmp_path / returns, returns=returns)
        images[returns], _ = frames.read(frames.names[0])
    behind = np.asarray(images["last"].range_m - images["strongest"].range_m)
    farther = behind > 0.5
    assert farther.sum() == twice.sum()
    np.testing.assert_allclose(behind[farther], 1.0, atol=1e-4)
    np.testing.assert_allclose(behind[~farther], 0.0, atol=1e-6)
    np.testing.assert_allclose(images["last"].intensity[farther], 7 / 255, atol=1e-6)


def test_nuscenes_sweeps(samples, tmp_path):
    with pytest.raises(ValueError, match=r"--log\.rings is for logs of points, and .* comes on the grid"):
        frames_of(samples / "nuscenes", tmp_path, rings="0-15")
    with pytest.raises(ValueError, match=r"--log\.full-scale is 100; .* is 0\.\.255: leave it out"):
        frames_of(samples / "nuscenes", tmp_path, full_scale=100.0)
    kind, frames = frames_of(samples / "nuscenes", tmp_path)
    assert kind == "nuscenes"
    assert frames.read(frames.names[0])[0].range_m.shape == (32, 900)


def test_kittis_raw_drive_lies_on_its_units_own_beams(samples, tmp_path):
    kind, source = source_for(samples / "kitti_raw")
    written = write_log(samples / "kitti_raw", kind, source, out=tmp_path, options=LogOptions(), most=2)
    assert (kind, written.frames, written.rows) == ("kitti", 2, 64)
    frames = open_polar_frames(tmp_path)
    assert {about["scene"] for about in frames.about.values()} == {"2011_09_26_drive_XXXX_sync"}
    assert frames.grid.origin_m[0] == pytest.approx(0.209, abs=0.01)
    assert frames.read(frames.names[0])[0].valid.mean() > 0.7


@pytest.mark.parametrize(("rings", "top"), [("", 15.0), ("32-63", 25.0)])
def test_each_of_argoverses_two_sensors_is_told_from_its_beams(samples, tmp_path, rings, top):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    kind, frames = frames_of(samples / "argoverse2", tmp_path, rings=rings)
    assert kind == "argoverse2"
    image, _ = frames.read(frames.names[0])
    elevation = np.rad2deg(frames.grid.elevation_rad)
    # A VLP-32C's table, which nothing here was told; the lower sensor hangs upside down.
    table = np.array([15, 10.333, 7, 4.667, 3.333, 2.333, 1.667, 1.333, 1, 0.667, 0.333, 0, -0.333, -0.667, -1, -1.333])
    rest = [
        -1.667,
        -2,
        -2.333,
        -2.667,
        -3,
        -3.333,
        -3.667,
        -4,
        -4.667,
        -5.333,
        -6.148,
        -7.254,
        -8.843,
        -11.31,
        -15.639,
        -25,
    ]
    table = np.concatenate([table, rest])
    np.testing.assert_allclose(elevation, table if top == 15 else -table[::-1], atol=0.06)
    assert image.range_m.shape == (32, 1808)
    assert image.valid.mean() > 0.8  # the lower one looks up, into the sky


def test_argoverses_damaged_tables(tmp_path):
    feather = pytest.importorskip("pyarrow.feather", reason="pyarrow is not installed")
    pa = pytest.importorskip("pyarrow")
    folder = tmp_path / "log/sensors/lidar"
    folder.mkdir(parents=True)
    feather.write_feather(pa.table({"x": np.zeros(3, np.float16)}), folder / "315973157959879000.feather")
    with pytest.raises(ValueError, match="has no column y, z, intensity, laser_number, offset_ns; it has x"):
        frames_of(tmp_path / "log", tmp_path / "out")
    (folder / "315973157959879000.feather").write_bytes(b"ARROW1")
    with pytest.raises(ValueError, match=r"argoverse2: .*feather cannot be read"):
        frames_of(tmp_path / "log", tmp_path / "out")
