"""Polar frames as clouds that other programs open: a recording of all, or a file a frame (`jaxsim frames --to`).

In MCAP they are ROS 2's PointCloud2: x, y, z, intensity, ring and time a point; messages are encoded by rosbags, the
file is written by the format's own library (extra ros). In a trace of ASAM OSI they are a SensorData a frame, whose
LiDAR detections have beam and intensity (extra osi). Recordings of Rerun's viewer take the extra rerun.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxsim.cloud.formats import save_cloud, table_of
from jaxsim.data.logs.folder import log_of
from jaxsim.data.polar_checks import LATEST_S
from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.files import check_apart, file_of, need, replacing
from jaxsim.frame import Cloud
from jaxsim.geometry import polar_to_points
from jaxsim.progress import Progress, counted

_log = logging.getLogger(__name__)

_KIND = "sensor_msgs/msg/PointCloud2"
_TYPES = {"f4": 7, "u2": 4}
"""sensor_msgs/PointField's datatypes."""


class Stamped(NamedTuple):
    """A cloud of a moment."""

    time_s: float
    table: np.ndarray
    """Records, as `export.table_of` gives."""


def write_mcap(path: Path, clouds: Iterable[Stamped]) -> None:
    """Writes clouds to one MCAP, whole or not at all."""
    typesys = need("rosbags.typesys", "ros", by="mcap")
    writer_of = need("mcap.writer", "ros", by="mcap").Writer
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    definition, _ = store.generate_msgdef(_KIND, ros_version=2)
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = writer_of(file)
        writer.start(profile="ros2", library="jaxsim")
        # The message's definition stands in the file: readers need no ROS to know it.
        schema = writer.register_schema(name=_KIND, encoding="ros2msg", data=definition.encode())
        channel = writer.register_channel(topic="/points", message_encoding="cdr", schema_id=schema)
        for k, stamped in enumerate(clouds):
            nanoseconds = round(stamped.time_s * 1e9)
            data = store.serialize_cdr(_message(store.types, stamped.table, nanoseconds), _KIND)
            writer.add_message(channel, log_time=nanoseconds, data=bytes(data), publish_time=nanoseconds, sequence=k)
        writer.finish()


def _message(types: Any, table: np.ndarray, nanoseconds: int) -> Any:
    seconds, rest = divmod(nanoseconds, 10**9)
    names = table.dtype.names or ()
    offsets: Any = table.dtype.fields or {}
    fields = [
        types["sensor_msgs/msg/PointField"](
            # Codes by dtype without its byte order; the message itself says which that is.
            name=name,
            offset=int(offsets[name][1]),
            datatype=_TYPES[offsets[name][0].str[1:]],
            count=1,
        )
        for name in names
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=int(seconds), nanosec=int(rest))
    return types[_KIND](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar"),
        height=1,
        width=len(table),
        fields=fields,
        is_bigendian=False,
        point_step=table.dtype.itemsize,
        row_step=table.dtype.itemsize * len(table),
        data=np.frombuffer(table.tobytes(), np.uint8),
        # No point is invalid: the table holds the others alone.
        is_dense=True,
    )


def write_osi(path: Path, clouds: Iterable[Stamped]) -> None:
    """Writes clouds to one trace (.osi: each message after its length), whole or not at all.

    Positions are spherical, in the sensor's frame; intensity is in per cent, as the standard has it. Raises ValueError
    for a name that does not say SensorData, by which alone readers know the messages of an .osi.
    """
    if path.suffix != ".osi" or "sd" not in path.stem.lower().replace("-", "_").split("_"):
        raise ValueError(f"osi: {path.name} must say that it holds SensorData, as the standard has it: drive_sd.osi")
    message_of = need("osi3.osi_sensordata_pb2", "osi", by="osi").SensorData
    version = need("osi3.osi_version_pb2", "osi", by="osi")
    # The installed interface's own version, which its descriptor tells.
    current = version.DESCRIPTOR.GetOptions().Extensions[version.current_interface_version]
    with replacing(path) as temporary, temporary.open("wb") as file:
        for stamped in clouds:
            message = message_of()
            message.version.CopyFrom(current)
            message.sensor_id.value = 0
            moment = message.timestamp
            moment.seconds, moment.nanos = divmod(round(stamped.time_s * 1e9), 10**9)
            sensor = message.feature_data.lidar_sensor.add()
            sensor.header.measurement_time.CopyFrom(moment)
            sensor.header.number_of_valid_detections = len(stamped.table)
            _detections(sensor.detection, stamped.table)
            data = message.SerializeToString()
            file.write(struct.pack("<I", len(data)) + data)


def _detections(detections: Any, table: np.ndarray) -> None:
    x = table["x"].astype(np.float64)
    y = table["y"].astype(np.float64)
    z = table["z"].astype(np.float64)
    level = np.hypot(x, y)
    columns = [np.hypot(level, z), np.arctan2(y, x), np.arctan2(z, level), 100 * table["intensity"].astype(np.float64)]
    rings = table["ring"].tolist() if "ring" in (table.dtype.names or ()) else None
    for k, (distance, azimuth, elevation, intensity) in enumerate(np.stack(columns, axis=1).tolist()):
        one = detections.add()
        one.existence_probability = 1.0
        one.position.distance = distance
        one.position.azimuth = azimuth
        one.position.elevation = elevation
        one.intensity = intensity
        if rings is not None:
            one.beam_id.value = rings[k]


