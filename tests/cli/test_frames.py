"""`jaxsim frames`: what it lists, what it says, and what it asks for."""

import subprocess
import sys

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.files.whole import HOST, SALT
from tests.data.logs.conftest import room
from tests.data.logs.made_logs import pcd


def test_the_families_are_listed_with_their_extras(capsys):
    main(["frames", "--list"])
    printed = capsys.readouterr().out
    assert "pip install 'jaxsim-lidar[ros]'" in printed
    assert len(printed.splitlines()) >= 11


def test_a_folder_of_clouds_becomes_frames_and_the_command_says_how(tmp_path, capsys):
    (tmp_path / "drive").mkdir()
    for k in range(3):
        pcd(tmp_path / f"drive/{k:03d}.pcd", room(seed=k, turned=0.3 * k), "binary")
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert "pcd: 3 frames of 16 x 180 cells" in printed
    assert "intensity 0..255 became 0..1" in printed
    frames = open_polar_frames(tmp_path / "out")
    assert {about["scene"] for about in frames.about.values()} == {"drive"}
    assert all(np.asarray(frames.read(name)[0].valid).mean() > 0.99 for name in frames.names)
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "out"), "--every", "1"])
    assert "3 were there" in capsys.readouterr().out


def test_rings_that_count_from_one_are_told(tmp_path, capsys):
    fields = room()
    pcd(tmp_path / "one.pcd", fields | {"ring": fields["ring"] + np.uint16(1)}, "binary")
    main(["frames", str(tmp_path / "one.pcd"), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert "1 frame of 16 x 180 cells" in printed
    assert (
        "rings count from 1, as the first scans have it; if a ring 0 saw nothing in them, give --log.lines 17"
        in printed
    )


def test_a_log_and_a_folder_must_be_given(tmp_path):
    with pytest.raises(SystemExit, match="give the log and --out FOLDER"):
        main(["frames"])


def test_frames_become_an_mcap_that_becomes_the_same_frames(tmp_path):
    pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    (tmp_path / "drive").mkdir()
    for k in range(2):
        pcd(tmp_path / f"drive/{k:03d}.pcd", room(seed=k), "binary")
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "a")])
    main(["frames", str(tmp_path / "a"), "--to", "mcap", "--out", str(tmp_path / "a.mcap")])
    main(["frames", str(tmp_path / "a.mcap"), "--out", str(tmp_path / "b"), "--log.full-scale", "1"])
    first, second = open_polar_frames(tmp_path / "a"), open_polar_frames(tmp_path / "b")
    np.testing.assert_allclose(first.grid.elevation_rad, second.grid.elevation_rad, atol=1e-5)
    for one, other in zip(first.names, second.names, strict=True):
        (image, more), (again, later) = first.read(one), second.read(other)
        np.testing.assert_allclose(image.range_m, again.range_m, atol=1e-4)
        np.testing.assert_allclose(image.intensity, again.intensity, atol=1e-6)
        np.testing.assert_allclose(more["time"], later["time"], atol=1e-6)


def test_a_log_is_neither_written_into_nor_over(tmp_path):
    (tmp_path / "drive").mkdir()
    pcd(tmp_path / "drive/000.pcd", room(seed=0), "binary")
    before = (tmp_path / "drive/000.pcd").read_bytes()
    with pytest.raises(SystemExit, match="drive is read, and would be written into"):
        main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "drive")])
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "a")])
    with pytest.raises(SystemExit, match="drive is read, and would be written into"):
        main(["frames", str(tmp_path / "a"), "--to", "pcd", "--out", str(tmp_path / "drive")])
    assert {file.name: file.read_bytes() for file in (tmp_path / "drive").iterdir()} == {"000.pcd": before}


def test_a_recording_that_a_killed_command_left_half_written_goes(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / f".jaxsim-{HOST}-{ended.pid}-{SALT}.a.mcap").write_bytes(b"half")
    with pytest.raises(SystemExit, match=r"no grid\.json"):
        main(["frames", str(tmp_path), "--to", "mcap", "--out", str(tmp_path / "a.mcap")])
    assert not [*tmp_path.iterdir()]


def test_a_recording_of_all_frames_is_a_file_with_its_ending(tmp_path):
    pcd(tmp_path / "drive.pcd", room(seed=0), "binary")
    main(["frames", str(tmp_path / "drive.pcd"), "--out", str(tmp_path / "a")])
    (tmp_path / "there.mcap").mkdir()
    for name, given in (("out", "out.mcap"), ("there.mcap", "there.mcap"), ("x.las", "x.mcap")):
        with pytest.raises(SystemExit, match=rf"known by its ending, and --out is .*{name}; give --out {given}"):
            main(["frames", str(tmp_path / "a"), "--to", "mcap", "--out", str(tmp_path / name)])


def test_beams_and_columns_are_counted_from_one(capsys):
    for flag, least in (("--log.lines", "1 or more"), ("--log.columns", "2 or more and 65536 or less")):
        with pytest.raises(SystemExit):
            main(["frames", "x.pcd", "--out", "y", flag, "0"])
        assert f"is 0; it must be {least}" in " ".join(capsys.readouterr().err.split())


def test_frames_become_an_osi_trace_that_becomes_the_same_frames(tmp_path):
    trace_type = pytest.importorskip("osi3trace.osi_trace", reason="osi-python is not installed").OSITrace
    (tmp_path / "drive").mkdir()
    for k in range(2):
        pcd(tmp_path / f"drive/{k:03d}.pcd", room(seed=k), "binary")
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "a")])
    main(["frames", str(tmp_path / "a"), "--to", "osi", "--out", str(tmp_path / "a_sd.osi")])
    # The standard's own library reads it ...
    trace = trace_type(str(tmp_path / "a_sd.osi"), "SensorData")
    messages = list(trace)
    trace.close()
    first = open_polar_frames(tmp_path / "a")
    assert len(messages) == len(first.names) == 2
    assert messages[0].version.version_major >= 3
    for name, message in zip(first.names, messages, strict=True):
        detections = message.feature_data.lidar_sensor[0].detection
        assert len(detections) == first.read(name)[0].valid.sum()
        assert 0 <= min(d.intensity for d in detections) <= max(d.intensity for d in detections) <= 100
    # ... and so do we.
    main(["frames", str(tmp_path / "a_sd.osi"), "--out", str(tmp_path / "b")])
    second = open_polar_frames(tmp_path / "b")
    np.testing.assert_allclose(first.grid.elevation_rad, second.grid.elevation_rad, atol=1e-5)
    for one, other in zip(first.names, second.names, strict=True):
        image, again = first.read(one)[0], second.read(other)[0]
        np.testing.assert_allclose(image.range_m, again.range_m, atol=1e-4)
        np.testing.assert_allclose(image.intensity, again.intensity, atol=1e-6)


def test_a_trace_of_detections_must_say_so_in_its_name(tmp_path):
    (tmp_path / "drive").mkdir()
    pcd(tmp_path / "drive/000.pcd", room(seed=0), "binary")
    main(["frames", str(tmp_path / "drive"), "--out", str(tmp_path / "a")])
    with pytest.raises(SystemExit, match=r"a\.osi must say that it holds SensorData, .*drive_sd\.osi"):
        main(["frames", str(tmp_path / "a"), "--to", "osi", "--out", str(tmp_path / "a.osi")])
    assert not (tmp_path / "a.osi").exists()
