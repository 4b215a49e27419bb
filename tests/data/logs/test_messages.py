"""Bags, MCAP and OSI traces, written here by the formats' own libraries."""

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.logs.messages import points_of_message
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.conftest import FIRINGS, RINGS, expected, room
from tests.data.logs.made_logs import (
    check,
    detections,
    frames_of,
    mcap,
    message,
    osi_mcap,
    osi_trace,
    ros1_bag,
    ros2_bag,
    sensor_view,
)


@pytest.mark.parametrize("big", [False, True])
def test_an_mcap_of_either_byte_order(tmp_path, fields, big):
    other = room(seed=5)
    path = mcap(tmp_path / "drive.mcap", [message(fields, big=big), message(other, big=big, sec=13)])
    kind, frames = frames_of(path, tmp_path / "out")
    assert kind == "ros"
    assert frames.names == ("drive-000000", "drive-000001")
    assert frames.about["drive-000001"] == {"scene": "drive", "time": 13.5}
    check(frames, fields)


def test_organised_clouds_without_rings(tmp_path, fields):
    del fields["ring"]
    tables = {key: value.reshape(FIRINGS, RINGS).T.ravel() for key, value in fields.items()}
    _, frames = frames_of(mcap(tmp_path / "drive.mcap", [message(tables, height=RINGS)]), tmp_path / "out")
    image, _ = frames.read("drive-000000")
    np.testing.assert_allclose(image.range_m, expected(fields)[0], rtol=1e-5)


def test_the_topic_must_be_clear(tmp_path, fields):
    path = mcap(tmp_path / "drive.mcap", [message(fields)], topics=("/front", "/top"))
    with pytest.raises(ValueError, match=r"several clouds; name one: --log.topic /front or /top"):
        frames_of(path, tmp_path / "out")
    with pytest.raises(ValueError, match="no PointCloud2 on /rear"):
        frames_of(path, tmp_path / "out", topic="/rear")
    _, frames = frames_of(path, tmp_path / "out", topic="/top")
    check(frames, fields)


def test_the_frame_must_be_the_one_asked_for_and_stay(tmp_path, fields):
    path = mcap(tmp_path / "drive.mcap", [message(fields), message(fields, frame="base_link")])
    with pytest.raises(ValueError, match="is in the frame 'lidar_top', not in 'map'"):
        frames_of(path, tmp_path / "out", frame="map")
    with pytest.raises(ValueError, match="is in the frame 'base_link', those before in 'lidar_top'"):
        frames_of(path, tmp_path / "out")


@pytest.mark.parametrize("damage", ["cut", "empty", "other"])
def test_a_damaged_mcap_is_named(tmp_path, fields, damage):
    path = mcap(tmp_path / "drive.mcap", [message(fields)])
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[: len(whole) // 2], "empty": b"", "other": whole[:8] + bytes(64)}[damage])
    with pytest.raises(ValueError, match=r"ros: .*drive.mcap cannot be read .*mcap recover"):
        frames_of(path, tmp_path / "out")


def test_a_bag_whose_record_promises_gigabytes_is_named(tmp_path, fields):
    path = ros1_bag(tmp_path / "drive.bag", fields)
    content = bytearray(path.read_bytes())
    content[13:17] = b"\xff\xff\xff\xef"  # behind the version, the length of the first record's head
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"ros: .*drive.bag cannot be read .*a record promises 4026531839 bytes"):
        frames_of(path, tmp_path / "out")


@pytest.mark.parametrize(("write", "name"), [(ros2_bag, "bag"), (ros1_bag, "drive.bag")])
def test_a_bag_of_either_ros(tmp_path, fields, write, name):
    kind, frames = frames_of(write(tmp_path / name, fields), tmp_path / "out")
    assert kind == "ros"
    check(frames, fields)


def test_messages_that_contradict_themselves(fields):
    m = message(fields)
    m.data = m.data[:-100]
    with pytest.raises(ValueError, match="it was cut off, or its driver is broken"):
        points_of_message(m, where="here")
    m = message(fields)
    m.point_step = 4
    with pytest.raises(ValueError, match="field y ends beyond the 4 bytes of a point"):
        points_of_message(m, where="here")
    m = message(fields)
    m.fields[0].datatype = 9
    with pytest.raises(ValueError, match="has the datatype 9"):
        points_of_message(m, where="here")


