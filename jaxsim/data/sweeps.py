"""LiDAR-only recordings as polar frames on the sensor's own grid: nuScenes' LIDAR_TOP sweeps, Ouster's `.pcap`.

nuScenes' `.pcd.bin` is float32 Nx5 (x right, y forward, z up, intensity 0..255, ring), ring 0 the lowest beam, one
entry for every firing: a beam that did not come back is stored as a point at the sensor itself.

Ouster's recordings (`.pcap` + sensor `.json`) are read through ouster-sdk. The sensor fires its beams in turn, so a
column of the raw scan is a slanted line in the world; the frames here are de-staggered: a column is one azimuth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Float

from jaxsim.files import check_size, need
from jaxsim.frame import Cloud, PolarGrid, PolarImage
from jaxsim.geometry import full_grid, points_to_polar, preset
from jaxsim.geometry.points import check_points

_FULL_SCALE: dict[str, float] = {"reflectivity": 255.0, "signal": 65535.0}
_NUSCENES_SENSOR = "hdl32e"
_NUSCENES_COLUMNS = 900
"""A fifth fewer than the firings of a turn: motion compensation spreads them unevenly, and at the sensor's own
step that leaves 1.5 % of the cells empty which are no dropped returns."""


LEAST_FIRINGS = 1070
"""Fewest firings of a whole turn of nuScenes' sensor: at its 0.332 degrees they make 355."""
MOST_BYTES = 64 * 2**20


@dataclass(frozen=True)
class Sweep:
    """A whole turn (host memory)."""

    name: str
    scene: str
    """The recording."""
    image: PolarImage
    grid: PolarGrid
    time_s: float | None = None
    rasters: dict[str, np.ndarray] = field(default_factory=dict)
    """Further rasters of polar frames by their names: time, semantic ..."""
    hidden: float = 0.0
    """Share of firings whose cell holds a nearer one, of a cloud that was put on the grid."""


def read_lidar_top(path: Path | str, *, columns: int = _NUSCENES_COLUMNS) -> Sweep:
    """One sweep, the car's forward direction in the middle; cells without return include rays that hit the car.

    Raises ValueError for a truncated file, non-finite points, a ring that is no beam, a turn that is not whole, points
    that no LiDAR sees, intensity off 0..255.
    """
    path = Path(path)
    points = _read_points(path)
    spec = preset(_NUSCENES_SENSOR)
    x, y, z, intensity, ring = points.T
    cloud = Cloud(
        xyz_m=np.stack([y, -x, z], axis=1),
        intensity=intensity / np.float32(255),
        valid=np.linalg.norm(points[:, :3], axis=1) >= spec.min_range_m,
        # Ring 0 is the lowest beam, row 0 the top one.
        row=(spec.rows - 1 - ring).astype(np.int32),
    )
    grid = full_grid(spec, columns)
    image, _ = points_to_polar(cloud, grid)
    image = jax.tree.map(np.asarray, image)
    name = path.name.removesuffix(".pcd.bin")
    scene, _, stamp = name.partition("__LIDAR_TOP__")
    return Sweep(
        name=name,
        scene=scene,
        image=image,
        grid=grid,
        time_s=int(stamp) / 1e6 if stamp.isdecimal() else None,
        hidden=1 - float(image.valid.sum()) / max(int(cloud.valid.sum()), 1),
    )


def _read_points(path: Path) -> Float[np.ndarray, "n 5"]:
    if not path.is_file():
        raise ValueError(f"nuscenes: there is no {path}; pass a file samples/LIDAR_TOP/*.pcd.bin")
    size = check_size(path, by="nuscenes", most=MOST_BYTES)
    if size == 0 or size % 20:
        raise ValueError(
            f"nuscenes: {path} has {size} bytes, no whole number of points (x y z intensity ring, float32, "
            "20 bytes each): truncated, or not a LIDAR_TOP file"
        )
    points = np.fromfile(path, "<f4").reshape(-1, 5)
    check_points(points[:, :3], f"nuscenes: {path}")
    ring, lines = points[:, 4], preset(_NUSCENES_SENSOR).rows
    if (ring != np.round(ring)).any() or ring.min() < 0 or ring.max() >= lines:
        raise ValueError(
            f"nuscenes: {path}: the fifth value spans {ring.min():g}..{ring.max():g}; it must be the ring, a "
            f"whole number 0..{lines - 1}: not a LIDAR_TOP file"
        )
    firings, rest = divmod(len(points), lines)
    if rest or (ring != np.tile(np.arange(lines), firings)).any() or firings < LEAST_FIRINGS:
        raise ValueError(
            f"nuscenes: {path} holds {len(points)} points; a whole turn is {LEAST_FIRINGS} firings or more (1084 to "
            f"1090) of {lines} rings each, in order: the file is cut off, or was sorted or thinned; use the original"
        )
    low, high = points[:, 3].min(), points[:, 3].max()
    if low < 0 or high > 255 or 0 < high <= 1:
        raise ValueError(
            f"nuscenes: {path}: intensity spans {low:g}..{high:g}; nuScenes stores 0..255, so this file was "
            "rescaled: use the original"
        )
    return points


