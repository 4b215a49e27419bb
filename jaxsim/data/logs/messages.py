"""Recordings of messages: ROS bags and MCAP with PointCloud2, ASAM OSI traces."""

from __future__ import annotations

import logging
import lzma
from collections.abc import Iterator, Sequence
from os import SEEK_CUR, fstat
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, reading, scan_of_fields
from jaxsim.files import need

POINT_CLOUD = ("sensor_msgs/msg/PointCloud2", "sensor_msgs/PointCloud2")
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField's datatypes."""
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_MESSAGE = 2**29
_ONE_BEAM_RAD = 1e-5
_LIGHT_M_S = 299_792_458.0
_log = logging.getLogger(__name__)


def points_of_message(message: Any, *, where: str) -> dict[str, np.ndarray]:
    """The fields of a PointCloud2 by name, in the machine's byte order.

    Raises ValueError where the message contradicts itself: a field beyond the point's end, fewer bytes than its size
    promises. Source: https://docs.ros.org/en/api/sensor_msgs/html/msg/PointCloud2.html
    """
    order = ">" if message.is_bigendian else "<"
    names: list[str] = []
    formats: list[np.dtype] = []
    offsets: list[int] = []
    for field in message.fields:
        if field.datatype not in _TYPES:
            raise ValueError(f"ros: {where}: field {field.name} has the datatype {field.datatype}; known are 1 to 8")
        # 0 is what some drivers write for 1; real arrays hold no single number a point.
        if field.count not in (0, 1):
            continue
        kind = np.dtype(order + _TYPES[field.datatype])
        if field.offset + kind.itemsize > message.point_step:
            raise ValueError(f"ros: {where}: field {field.name} ends beyond the {message.point_step} bytes of a point")
        names.append(field.name)
        formats.append(kind)
        offsets.append(field.offset)
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": message.point_step})
    # A list is what decoders make of bytes that came as single numbers.
    data = np.frombuffer(bytes(message.data) if isinstance(message.data, list) else message.data, np.uint8)
    if message.row_step < message.width * message.point_step or len(data) < message.height * message.row_step:
        raise ValueError(
            f"ros: {where} promises {message.height} rows of {message.width} points of {message.point_step} bytes and "
            f"holds {len(data)} bytes in rows of {message.row_step}; it was cut off, or its driver is broken"
        )
    # Rows may be padded too: each is cut to its own points.
    rows = data[: message.height * message.row_step].reshape(message.height, message.row_step)
    points = np.ascontiguousarray(rows[:, : message.width * message.point_step]).view(dtype)
    return {name: points[name].astype(points.dtype[name].newbyteorder("="), copy=False) for name in names}


def scan_of_message(message: Any, options: LogOptions, *, name: str, scene: str) -> LogScan:
    """A PointCloud2 as a scan. Raises ValueError where its frame is not the one asked for (`options.frame`)."""
    frame = message.header.frame_id
    if options.frame and frame != options.frame:
        raise ValueError(f"ros: {name} is in the frame {frame!r}, not in {options.frame!r}; give --log.frame {frame}")
    values = points_of_message(message, where=name)
    stamp = message.header.stamp
    return scan_of_fields(
        values,
        options,
        by="ros",
        where=name,
        name=name,
        scene=scene,
        time_s=stamp.sec + getattr(stamp, "nanosec", 0) * 1e-9,
        shape=(message.height, message.width) if message.height > 1 else None,
    )


