"""Ouster recordings (`.pcap` + sensor `.json`) as polar frames, through ouster-sdk.

The sensor fires its beams in turn, so a column of the raw scan is a slanted line in the world; the frames
here are de-staggered: a column is one azimuth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data.sweep import Sweep
from jaxsim.frame import PolarGrid, PolarImage

_FULL_SCALE: dict[str, float] = {"reflectivity": 255.0, "signal": 65535.0}


def read_pcap(
    path: Path | str,
    *,
    meta: Path | str | None = None,
    intensity: str = "reflectivity",
    full_scale: float | None = None,
) -> Iterator[Sweep]:
    """The whole turns of a recording, one after the other; turns with lost packets are passed over.

    `meta` is the sensor's description; by default the `.json` beside the `.pcap`. `reflectivity` is Ouster's
    calibrated value, `signal` counts photons. `full_scale` is the value that becomes 1: by default the
    largest the file can hold, 255 and 65535.

    Raises ImportError without ouster-sdk, ValueError for files that are no recording, for values above
    `full_scale` and where not one turn is whole.
    """
    path = Path(path)
    meta = path.with_suffix(".json") if meta is None else Path(meta)
    if intensity not in _FULL_SCALE:
        raise ValueError(f"ouster: no intensity {intensity!r}; known: {', '.join(_FULL_SCALE)}")
    scale = _FULL_SCALE[intensity] if full_scale is None else full_scale
    source, core = _open(path, meta)
    whole = partial = 0
    for frame in (frame for frames in source for frame in frames):
        if not frame.complete():
            partial += 1
            continue
        yield _sweep(path, frame, core, intensity=intensity, full_scale=scale, number=whole)
        whole += 1
    if not whole:
        raise ValueError(f"ouster: {path} has no whole turn, {partial} broken ones; the recording was cut off")


def _open(path: Path, meta: Path) -> tuple[Any, Any]:
    try:
        from ouster.sdk import core
        from ouster.sdk.open_source import open_source
    except ImportError as error:
        raise ImportError("ouster: reading .pcap files needs ouster-sdk; pip install jaxsim-lidar[ouster]") from error
    if not path.is_file():
        raise ValueError(f"ouster: there is no {path}; pass a .pcap recording")
    if not meta.is_file():
        raise ValueError(
            f"ouster: there is no {meta}; a .pcap is read with the sensor's description, a .json of the same "
            "name beside it, or meta=PATH"
        )
    try:
        return open_source(str(path), meta=[str(meta)]), core
    except Exception as error:  # the SDK has no common base for its errors
        raise ValueError(
            f"ouster: {path} with {meta.name} cannot be read: {error}; pass a .pcap and the .json of its sensor"
        ) from error


def _sweep(path: Path, frame: Any, core: Any, *, intensity: str, full_scale: float, number: int) -> Sweep:
    info = frame.sensor_info
    value = core.destagger(info, frame.field(intensity.upper())).astype(np.float32)
    range_m = core.destagger(info, frame.field("RANGE")).astype(np.float32) / np.float32(1000)
    valid = range_m > 0
    largest = float(value[valid].max(initial=0))
    if largest > full_scale:
        raise ValueError(f"ouster: {path}: {intensity} reaches {largest:g}, above full_scale={full_scale:g}; raise it")
    grid, first = _grid(info)
    image = PolarImage(
        range_m=np.roll(range_m, -first, axis=1),
        intensity=np.roll(value / np.float32(full_scale), -first, axis=1),
        valid=np.roll(valid, -first, axis=1),
    )
    stamps = frame.timestamp[frame.timestamp > 0]
    return Sweep(
        name=f"{path.stem}-{number:06d}",
        scene=path.stem,
        image=image,
        grid=grid,
        time_s=float(stamps[0]) / 1e9 if len(stamps) else None,
    )


def _grid(info: Any) -> tuple[PolarGrid, int]:
    """The de-staggered scan's directions, and the column of the scan that comes first in them.

    The de-staggering shift is a whole number of columns, so a column's azimuth is the mean over its beams,
    which stay within half a column of it.
    """
    columns = int(info.format.columns_per_frame)
    step = 2 * math.pi / columns
    shift = np.asarray(info.format.pixel_shift_by_row, float)
    offset = float(np.mean(shift * step - np.radians(np.asarray(info.beam_azimuth_angles, float))))
    first = math.ceil(offset / step)  # so that the first column lies at or just under +pi
    azimuth = math.pi + offset - step * (np.arange(columns) + first)
    elevation = np.radians(np.asarray(info.beam_altitude_angles, float))
    height = np.full(len(elevation), float(np.asarray(info.lidar_to_sensor_transform)[2, 3]) / 1000)
    grid = PolarGrid(
        azimuth_rad=azimuth.astype(np.float32),
        elevation_rad=elevation.astype(np.float32),
        origin_m=height.astype(np.float32),
    )
    return grid, first
