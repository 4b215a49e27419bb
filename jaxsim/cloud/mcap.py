"""Clouds to MCAP, as ROS 2's PointCloud2: x, y, z, intensity, ring and time a point.

Messages are encoded by rosbags, the file is written by the format's own library (extra ros).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxsim.files import need, replacing

_KIND = "sensor_msgs/msg/PointCloud2"
_TYPES = {"f4": 7, "u2": 4}
"""sensor_msgs/PointField's datatypes."""


class Stamped(NamedTuple):
    """A cloud of a moment."""

    time_s: float
    table: np.ndarray
    """Records, as `export.table_of` gives."""


def write_mcap(path: Path, clouds: Iterable[Stamped], *, topic: str = "/points", frame: str = "lidar") -> int:
    """Writes clouds to one MCAP, whole or not at all; how many they were."""
    typesys = need("rosbags.typesys", "ros", by="mcap")
    writer_of = need("mcap.writer", "ros", by="mcap").Writer
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    definition, _ = store.generate_msgdef(_KIND, ros_version=2)
    count = 0
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = writer_of(file)
        writer.start(profile="ros2", library="jaxsim")
        schema = writer.register_schema(name=_KIND, encoding="ros2msg", data=definition.encode())
        channel = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        for stamped in clouds:
            nanoseconds = round(stamped.time_s * 1e9)
            data = store.serialize_cdr(_message(store.types, stamped.table, nanoseconds, frame=frame), _KIND)
            writer.add_message(
                channel, log_time=nanoseconds, data=bytes(data), publish_time=nanoseconds, sequence=count
            )
            count += 1
        writer.finish()
    return count


def _message(types: Any, table: np.ndarray, nanoseconds: int, *, frame: str) -> Any:
    seconds, rest = divmod(nanoseconds, 10**9)
    names = table.dtype.names or ()
    offsets: Any = table.dtype.fields or {}
    fields = [
        types["sensor_msgs/msg/PointField"](
            name=name, offset=int(offsets[name][1]), datatype=_TYPES[offsets[name][0].str[1:]], count=1
        )
        for name in names
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=int(seconds), nanosec=int(rest))
    return types[_KIND](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame),
        height=1,
        width=len(table),
        fields=fields,
        is_bigendian=False,
        point_step=table.dtype.itemsize,
        row_step=table.dtype.itemsize * len(table),
        data=np.frombuffer(table.tobytes(), np.uint8),
        is_dense=True,
    )
