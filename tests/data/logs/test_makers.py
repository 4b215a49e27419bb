"""Recordings of makers and data sets: real ones, and small ones in their formats."""

import contextlib
import os
import shutil

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.made_logs import frames_of


def test_velodynes_packets(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    kind, frames = frames_of(samples / "velodyne_vlp16/my.pcap", tmp_path)
    assert kind == "velodyne"
    image, more = frames.read(frames.names[0])
    np.testing.assert_allclose(np.rad2deg(frames.grid.elevation_rad), np.arange(15, -16, -2), atol=0.01)
    # The sensor's window is 78 degrees wide; beyond it the decoder interpolates, and nothing was measured.
    assert np.rad2deg(frames.grid.azimuth_rad[[0, -1]]) == pytest.approx((38.7, -39.9), abs=0.2)
    assert image.valid.mean() > 0.99
    assert 0 < more["time"].max() < 0.21
    # The window slides on from turn to turn: of the second only a quarter is in the recording.
    assert len(frames.names) == 1


def turns_of(recording: bytes, *, count: int) -> list[bytes]:
    """The data packets of a VLP-16's first turn, so many times, each a turn later than the one before."""
    packets, at = [], 24
    while at < len(recording):
        size = int.from_bytes(recording[at + 8 : at + 12], "little")
        if size == 1248:
            packets.append(recording[at : at + 16 + size])
        at += 16 + size
    sent = []
    for k in range(count):
        for packet in packets[:35]:
            stamp = int.from_bytes(packet[-6:-2], "little") + 200_000 * k
            sent.append(packet[:-6] + stamp.to_bytes(4, "little") + packet[-2:])
    return sent


def test_a_turn_that_a_recording_cuts_is_passed_over(samples, tmp_path):
    """Where no packet went out no ray was lost: a third of a turn that is missing must not look like lost rays."""
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    recording = (samples / "velodyne_vlp16/my.pcap").read_bytes()
    path = tmp_path / "cut.pcap"
    path.write_bytes(recording[:24] + b"".join(turns_of(recording, count=4)[:-12]))
    kind, source = source_for(path, "")
    written = write_log(path, kind, source, out=tmp_path / "out", options=LogOptions())
    assert (written.frames, written.partial) == (3, 1)


@pytest.mark.parametrize(("share", "frames"), [(0.95, 1), (0.7, 0)])
def test_the_last_turn_of_a_file_that_ends_within_a_packet_is_passed_over(samples, tmp_path, share, frames):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    recording = (samples / "velodyne_vlp16/my.pcap").read_bytes()
    path = tmp_path / "cut.pcap"
    path.write_bytes(recording[: int(len(recording) * share)])
    kind, source = source_for(path, "")
    cannot = contextlib.nullcontext() if frames else pytest.raises(ValueError, match="no whole turn")
    with cannot:
        written = write_log(path, kind, source, out=tmp_path / "out", options=LogOptions())
        assert (written.frames, written.partial) == (frames, 1)


def test_a_pcap_of_something_else(tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    (tmp_path / "x.pcap").write_bytes(bytes(100))
    with pytest.raises(ValueError, match=r"velodyne: .*x.pcap"):
        frames_of(tmp_path / "x.pcap", tmp_path / "out")


def test_a_packet_that_promises_gigabytes_is_no_packet(samples, tmp_path):
    pytest.importorskip("velodyne_decoder", reason="velodyne-decoder is not installed")
    whole = bytearray((samples / "velodyne_vlp16/my.pcap").read_bytes())
    whole[24 + 8 : 24 + 12] = b"\xff\xff\xff\xef"  # the first packet's length
    (tmp_path / "x.pcap").write_bytes(whole)
    with pytest.raises(ValueError, match=r"velodyne: .*x.pcap cannot be read .* promises \d+ bytes; it is damaged"):
        frames_of(tmp_path / "x.pcap", tmp_path / "out")


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
        ("timestamps.txt", "2011-09-26 13:02:25\nyesterday\n", r"timestamps.txt holds what is no time"),
        ("times.txt", "0.0 1_0\n", r"times.txt: '1_0' is no number"),
    ):
        path = folder.parent / name
        path.write_text(content)
        with pytest.raises(ValueError, match=message):
            write_log(tmp_path, kind, source, out=tmp_path / "out", options=LogOptions())
        path.unlink()


def test_ousters_recording(samples, tmp_path):
    pytest.importorskip("ouster.sdk", reason="ouster-sdk is not installed")
    kind, frames = frames_of(samples / "ouster/OS-1-32-G_v2.1.1_1024x10.pcap", tmp_path)
    image, more = frames.read(frames.names[0])
    assert kind == "ouster"
    assert image.range_m.shape == (32, 1024)
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


def test_nuscenes_sweeps(samples, tmp_path):
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
