"""Clouds to a trace of ASAM OSI: a SensorData a frame, whose LiDAR detections have beam and intensity (extra osi)."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.cloud.mcap import Stamped
from jaxsim.files import need, replacing


def write_osi(path: Path, clouds: Iterable[Stamped]) -> int:
    """Writes clouds to one trace (.osi: each message after its length), whole or not at all; how many they were.

    Positions are spherical, in the sensor's frame; intensity is in per cent, as the standard has it. Raises ValueError
    for a name that does not say SensorData, by which alone readers know the messages of an .osi.
    """
    if path.suffix != ".osi" or "sd" not in path.stem.lower().replace("-", "_").split("_"):
        raise ValueError(f"osi: {path.name} must say that it holds SensorData, as the standard has it: drive_sd.osi")
    message_of = need("osi3.osi_sensordata_pb2", "osi", by="osi").SensorData
    version = need("osi3.osi_version_pb2", "osi", by="osi")
    current = version.DESCRIPTOR.GetOptions().Extensions[version.current_interface_version]
    count = 0
    with replacing(path) as temporary, temporary.open("wb") as file:
        for stamped in clouds:
            message = message_of()
            message.version.CopyFrom(current)
            message.sensor_id.value = 0
            _stamp(message.timestamp, stamped.time_s)
            sensor = message.feature_data.lidar_sensor.add()
            sensor.header.measurement_time.CopyFrom(message.timestamp)
            sensor.header.number_of_valid_detections = len(stamped.table)
            _detections(sensor.detection, stamped.table)
            data = message.SerializeToString()
            file.write(struct.pack("<I", len(data)) + data)
            count += 1
    return count


def _detections(detections: Any, table: np.ndarray) -> None:
    x, y, z = (table[name].astype(np.float64) for name in ("x", "y", "z"))
    level = np.hypot(x, y)
    columns = [np.hypot(level, z), np.arctan2(y, x), np.arctan2(z, level), 100 * table["intensity"].astype(np.float64)]
    rings = table["ring"].tolist() if "ring" in (table.dtype.names or ()) else None
    for k, (distance, azimuth, elevation, intensity) in enumerate(np.stack(columns, axis=1).tolist()):
        one = detections.add()
        one.existence_probability = 1.0
        one.position.distance, one.position.azimuth, one.position.elevation = distance, azimuth, elevation
        one.intensity = intensity
        if rings is not None:
            one.beam_id.value = rings[k]


def _stamp(timestamp: Any, time_s: float) -> None:
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    timestamp.seconds, timestamp.nanos = int(seconds), int(rest)
