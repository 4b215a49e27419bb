"""Recordings of a small room in every format, written by the libraries of the formats, and how they are read back."""

import inspect
import json
from types import SimpleNamespace

import numpy as np
import pytest

from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.geometry import preset
from tests.data.logs.conftest import FIRINGS, RINGS, expected


def frames_of(path, out, **options):
    kind, source = source_for(path)
    write_log(path, kind, source, out=out, options=LogOptions(**options))
    return kind, open_polar_frames(out)


def check(frames, fields, rtol=1e-5):
    image, _ = frames.read(frames.names[0])
    range_m, intensity = expected(fields)
    assert image.valid.all()
    np.testing.assert_allclose(image.range_m, range_m, rtol=rtol)
    np.testing.assert_allclose(image.intensity, intensity, atol=1e-6)


def pcd(path, fields, encoding, **more):
    pypcd4 = pytest.importorskip("pypcd4", reason="pypcd4 is not installed")
    values = [fields[name] for name in fields]
    cloud = pypcd4.PointCloud.from_points(values, tuple(fields), tuple(v.dtype.type for v in values))
    cloud.save(path, encoding=pypcd4.Encoding(encoding))
    return path


def las(path, fields, *, ring=True):
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales = np.full(3, 1e-4)
    if ring:
        header.add_extra_dim(laspy.ExtraBytesParams(name="ring", type=np.uint16))
    data = laspy.LasData(header)
    data.x, data.y, data.z = fields["x"], fields["y"], fields["z"]
    data.intensity = fields["intensity"]
    data.gps_time = fields["t"] * 1e-9
    if ring:
        data.ring = fields["ring"]
    data.write(str(path))
    return path


ATTRIBUTES = {
    "channels": str(RINGS),
    "upper_fov": "12",
    "lower_fov": "-18",
    "range": "100",
    "points_per_second": str(RINGS * FIRINGS * 10),
    "rotation_frequency": "10",
}


def carla_buffer(folder, fields, *, semantic):
    """Points by channel, the upper first, y to the right; 24 or 16 bytes each, as the server sends them."""
    order = np.lexsort((np.arange(len(fields["x"])), -fields["ring"].astype(int)))
    names = ("x", "y", "z", "cos", "idx", "tag") if semantic else ("x", "y", "z", "intensity")
    points = np.zeros(len(order), [(n, "<u4" if n in ("idx", "tag") else "<f4") for n in names])
    for axis, sign in (("x", 1), ("y", -1), ("z", 1)):
        points[axis] = sign * fields[axis][order]
    if semantic:
        points["cos"], points["idx"], points["tag"] = 0.5, 77, 14
    else:
        points["intensity"] = fields["intensity"][order] / 255
    (folder / "000010.raw").write_bytes(points.tobytes())
    name = "sensor.lidar.ray_cast_semantic" if semantic else "sensor.lidar.ray_cast"
    (folder / "attributes.json").write_text(json.dumps(ATTRIBUTES | {"type": name}))
    return folder


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


SPEC = preset("hdl32e")


def write_image(path, lift_deg=0.0, label=1.0):
    """A range image of the corridor's sensor: 16 of its lines, lifted as motion compensation lifts near points."""
    azimuth = np.deg2rad(179.5 - np.arange(360))
    lift = np.random.default_rng(0).uniform(-lift_deg, lift_deg, (16, 360))
    elevation = SPEC.elevation_rad[8:24, None] + np.deg2rad(lift)
    flat = 10 * np.cos(elevation)
    cells = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), 10 * np.sin(elevation)], -1)
    scan = np.concatenate([cells, np.broadcast_to([51.0, 10.0, label], (16, 360, 3))], -1).astype(np.float32)
    scan[3, 7, 4] = 0
    path.parent.mkdir(exist_ok=True)
    np.savez(path, scan=scan)
