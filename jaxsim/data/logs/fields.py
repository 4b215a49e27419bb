"""Points whose values have names, as PCD, PLY, PointCloud2 and tables have them, as a scan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.logs.scan import LogOptions, LogScan

RING = ("ring", "laser_number", "channel", "beam", "beam_id", "line", "laser_id", "laserid", "scan_line", "row")
"""Names of the beam's number in drivers and data sets, the likeliest first."""
TIME = ("t", "time", "timestamp", "offset_time", "offset_ns", "time_offset", "gps_time", "time_stamp", "timeStampNs")
INTENSITY = ("intensity", "reflectivity", "i", "scalar_Intensity", "scalar_intensity", "signal", "reflectance")


def scan_of_fields(
    values: Mapping[str, np.ndarray],
    options: LogOptions,
    *,
    by: str,
    where: str,
    name: str,
    scene: str,
    time_s: float | None = None,
    **more: Any,
) -> LogScan:
    """A scan of arrays by the names of their fields, which drivers and data sets spell as RING, TIME and INTENSITY say.

    `where` is what the errors name. Times in whole numbers are nanoseconds, others seconds. Raises ValueError where
    coordinates or intensity are missing.
    """
    missing = [axis for axis in "xyz" if axis not in values]
    if missing:
        raise ValueError(
            f"{by}: {where} has no field {', '.join(missing)}; it has {', '.join(values) or 'none'}: a cloud "
            f"has x, y, z"
        )
    key = options.intensity or next((known for known in INTENSITY if known in values), "")
    if key not in values:
        raise ValueError(
            f"{by}: {where} has no field {key or 'intensity'}; it has {', '.join(values)}: name the one that holds it "
            "with --log.intensity"
        )
    ring = next((values[known] for known in RING if known in values), None)
    times = next((values[known] for known in TIME if known in values), None)
    if ring is not None and ring.dtype.kind == "f":
        if not np.array_equal(ring, np.round(ring)):
            raise ValueError(f"{by}: {where} has rings that are no whole numbers; is it another field?")
        ring = ring.astype(np.int64)
    known: dict[str, Any] = {"full_scale": scale_of(values[key])} | more
    return LogScan(
        name=name,
        scene=scene,
        xyz_m=np.stack([values[axis].ravel() for axis in "xyz"], axis=1).astype(np.float32),
        intensity=values[key].ravel().astype(np.float32),
        ring=None if ring is None else ring.ravel().astype(np.int64),
        offset_s=None if times is None else offsets(times.ravel()),
        time_s=time_s,
        **known,
    )


def offsets(times: np.ndarray) -> Float[np.ndarray, " n"]:
    """Seconds from the first: of whole numbers, which are nanoseconds, or of seconds."""
    if not len(times):
        return np.zeros(0, np.float32)
    if times.dtype.kind in "iu":
        return ((times.astype(np.int64) - int(times.min())) * 1e-9).astype(np.float32)
    known = times[np.isfinite(times)]
    return (times.astype(np.float64) - float(known.min() if len(known) else 0)).astype(np.float32)


def scale_of(values: np.ndarray) -> float | None:
    """The largest value that a type of whole numbers holds, where it has one or two bytes; None for any other."""
    return float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" and values.dtype.itemsize <= 2 else None


def ring_of_shape(shape: tuple[int, int], axis: int) -> Int[np.ndarray, " n"]:
    """Ring of an organised cloud's points, which is their index along an axis."""
    return np.broadcast_to(np.arange(shape[axis])[:, None] if axis == 0 else np.arange(shape[1]), shape).ravel()
