"""Logs of Argoverse 2: sweeps of two stacked sensors in the car's frame."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from jaxsim.data.logs.scan import Item, LogOptions, LogScan, offsets, reading
from jaxsim.files import need

_UPPER_LASERS = 32
"""Of Argoverse 2: those below are the upper sensor's."""


def argoverse2_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Sweeps `sensors/lidar/*.feather` of a log: one of its two stacked sensors, in the frame of that sensor.

    The log's clouds lie in the car's frame with the car's motion taken out; where city_SE3_egovehicle.feather is there,
    each point goes back to where the sensor saw it. Lasers 0..31 are the upper sensor's (the default), 32..63 the
    lower one's, which hangs upside down (--log.rings 32-63). Where on the car it stands is told from its beams.
    """
    need("pyarrow", "argoverse2", by="argoverse2")
    files = [path] if path.is_file() else sorted(path.rglob("sensors/lidar/*.feather"))
    for file in files:
        log = file.parents[2].name
        poses = file.parents[2] / "city_SE3_egovehicle.feather"
        yield Item(f"{log[:8]}-{file.stem}", partial(_argoverse2_scan, file, log, options=options), (file, poses))


def _argoverse2_scan(file: Path, log: str, *, options: LogOptions) -> LogScan:
    table = _feather(file)
    missing = [key for key in ("x", "y", "z", "intensity", "laser_number", "offset_ns") if key not in table]
    if missing:
        raise ValueError(f"argoverse2: {file} has no column {', '.join(missing)}; it has {', '.join(table)}")
    xyz = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
    poses = file.parents[2] / "city_SE3_egovehicle.feather"
    stamp = int(file.stem) if file.stem.isdecimal() else None
    if poses.is_file() and stamp is not None:
        xyz = _as_fired(xyz, _feather(poses), stamp=stamp, offset_ns=table["offset_ns"])
    scan = LogScan(
        name=f"{log[:8]}-{file.stem}",
        scene=log,
        xyz_m=xyz.astype(np.float32),
        intensity=table["intensity"].astype(np.float32),
        ring=table["laser_number"].astype(np.int64),
        offset_s=offsets(table["offset_ns"]),
        time_s=None if stamp is None else stamp / 1e9,
        full_scale=255.0,
        mount="fit",
    )
    return scan if options.rings else scan.only(table["laser_number"] < _UPPER_LASERS)


def _as_fired(xyz_m: np.ndarray, poses: dict[str, np.ndarray], *, stamp: int, offset_ns: np.ndarray) -> np.ndarray:
    """Points of the car's frame at `stamp` in its frame when each was measured."""
    from scipy.spatial.transform import Rotation, Slerp

    times = (poses["timestamp_ns"].astype(np.int64) - stamp) / 1e9
    order = np.argsort(times)
    turns = Rotation.from_quat(np.stack([poses[key] for key in ("qx", "qy", "qz", "qw")], axis=1)[order])
    places = np.stack([poses[key] for key in ("tx_m", "ty_m", "tz_m")], axis=1)[order]
    if not times.min() <= 0 <= times.max():
        raise ValueError(f"argoverse2: sweep {stamp} lies outside the poses of its log; copy city_SE3_egovehicle again")
    fired = np.clip(offset_ns.astype(np.float64) / 1e9, times.min(), times.max())
    when = np.concatenate([[0.0], fired])
    turn = Slerp(times[order], turns)(when)
    origin = np.stack([np.interp(when, times[order], places[:, k]) for k in range(3)], axis=1)
    city = turn[0].apply(xyz_m) + origin[0]
    return turn[1:].apply(city - origin[1:], inverse=True)


def _feather(file: Path) -> dict[str, np.ndarray]:
    feather = need("pyarrow.feather", "argoverse2", by="argoverse2")
    with reading("argoverse2", file, "it is cut off, or no feather table; copy it again"):
        table = feather.read_table(file)
        return {name: table[name].to_numpy() for name in table.column_names}