def write_rrd(path: Path, clouds: Iterable[Stamped]) -> None:
    """Writes clouds to one recording of Rerun, whole or not at all.

    Points are grey by the root of their intensity, on the timeline `scan`; intensity, ring and time a point are values
    beside them. Nothing is sent to a viewer: `rerun FILE.rrd` shows the file.
    """
    rerun = need("rerun", "rerun", by="rrd")
    with replacing(path) as temporary:
        recording = rerun.RecordingStream("jaxsim")
        try:
            recording.save(str(temporary))
            for stamped in clouds:
                table = stamped.table
                recording.set_time("scan", timestamp=stamped.time_s)
                # Most intensities are small: on a straight scale nearly all points would be black.
                grey = (255 * np.sqrt(np.clip(table["intensity"], 0, 1))).astype(np.uint8)
                xyz_m = np.stack([table[axis] for axis in "xyz"], axis=1)
                recording.log("lidar", rerun.Points3D(xyz_m, colors=np.repeat(grey[:, None], 3, axis=1)))
                rest = {name: np.asarray(table[name]) for name in table.dtype.names or () if name not in "xyz"}
                recording.log("lidar", rerun.AnyValues(**rest))
        finally:
            recording.disconnect()


WHOLE_FILE = {"mcap": write_mcap, "osi": write_osi, "rrd": write_rrd}
"""Forms that hold all frames in one file."""
SPAN_S = {"mcap": (0, 2**31 - 1), "osi": (0, LATEST_S)}
"""Seconds that a form's clock tells: a ROS message's has 32 bits, and the standard of OSI has none below 0."""


def export_frames(folder: Path, out: Path, to: str, *, every: int = 1, most: int = 0) -> int:
    """Writes a folder's polar frames as clouds, with ring and time a point; how many there are.

    `out` is one file NAME.`to` where `to` is one of WHOLE_FILE, else a folder of such files. Every `every`-th frame is
    taken, and at most `most` (0: all). Raises ValueError for a folder without frames, for an `out` that is no file
    of its form, for one in which clouds would take the frames' place and for the log that the frames were read from,
    ModuleNotFoundError where the form's own library is not installed.
    """
    frames = open_polar_frames(folder)
    if origin := log_of(folder):
        # A recording holds more than its polar frames do: two returns of a ray, other fields, points of one cell.
        beside = origin.parent if origin.is_file() and to not in WHOLE_FILE else None
        check_apart(out, origin, beside, by="frames")
    names = frames.names[::every][: most or None]
    if to in WHOLE_FILE and (out.suffix.lower() != f".{to}" or out.is_dir()):
        raise ValueError(
            f"frames: --to {to} writes one file, which is known by its ending, and --out is {out}; give "
            f"--out {out.stem}{'_sd' * (to == 'osi')}.{to}"
        )
    bar = Progress(names, unit="cloud", desc="writing")
    if to in WHOLE_FILE:
        times_s = _times(frames, names)
        _check_times(times_s, names, to)
        WHOLE_FILE[to](out, (Stamped(times_s[k], table_of(*_cloud(frames, name))) for k, name in enumerate(bar)))
        return len(names)
    if to == "npz" and (out / "grid.json").is_file():
        raise ValueError(f"frames: {out} holds polar frames, whose place clouds would take; give another --out")
    # Those that are there, too: nothing tells of what frames they are.
    for name in bar:
        cloud, time_s = _cloud(frames, name)
        save_cloud(file_of(out, name, f".{to}", by="frames"), cloud, time_s=time_s)
    return len(names)


def _cloud(frames: PolarFrames, name: str) -> tuple[Cloud, np.ndarray | None]:
    image, columns = frames.read(name)
    cloud = jax.tree.map(np.asarray, polar_to_points(image, frames.grid))
    return cloud, columns["time"].ravel().astype(np.float32) if "time" in columns else None


def _times(frames: PolarFrames, names: Sequence[str]) -> list[float]:
    """Times of these frames (s): grid.json's where it has all, else a tenth of a second apart, of which it warns."""
    said = [frames.about.get(name, {}).get("time") for name in names]
    times_s = [float(one) for one in said if one is not None]
    if len(times_s) == len(names):
        return times_s
    # Of some alone nothing is taken: years would lie between them and the others.
    left_out = f", so that those of {counted(len(times_s), 'frame')} are left out" if times_s else ""
    _log.warning(
        f"frames: {len(names) - len(times_s)} of {len(names)} frames have no time in grid.json{left_out}; the "
        "recording has all a tenth of a second apart, and who reads it takes that for true"
    )
    return [number / 10 for number in range(len(names))]


def _check_times(times_s: Sequence[float], names: Sequence[str], to: str) -> None:
    """Raises ValueError for the first time that the form `to` cannot hold."""
    low, high = SPAN_S.get(to, (-LATEST_S, LATEST_S))
    for name, time_s in zip(names, times_s, strict=True):
        if not low <= time_s <= high:
            raise ValueError(
                f"frames: the time of {name} in grid.json is {time_s:.12g} s; --to {to} holds {low:g} to {high:.12g} "
                "s: count from the first frame, or leave the times of all frames out"
            )