def read_pcap(
    path: Path | str,
    *,
    meta: Path | str | None = None,
    intensity: str = "reflectivity",
    full_scale: float | None = None,
    returns: Literal["strongest", "last"] = "strongest",
) -> Iterator[Sweep]:
    """The whole turns of a recording, one after the other; turns with lost packets are passed over.

    `path` is a `.pcap`, or an `.osf` or a bag, which hold the sensor's description. `meta` is the description of a
    `.pcap`; by default the `.json` beside it. `reflectivity` is Ouster's calibrated value, `signal` counts photons.
    `full_scale` is the value that becomes 1: by default the largest the file can hold, 255 and 65535. Of profiles with
    two returns the first is the strongest; `last` is the farther one.

    Raises ImportError without ouster-sdk, ValueError for files that are no recording, for values above
    `full_scale` and where not one turn is whole.
    """
    path = Path(path)
    if meta is not None or path.suffix.lower() == ".pcap":
        meta = path.with_suffix(".json") if meta is None else Path(meta)
    if intensity not in _FULL_SCALE:
        raise ValueError(f"ouster: no intensity {intensity!r}; known: {', '.join(_FULL_SCALE)}")
    scale = _FULL_SCALE[intensity] if full_scale is None else full_scale
    source, core = _open_pcap(path, meta)
    whole = partial = 0
    for frame in (frame for frames in source for frame in frames):
        if not frame.complete():
            partial += 1
            continue
        last = returns == "last"
        yield _sweep(path, frame, core, intensity=intensity, full_scale=scale, number=whole, last=last)
        whole += 1
    if not whole + partial:
        if meta is None:
            raise ValueError(f"ouster: {path} holds no turn; the recording is empty, or was cut off")
        raise ValueError(
            f"ouster: not one packet of {path} is of the sensor that {meta.name} describes ({_described(meta, core)}): "
            "pass the .json that was saved with this recording (meta=PATH), or look whether the recording is empty"
        )
    if not whole:
        raise ValueError(f"ouster: {path} has no whole turn, {partial} broken ones; the recording was cut off")


def _open_pcap(path: Path, meta: Path | None) -> tuple[Any, Any]:
    core = need("ouster.sdk.core", "ouster", by="ouster")
    open_source = need("ouster.sdk.open_source", "ouster", by="ouster").open_source
    if not path.exists():
        raise ValueError(f"ouster: there is no {path}; pass a .pcap, .osf or bag")
    if meta is not None and not meta.is_file():
        raise ValueError(
            f"ouster: there is no {meta}; a .pcap is read with the sensor's description, a .json of the same "
            "name beside it, or meta=PATH"
        )
    try:
        options: dict[str, Any] = {} if meta is None else {"meta": [str(meta)]}
        return open_source(str(path), **options), core
    except Exception as error:  # the SDK has no common base for its errors
        why = " ".join(str(error).split())  # theirs has several lines
        raise ValueError(
            f"ouster: {path}{f' with {meta.name}' if meta else ''} cannot be read: {why}; pass a .pcap and the .json "
            "of its sensor"
        ) from error