def test_reflections_of_an_osi_trace(tmp_path, fields):
    kind, frames = frames_of(osi_trace(tmp_path / "drive_sv_3.osi", sensor_view(fields)), tmp_path / "out")
    assert kind == "osi"
    check(frames, fields)
    _, more = frames.read(frames.names[0])
    assert frames.about[frames.names[0]]["time"] == 3.25
    np.testing.assert_allclose(more["incidence"], 0, atol=2e-3)
    assert (more["instance"] == 5).all()


def test_a_multi_channel_osi_trace(tmp_path, fields):
    kind, frames = frames_of(osi_mcap(tmp_path / "drive.mcap", fields), tmp_path / "out")
    assert kind == "osi"
    check(frames, fields)


def test_detections_of_an_osi_trace(tmp_path, fields):
    _, frames = frames_of(osi_trace(tmp_path / "drive_sd_3.osi", detections(fields)), tmp_path / "out")
    check(frames, fields)


def test_of_several_lidars_in_a_message_the_first_is_read_and_the_others_are_told(tmp_path, fields, caplog):
    trace = osi_trace(tmp_path / "one_sv.osi", sensor_view(fields))
    frames_of(trace, tmp_path / "one")
    assert not caplog.records
    both = sensor_view(fields)
    both.lidar_sensor_view.add()
    raw = osi_trace(trace, both).read_bytes()
    trace.write_bytes(2 * raw)
    _, frames = frames_of(trace, tmp_path / "both")
    check(frames, fields)
    assert len(frames.names) == 2
    assert {record.getMessage().partition(";")[0] for record in caplog.records} == {
        "osi: one_sv-000000 holds 2 LiDARs, and the first alone is read, here and in what follows"
    }


def test_damaged_osi_traces_are_named(tmp_path, fields):
    path = tmp_path / "drive_sv_3.osi"
    raw = sensor_view(fields, short=7).SerializeToString()
    path.write_bytes(len(raw).to_bytes(4, "little") + raw)
    with pytest.raises(ValueError, match=rf"{RINGS * FIRINGS - 7} reflections for {RINGS * FIRINGS} directions"):
        frames_of(path, tmp_path / "out")
    for content, told in ((raw[: len(raw) // 2], "promises"), (b"", "holds no message"), (bytes(64), "promises")):
        path.write_bytes(len(raw).to_bytes(4, "little") + content if content else b"")
        with pytest.raises(ValueError, match=rf"osi: .*{told}"):
            frames_of(path, tmp_path / "out")


def test_a_killed_command_goes_on_with_the_same_sensor(tmp_path, fields):
    """The second half of a log lies on the grid that its first half told."""
    path = mcap(tmp_path / "drive.mcap", [message(room(seed=k, turned=0.1 * k)) for k in range(6)])
    kind, source = source_for(path)
    options = LogOptions()
    write_log(path, kind, source, out=tmp_path / "cut", options=options, most=2)
    with pytest.raises(ValueError, match="was made with other settings"):
        write_log(path, kind, source, out=tmp_path / "cut", options=LogOptions(returns="last"))
    record = tmp_path / "cut/log.json"
    good = record.read_text()
    for change in ('"axis": 7, "was"', '"axis": "x", "was"', '"axes"'):
        record.write_text(good.replace('"axis"', change))
        with pytest.raises(ValueError, match=r"(?s)frames: .*log.json: .* delete the folder"):
            write_log(path, kind, source, out=tmp_path / "cut", options=options)
    record.write_text(good)
    second = write_log(path, kind, source, out=tmp_path / "cut", options=options)
    assert (second.already, second.frames) == (2, 4)
    write_log(path, kind, source, out=tmp_path / "whole", options=options)
    cut, whole = open_polar_frames(tmp_path / "cut"), open_polar_frames(tmp_path / "whole")
    np.testing.assert_array_equal(cut.grid.azimuth_rad, whole.grid.azimuth_rad)
    for name in whole.names:
        np.testing.assert_allclose(cut.read(name)[0].range_m, whole.read(name)[0].range_m, rtol=1e-6)
