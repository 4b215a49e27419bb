"""Bags, MCAP and OSI traces, written here by the formats' own libraries."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.logs.messages import points_of_message
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.conftest import FIRINGS, RINGS, expected, room
from tests.data.logs.test_files import check, frames_of

CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def message(fields, *, frame="lidar_top", big=False, height=1, sec=12, spare=3):
    """A PointCloud2 as drivers pad it: some bytes between fields, at the end of points and at the end of rows."""
    order = ">" if big else "<"
    described, at = [], 0
    for name, value in fields.items():
        described.append(SimpleNamespace(name=name, offset=at, datatype=CODES[value.dtype.str[1:]], count=1))
        at += value.dtype.itemsize + 1
    step = at + spare
    layout = {
        "names": list(fields),
        "formats": [order + v.dtype.str[1:] for v in fields.values()],
        "offsets": [f.offset for f in described],
        "itemsize": step,
    }
    points = np.zeros(len(fields["x"]), np.dtype(layout))
    for name, value in fields.items():
        points[name] = value
    width = len(points) // height
    rows = points.view(np.uint8).reshape(height, width * step)
    rows = np.pad(rows, [(0, 0), (0, 5)])
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=sec, nanosec=500_000_000)),
        height=height,
        width=width,
        fields=described,
        is_bigendian=big,
        point_step=step,
        row_step=width * step + 5,
        data=rows.tobytes(),
        is_dense=True,
    )


def as_dict(m):
    plain = dict(vars(m))
    plain["header"] = {
        "stamp": {"sec": m.header.stamp.sec, "nanosec": m.header.stamp.nanosec},
        "frame_id": m.header.frame_id,
    }
    plain["fields"] = [vars(f) for f in m.fields]
    return plain


def mcap(path, messages, topics=("/points",)):
    writer_module = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    kind = "sensor_msgs/msg/PointCloud2"
    text, _ = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)
    with path.open("wb") as file, writer_module.Writer(file) as writer:
        schema = writer.register_msgdef(kind, text)
        for topic in topics:
            for k, m in enumerate(messages):
                writer.write_message(topic, schema, as_dict(m), log_time=k, publish_time=k)
    return path


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


def native_message(types, fields):
    """The same for rosbags: a message of its own types."""
    m = message(fields)
    return types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](**_header(types, m.header.frame_id)),
        height=m.height,
        width=m.width,
        fields=[types["sensor_msgs/msg/PointField"](**vars(f)) for f in m.fields],
        is_bigendian=False,
        point_step=m.point_step,
        row_step=m.row_step,
        data=np.frombuffer(m.data, np.uint8),
        is_dense=True,
    )


def _header(types, frame):
    about = {"stamp": types["builtin_interfaces/msg/Time"](sec=12, nanosec=0), "frame_id": frame}
    # ROS 1 also counts messages.
    return about | ({"seq": 0} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {})


def ros2_bag(path, fields, topic="/points"):
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/PointCloud2"
    newer = {"version": 8} if "version" in inspect.signature(rosbag2.Writer).parameters else {}
    with rosbag2.Writer(path, **newer) as writer:
        connection = writer.add_connection(topic, kind, typestore=store)
        writer.write(connection, 0, store.serialize_cdr(native_message(store.types, fields), kind))
    return path


def ros1_bag(path, fields):
    rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="rosbags is not installed")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    kind = "sensor_msgs/msg/PointCloud2"
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/points", kind, typestore=store)
        writer.write(connection, 0, store.serialize_ros1(native_message(store.types, fields), kind))
    return path


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


def sensor_view(fields, *, short=0):
    view_module = pytest.importorskip("osi3.osi_sensorview_pb2", reason="osi-python is not installed")
    view = view_module.SensorView()
    view.timestamp.seconds, view.timestamp.nanos = 3, 250_000_000
    lidar = view.lidar_sensor_view.add()
    range_m = np.sqrt(sum(fields[a].astype(float) ** 2 for a in "xyz"))
    rays = np.stack([fields[a] / range_m for a in "xyz"], axis=1)
    for k, (ray, r) in enumerate(zip(rays, range_m, strict=True)):
        lidar.view_configuration.directions.add(x=ray[0], y=ray[1], z=ray[2])
        if k < len(rays) - short:
            reflection = lidar.reflection.add(
                time_of_flight=2 * r / 299_792_458.0, signal_strength=10 * np.log10(fields["intensity"][k] / 255)
            )
            reflection.normal_to_surface.x, reflection.normal_to_surface.y, reflection.normal_to_surface.z = -ray
            reflection.object_id.value = 5
    return view


def osi_trace(path, message):
    """A trace of one message."""
    raw = message.SerializeToString()
    path.write_bytes(len(raw).to_bytes(4, "little") + raw)
    return path


def osi_mcap(path, fields):
    utilities = pytest.importorskip("mcap_protobuf.writer", reason="mcap-protobuf-support is not installed")
    with path.open("wb") as file, utilities.Writer(file) as writer:
        writer.write_message("SensorViewTopic", sensor_view(fields), log_time=0, publish_time=0)
    return path


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


def detections(fields):
    data_module = pytest.importorskip("osi3.osi_sensordata_pb2", reason="osi-python is not installed")
    data = data_module.SensorData()
    data.timestamp.seconds = 1
    lidar = data.feature_data.lidar_sensor.add()
    x, y, z = (fields[a].astype(float) for a in "xyz")
    for k in range(len(x)):
        detection = lidar.detection.add(intensity=float(fields["intensity"][k]) / 2.55)
        detection.position.distance = float(np.sqrt(x[k] ** 2 + y[k] ** 2 + z[k] ** 2))
        detection.position.azimuth = float(np.arctan2(y[k], x[k]))
        detection.position.elevation = float(np.arctan2(z[k], np.hypot(x[k], y[k])))
        detection.beam_id.value = int(fields["ring"][k])
    return data


def test_detections_of_an_osi_trace(tmp_path, fields):
    _, frames = frames_of(osi_trace(tmp_path / "drive_sd_3.osi", detections(fields)), tmp_path / "out")
    check(frames, fields)


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