def ros_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The clouds of one topic: of an .mcap, a ROS 2 bag (folder), or a ROS 1 .bag."""
    messages = _mcap_messages(path, options) if path.suffix.lower() == ".mcap" else _bag_messages(path, options)
    stem, number = path.stem, 0
    frame = ""
    with reading("ros", path, "it is cut off or damaged: `mcap recover`, `ros2 bag reindex`, or copy it again"):
        for message in messages:
            scan = scan_of_message(message, options, name=f"{stem}-{number:06d}", scene=stem)
            if frame and message.header.frame_id != frame:
                raise ValueError(
                    f"ros: {scan.name} is in the frame {message.header.frame_id!r}, those before in {frame!r}"
                )
            frame = message.header.frame_id
            yield Item.of(scan)
            number += 1
    if not number:
        raise ValueError(f"ros: {path} holds no PointCloud2 on the topic that was asked for")


def _one_topic(path: Path, topics: dict[str, str], options: LogOptions) -> str:
    """The topic to read, of those by their types. Raises ValueError where it is not clear which."""
    clouds = sorted(topic for topic, kind in topics.items() if kind in POINT_CLOUD)
    if options.topic:
        if options.topic not in clouds:
            raise ValueError(
                f"ros: no PointCloud2 on {options.topic} in {path}; there is {', '.join(clouds) or 'none'}"
            )
        return options.topic
    if len(clouds) != 1:
        others = ", ".join(sorted(topics)) or "nothing"
        raise ValueError(
            f"ros: {path} has several clouds; name one: --log.topic {' or '.join(clouds)}"
            if clouds
            else f"ros: {path} has no topic of sensor_msgs/PointCloud2; it has {others}"
        )
    return clouds[0]


def _mcap_messages(path: Path, options: LogOptions) -> Iterator[Any]:
    make_reader = need("mcap.reader", "ros", by="ros").make_reader
    decoder = need("mcap_ros2.decoder", "ros", by="ros").DecoderFactory
    with path.open("rb") as file:
        topic = _one_topic(path, mcap_topics(path), options)
        for _, _, _, message in make_reader(file, decoder_factories=[decoder()]).iter_decoded_messages(topics=[topic]):
            yield message


def mcap_topics(path: Path) -> dict[str, str]:
    """Topics of an MCAP and the names of their schemas. Raises ValueError where its index cannot be read."""
    make_reader = need("mcap.reader", "ros", by="ros").make_reader
    hint = "it is cut off or damaged: `mcap recover` mends what can be mended"
    with reading("ros", path, hint), path.open("rb") as file:
        file.seek(len(_MCAP_MAGIC))
        _check_records(file, kind=1, length=8)
        file.seek(0)
        summary = make_reader(file).get_summary()
        if summary is None:
            raise ValueError("it has no summary")
        return {
            channel.topic: summary.schemas[channel.schema_id].name if channel.schema_id in summary.schemas else ""
            for channel in summary.channels.values()
        }


def _check_records(file: BinaryIO, *, kind: int, length: int) -> None:
    """Raises ValueError where a record is longer than what is there, for which room would be made: so many bytes say
    its kind, and then so many the length of what follows."""
    size = fstat(file.fileno()).st_size
    while len(head := file.read(kind + length)) == kind + length:
        promised = int.from_bytes(head[kind:], "little")
        if file.tell() + promised > size:
            raise ValueError(f"a record promises {promised} bytes where {size - file.tell()} are left")
        file.seek(promised, SEEK_CUR)


def _bag_messages(path: Path, options: LogOptions) -> Iterator[Any]:
    any_reader = need("rosbags.highlevel", "ros", by="ros").AnyReader
    if path.suffix.lower() == ".bag":
        with path.open("rb") as file:
            file.readline()  # the version
            _check_records(file, kind=0, length=4)  # heads of records, and their data
    with any_reader([path]) as bag:
        topic = _one_topic(path, {c.topic: c.msgtype for c in bag.connections}, options)
        for connection, _, raw in bag.messages(connections=[c for c in bag.connections if c.topic == topic]):
            yield bag.deserialize(raw, connection.msgtype)


def osi_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The LiDAR's frames of an OSI trace (.osi, .mcap): reflections of a SensorView, or detections of a SensorData.
    Warns where a message holds several LiDARs, of which the first is read."""
    trace_type = need("osi3trace.osi_trace", "osi", by="osi").OSITrace
    stem, number = path.stem, 0
    several = False
    with reading("osi", path, "it is cut off, or not a trace of SensorView or SensorData messages"):
        kind, topic = _osi_kind(path, options)
        if path.suffix.lower() != ".mcap":
            _check_lengths(path)
        trace = trace_type(str(path), kind, topic=topic)
        try:
            for message in trace:
                name = f"{stem}-{number:06d}"
                lidars = _osi_lidars(message, kind, name=name)
                if len(lidars) > 1 and not several:
                    several = True
                    _log.warning(
                        f"osi: {name} holds {len(lidars)} LiDARs, and the first alone is read, here and in what "
                        "follows; write a trace of each of the others, and read that into a folder of its own"
                    )
                yield Item.of(_osi_scan(message, lidars[0], options, name=name, scene=stem))
                number += 1
        finally:
            trace.close()
    if not number:
        raise ValueError(f"osi: {path} holds no message")