def _sweep(
    path: Path, frame: Any, core: Any, *, intensity: str, full_scale: float, number: int, last: bool = False
) -> Sweep:
    info = frame.sensor_info
    if not frame.has_field(intensity.upper()):
        others = [name for name in _FULL_SCALE if frame.has_field(name.upper())]
        raise ValueError(
            f"ouster: {path} holds no {intensity}: its profile, {info.format.udp_profile_lidar}, sends "
            f"{', '.join(sorted(frame.fields))}; take intensity={others[0]!r}"
            if others
            else f"ouster: {path} holds neither {' nor '.join(_FULL_SCALE)}; record with another profile"
        )
    value = core.destagger(info, frame.field(intensity.upper())).astype(np.float32)
    range_m = core.destagger(info, frame.field("RANGE")).astype(np.float32) / np.float32(1000)
    if last and frame.has_field("RANGE2"):
        second_m = core.destagger(info, frame.field("RANGE2")).astype(np.float32) / np.float32(1000)
        other = core.destagger(info, frame.field(f"{intensity.upper()}2")).astype(np.float32)
        value = np.where(second_m > range_m, other, value)
        range_m = np.maximum(range_m, second_m)
    valid = range_m > 0
    largest = float(value[valid].max(initial=0))
    if largest > full_scale:
        raise ValueError(f"ouster: {path}: {intensity} reaches {largest:g}, above full_scale={full_scale:g}; raise it")
    _check_beams(path, info)
    grid, first, along_m = _ouster_grid(info)
    # The file measures from the sensor's axis along the beam's way out; a polar image from the beam's origin on it.
    range_m = np.where(valid, np.maximum(range_m + along_m[:, None], np.float32(1e-3)), np.float32(0))
    image = PolarImage(
        range_m=np.roll(range_m, -first, axis=1),
        intensity=np.roll(value / np.float32(full_scale), -first, axis=1),
        valid=np.roll(valid, -first, axis=1),
    )
    stamps = frame.timestamp[frame.timestamp > 0]
    fired_s = ((frame.timestamp.astype(np.int64) - (int(stamps.min()) if len(stamps) else 0)) * 1e-9).astype(np.float32)
    time_s = core.destagger(info, np.ascontiguousarray(np.broadcast_to(fired_s, frame.field("RANGE").shape)))
    return Sweep(
        name=f"{path.stem}-{number:06d}",
        scene=path.stem,
        image=image,
        grid=grid,
        time_s=float(stamps[0]) / 1e9 if len(stamps) else None,
        rasters={"time": np.where(image.valid, np.roll(time_s, -first, axis=1), np.float32(0))},
    )


def _check_beams(path: Path, info: Any) -> None:
    """Raises ValueError where the sensor's description holds what no sensor has."""
    limits = {
        "beam_azimuth_angles": (info.beam_azimuth_angles, 180.0),
        "beam_altitude_angles": (info.beam_altitude_angles, 90.0),
        "pixel_shift_by_row": (info.format.pixel_shift_by_row, int(info.format.columns_per_frame)),
        "lidar_to_sensor_transform": (info.lidar_to_sensor_transform, 1000.0),
    }
    for name, (given, most) in limits.items():
        if not (np.abs(np.asarray(given, float)) <= most).all():
            raise ValueError(f"ouster: the sensor of {path} has {name} beyond {most:g}; copy its .json again")


def _described(meta: Path, core: Any) -> str:
    info = core.SensorInfo(meta.read_text())
    return f"{info.prod_line}, {info.format.columns_per_frame} columns, {info.format.udp_profile_lidar}"


def _ouster_grid(info: Any) -> tuple[PolarGrid, int, Float[np.ndarray, " rows"]]:
    """The de-staggered scan's directions, the column of the scan that comes first in them, and what is to be added to
    ranges, by beam, in metres.

    The de-staggering shift is a whole number of columns, so a column's azimuth is the mean over its beams,
    which stay within half a column of it.

    A beam starts n beside the axis (28 mm of an OS-0), in the direction of the encoder, and points by d to the side of
    it; the file's range r counts n. Its points lie at rho = (r - n) cos e + n cos d from the axis, z = (r - n) sin e
    high: on a ray from the axis at h = -n cos d tan e, of length (r - n) + n cos d / cos e. What is left is n sin d to
    the side, 4 mm at most, within the column (Ouster's Sensor Data, "lidar range to XYZ").
    """
    columns = int(info.format.columns_per_frame)
    step = 2 * math.pi / columns
    shift = np.asarray(info.format.pixel_shift_by_row, float)
    offset = float(np.mean(shift * step - np.radians(np.asarray(info.beam_azimuth_angles, float))))
    first = math.ceil(offset / step)  # so that the first column lies at or just under +pi
    azimuth = math.pi + offset - step * (np.arange(columns) + first)
    elevation = np.radians(np.asarray(info.beam_altitude_angles, float))
    beam = np.asarray(info.beam_to_lidar_transform, float)
    beside_m = float(np.hypot(beam[0, 3], beam[2, 3])) / 1000
    out_m = beam[0, 3] / 1000 * np.cos(np.radians(np.asarray(info.beam_azimuth_angles, float)))
    height = (float(np.asarray(info.lidar_to_sensor_transform)[2, 3]) + beam[2, 3]) / 1000 - out_m * np.tan(elevation)
    grid = PolarGrid(
        azimuth_rad=azimuth.astype(np.float32),
        elevation_rad=elevation.astype(np.float32),
        origin_m=height.astype(np.float32),
    )
    return grid, first, (out_m / np.cos(elevation) - beside_m).astype(np.float32)
