"""Readers of other makers' logs, as `jaxsim frames` has them: each goes the whole way to polar frames and back."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data.logs import LogOptions, source_for, write_log
from jaxsim.data.polar_frames import open_polar_frames
from tests.data.logs.conftest import RINGS, room
from tests.data.logs.made_logs import (
    carla_buffer,
    detections,
    las,
    mcap,
    message,
    osi_mcap,
    osi_trace,
    pcd,
    ros1_bag,
    ros2_bag,
    sensor_view,
)
from tests.fuzz.reader import Reader, one
from tests.fuzz.recordings import OUSTER

FIELDS = room()
WITHIN = {
    "range_m": (0.0, 1e3),
    "intensity": (0.0, 1.0),
    "incidence": (0.0, 1.6),
    "azimuth_rad": (-10.0, 10.0),
    "elevation_rad": (-1.6, 1.6),
    "origin_m": (-10.0, 10.0),
    "offset_s": (0.0, 10.0),
}
VELODYNE = OUSTER.parent / "velodyne_vlp16" / "my.pcap"


def _frames(folder: Path, name: str, **options: Any) -> Any:
    """The first turns of the log `folder`/`name`, as `jaxsim frames` writes them."""
    out = folder / "out"
    kind, source = source_for(folder / name)
    write_log(folder / name, kind, source, out=out, options=LogOptions(**options), most=2)
    frames = open_polar_frames(out)
    read = [frames.read(name) for name in frames.names]
    rasters = [{"offset_s" if key == "time" else key: value for key, value in more.items()} for _, more in read]
    return frames.grid, frames.about, [image for image, _ in read], rasters


def _log(make: Callable[[Path], Any], name: str, *files: str, **options: Any) -> Reader:
    """A reader of the log `name` that `make` writes; times since 1970 are large."""
    return Reader(
        lambda folder: (make(folder), None)[1],
        lambda folder: _frames(folder, name, **options),
        files or (name,),
        largest=1e11,
        within=WITHIN,
    )


def _ply(folder: Path, *, text: bool) -> None:
    import plyfile

    vertices = np.empty(len(FIELDS["x"]), [(name, value.dtype) for name, value in FIELDS.items()])
    for name, value in FIELDS.items():
        vertices[name] = value
    plyfile.PlyData([plyfile.PlyElement.describe(vertices, "vertex")], text=text).write(str(folder / "a.ply"))


def _argoverse(folder: Path) -> None:
    """A sweep and the poses of its log, the sensor in the middle of the car."""
    import pyarrow as pa
    from pyarrow import feather

    stamp = 315973157959879000
    table = {key: FIELDS[key] for key in ("x", "y", "z", "intensity")}
    table |= {"laser_number": FIELDS["ring"].astype("u1"), "offset_ns": FIELDS["t"].astype("i4")}
    one(f"sensors/lidar/{stamp}.feather", b"")(folder / "log")
    feather.write_feather(pa.table(table), folder / f"log/sensors/lidar/{stamp}.feather")
    still = {"qw": [1.0] * 2} | {key: [0.0] * 2 for key in ("qx", "qy", "qz", "tx_m", "ty_m", "tz_m")}
    poses = pa.table({"timestamp_ns": [stamp - 10**9, stamp + 10**9]} | still)
    feather.write_feather(poses, folder / "log/city_SE3_egovehicle.feather")


def _pcd_again(folder: Path) -> None:
    """A log of which a frame is written, and how; the record has the path under which it is attacked."""
    pcd(folder / "a.pcd", FIELDS, "binary")
    _frames(folder, "a.pcd")
    record, case = folder / "out/log.json", folder.parents[1] / "case"
    record.write_text(record.read_text().replace(str(folder), str(case)))


def _resumed(folder: Path) -> Any:
    for frame in (folder / "out").glob("*.npz"):
        frame.unlink()
    return _frames(folder, "a.pcd")


_ALL: dict[str, tuple[str, Reader]] = {
    "log, pcd ascii": ("pypcd4", _log(lambda f: pcd(f / "a.pcd", FIELDS, "ascii"), "a.pcd")),
    "log, pcd": ("pypcd4", _log(lambda f: pcd(f / "a.pcd", FIELDS, "binary"), "a.pcd")),
    "log, pcd compressed": ("pypcd4", _log(lambda f: pcd(f / "a.pcd", FIELDS, "binary_compressed"), "a.pcd")),
    "log, ply": ("plyfile", _log(lambda f: _ply(f, text=False), "a.ply")),
    "log, ply ascii": ("plyfile", _log(lambda f: _ply(f, text=True), "a.ply")),
    "log, las": ("laspy", _log(lambda f: las(f / "a.las", FIELDS), "a.las", lines=RINGS)),
    "log, laz": ("lazrs", _log(lambda f: las(f / "a.laz", FIELDS), "a.laz", lines=RINGS)),
    "log, carla": ("", _log(lambda f: carla_buffer(f, FIELDS, semantic=False), "000010.raw", "*")),
    "log, carla semantic": ("", _log(lambda f: carla_buffer(f, FIELDS, semantic=True), "000010.raw", "*")),
    "log, argoverse2": ("pyarrow", _log(_argoverse, "log", "log/**/*.feather")),
    "log, mcap": ("mcap_ros2", _log(lambda f: mcap(f / "a.mcap", [message(FIELDS)]), "a.mcap")),
    "log, ros2 bag": ("rosbags", _log(lambda f: ros2_bag(f / "bag", FIELDS), "bag", "bag/*")),
    "log, ros1 bag": ("rosbags", _log(lambda f: ros1_bag(f / "a.bag", FIELDS), "a.bag")),
    "log, osi view": ("osi3", _log(lambda f: osi_trace(f / "a_sv_3.osi", sensor_view(FIELDS)), "a_sv_3.osi")),
    "log, osi data": ("osi3", _log(lambda f: osi_trace(f / "a_sd_3.osi", detections(FIELDS)), "a_sd_3.osi")),
    "log, osi mcap": ("mcap_protobuf", _log(lambda f: osi_mcap(f / "a.mcap", FIELDS), "a.mcap")),
    "log.json": (
        "pypcd4",
        Reader(_pcd_again, _resumed, ("out/log.json", "out/grid.json"), largest=1e11, within=WITHIN),
    ),
}
"""By what they read, each with the package that it needs."""
LOGS = {name: reader for name, (needs, reader) in _ALL.items() if not needs or find_spec(needs)}
if VELODYNE.is_file() and find_spec("velodyne_decoder"):
    LOGS["log, velodyne"] = _log(lambda f: shutil.copy(VELODYNE, f / "a.pcap"), "a.pcap")