def _check_lengths(path: Path) -> None:
    """Raises ValueError where a message of a trace is shorter than its length says, for which room would be made."""
    with (lzma.open if path.suffix.lower() in (".xz", ".lzma") else Path.open)(path, "rb") as file:
        while head := file.read(4):
            left = promised = int.from_bytes(head, "little")
            while left and promised <= _LARGEST_MESSAGE and (got := len(file.read(min(left, 2**20)))):
                left -= got
            if left:
                raise ValueError(f"a message promises {promised} bytes, which are not there")


def _osi_kind(path: Path, options: LogOptions) -> tuple[str, str | None]:
    """Type of a trace's messages, and its topic: by the schema of an .mcap, by the name of an .osi (`..._sv_...`)."""
    if path.suffix.lower() != ".mcap":
        # An .osi says nothing of its messages but in its name, as the standard recommends.
        words = path.stem.lower().replace("-", "_").split("_")
        return ("SensorData" if "sd" in words or "sensordata" in words else "SensorView"), None
    topics = {
        t: k.removeprefix("osi3.") for t, k in mcap_topics(path).items() if k in ("osi3.SensorView", "osi3.SensorData")
    }
    if options.topic and options.topic not in topics:
        raise ValueError(f"osi: no SensorView or SensorData on {options.topic}; there is {', '.join(topics) or 'none'}")
    if not options.topic and len(topics) != 1:
        raise ValueError(f"osi: {path} has {len(topics)} topics of LiDARs ({', '.join(topics)}); name one: --log.topic")
    topic = options.topic or next(iter(topics))
    return topics[topic], topic


def _osi_lidars(message: Any, kind: str, *, name: str) -> Sequence[Any]:
    """The LiDARs of a message. Raises ValueError where it has none."""
    if kind == "SensorView":
        lidars, field = message.lidar_sensor_view, "lidar_sensor_view"
    else:
        lidars, field = message.feature_data.lidar_sensor, "feature_data.lidar_sensor"
    if not len(lidars):
        raise ValueError(f"osi: {name} is a {kind} without {field}")
    return lidars


def _osi_scan(message: Any, lidar: Any, options: LogOptions, *, name: str, scene: str) -> LogScan:
    """What one LiDAR of a message measured: a view has its reflections, data have detections."""
    about = {"name": name, "scene": scene, "time_s": message.timestamp.seconds + message.timestamp.nanos * 1e-9}
    if hasattr(lidar, "reflection"):
        return _osi_reflections(lidar, **about)
    return _osi_detections(lidar.detection, options, **about)


def _osi_reflections(view: Any, *, name: str, scene: str, time_s: float) -> LogScan:
    """Reflections in the order of the configuration's directions; time of flight is there and back.

    signal_strength is in dB of what was sent; --log.full-scale is in the same ratio once the logarithm is undone.
    Source: osi_sensorview.proto, LidarSensorView.Reflection.
    """
    reflections, directions = view.reflection, view.view_configuration.directions
    if len(reflections) != len(directions):
        raise ValueError(
            f"osi: {name} has {len(reflections)} reflections for {len(directions)} directions of its configuration; "
            "there must be one for each ray, with a time of flight of 0 where it hits nothing"
        )
    ray = np.array([(d.x, d.y, d.z) for d in directions], np.float64).reshape(-1, 3)
    ray /= np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-12)
    flight = np.array([r.time_of_flight for r in reflections], np.float64)
    range_m = flight * (_LIGHT_M_S / 2)
    hit = range_m > 0
    normal = np.array([(r.normal_to_surface.x, r.normal_to_surface.y, r.normal_to_surface.z) for r in reflections])
    normal = normal.reshape(-1, 3)
    length = np.linalg.norm(normal, axis=1)
    layers = {"instance": np.array([r.object_id.value for r in reflections], np.int64).astype(np.int32)}
    # A normal of length 0 is one that the simulator did not give.
    if (length[hit] > 0).all() and hit.any():
        cosine = np.abs((ray * normal).sum(axis=1)) / np.maximum(length, 1e-12)
        layers["incidence"] = np.arccos(np.clip(cosine, 0, 1)).astype(np.float32)
    return LogScan(
        name=name,
        scene=scene,
        xyz_m=(ray * range_m[:, None]).astype(np.float32),
        intensity=np.array([10 ** (r.signal_strength / 10) for r in reflections], np.float32),
        ring=_ring_of_rays(ray),
        time_s=time_s,
        layers=layers,
    )


def _ring_of_rays(ray: np.ndarray) -> np.ndarray:
    """Rays of one elevation are one beam: a simulator's directions are exact, but for the rounding of floats."""
    elevation = np.arcsin(np.clip(ray[:, 2], -1, 1))
    order = np.argsort(elevation)
    ring = np.empty(len(ray), np.int64)
    ring[order] = np.cumsum(np.diff(elevation[order], prepend=elevation[order][:1]) > _ONE_BEAM_RAD)
    return ring


def _osi_detections(detections: Any, options: LogOptions, *, name: str, scene: str, time_s: float) -> LogScan:
    """Detections in spherical coordinates; intensity in percent, or reflectivity. Source: osi_featuredata.proto."""
    distance = np.array([d.position.distance for d in detections], np.float64)
    azimuth = np.array([d.position.azimuth for d in detections], np.float64)
    elevation = np.array([d.position.elevation for d in detections], np.float64)
    level = distance * np.cos(elevation)
    field = "reflectivity" if options.intensity == "reflectivity" else "intensity"
    beams = np.array([d.beam_id.value if d.HasField("beam_id") else -1 for d in detections], np.int64)
    return LogScan(
        name=name,
        scene=scene,
        xyz_m=np.stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], 1).astype(
            np.float32
        ),
        intensity=np.array([getattr(d, field) for d in detections], np.float32),
        ring=beams if len(beams) and beams.min() >= 0 else None,
        time_s=time_s,
        full_scale=100.0 if field == "intensity" else None,
        layers={"instance": np.array([d.object_id.value for d in detections], np.int64).astype(np.int32)},
    )


def _is_osi(path: Path) -> bool:
    if path.suffix.lower() in (".osi", ".xz", ".lzma"):
        return True
    if path.suffix.lower() != ".mcap" or not path.is_file():
        return False
    with path.open("rb") as file:
        is_mcap = file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC
    return is_mcap and any(kind.startswith("osi3.") for kind in mcap_topics(path).values())


SOURCES: dict[str, Source] = {
    "osi": Source("ASAM OSI traces: .osi, .mcap", _is_osi, osi_items, "osi"),
    "ros": Source(
        "ROS 2 bags, MCAP and ROS 1 bags with PointCloud2",
        lambda path: path.suffix.lower() in (".mcap", ".bag", ".db3") or (path / "metadata.yaml").is_file(),
        ros_items,
        "ros",
    ),
}
