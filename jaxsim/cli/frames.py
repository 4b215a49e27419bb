"""`jaxsim frames`: any log of a LiDAR as polar frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import jax
import numpy as np
import tyro

from jaxsim.cloud.export import save_cloud, table_of
from jaxsim.cloud.recordings import Stamped, write_mcap, write_osi, write_rrd
from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.data.logs import LogOptions, Written, known_sources, source_for, write_log
from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.files import file_of
from jaxsim.frame import Cloud
from jaxsim.geometry import polar_to_points
from jaxsim.progress import Progress

WHOLE = {"mcap": write_mcap, "osi": write_osi, "rrd": write_rrd}
"""Forms that hold all frames in one file."""


@dataclass(frozen=True)
class Frames(Checked):
    """Reads a log and writes its turns as polar frames, which `jaxsim discover` compares.

        jaxsim frames recording.pcap --out measured
        jaxsim frames bag/ --log.topic /lidar_top/points --out measured
        jaxsim frames measured --to mcap --out measured.mcap
        jaxsim frames --list

    Ouster, Velodyne, nuScenes, KITTI, Argoverse 2, ROS bags and MCAP, PCD, PLY, LAS, CARLA's LiDARs, ASAM OSI; others
    by
    entry points of the group jaxsim.sources. Rows are the sensor's beams, from the log's ring or beam number, else from
    gaps between elevations; columns are its firings. A killed command goes on where it was.
    """

    source: Annotated[Path | None, tyro.conf.Positional] = None
    """The log: a file, or the folder that holds it."""
    out: Path | None = None
    """Folder to write to."""
    kind: str = ""
    """Family of the log; empty: told from the file. --list tells all."""
    log: LogOptions = field(default_factory=LogOptions)
    """How it is read."""
    every: Count = 1
    """Take every so many turns."""
    most: Whole = 0
    """At most so many turns; 0: all."""
    to: Literal["", "mcap", "osi", "rrd", "pcd", "ply", "las", "npz"] = ""
    """The other way: write polar frames (SOURCE is their folder) as clouds with ring and time a point: one .mcap with
    PointCloud2, one .osi with SensorData (of which no time a point is known), one .rrd for Rerun's viewer, or in a
    folder a file a frame."""
    list: bool = False
    """List the families, and what to install for each."""

    @property
    def writes_to(self) -> Path | None:
        return None if self.list or self.to in WHOLE else self.out

    def __call__(self) -> None:
        if self.list:
            print(_table())
            return
        if self.source is None or self.out is None:
            raise ValueError("frames: give the log and --out FOLDER; `jaxsim frames --list` tells what can be read")
        if self.to:
            count = write_clouds(self.source, self.out, self.to, every=self.every, most=self.most)
            print(f"{count} clouds: {self.out}")
            return
        kind, source = source_for(self.source, self.kind)
        written = write_log(self.source, kind, source, out=self.out, options=self.log, every=self.every, most=self.most)
        print(_told(kind, written, self.out))


def write_clouds(folder: Path, out: Path, to: str, *, every: int = 1, most: int = 0) -> int:
    """Writes a folder's polar frames as clouds; how many there are. Files that are there are not written again."""
    frames = open_polar_frames(folder)
    names = frames.names[::every][: most or None]
    bar = Progress(names, unit="cloud", desc="writing")
    if to in WHOLE:
        return WHOLE[to](out, (_stamped(frames, name, k) for k, name in enumerate(bar)))
    for name in bar:
        path = file_of(out, name, f".{to}", by="frames")
        if not path.is_file():
            cloud, time_s = _cloud(frames, name)
            save_cloud(path, cloud, time_s=time_s)
    return len(names)


def _cloud(frames: PolarFrames, name: str) -> tuple[Cloud, np.ndarray | None]:
    image, columns = frames.read(name)
    cloud = jax.tree.map(np.asarray, polar_to_points(image, frames.grid))
    return cloud, columns["time"].ravel().astype(np.float32) if "time" in columns else None


def _stamped(frames: PolarFrames, name: str, number: int) -> Stamped:
    """A frame's cloud at its time; frames without one are a tenth of a second apart."""
    return Stamped(float(frames.about.get(name, {}).get("time", number / 10)), table_of(*_cloud(frames, name)))


def _table() -> str:
    rows = [(name, source.title, source.extra) for name, source in known_sources().items()]
    width = max(len(name) for name, _, _ in rows) + 2
    title = max(len(what) for _, what, _ in rows) + 2
    return "\n".join(
        f"{name:<{width}}{what:<{title}}{f'pip install jaxsim-lidar[{extra}]' if extra else ''}".rstrip()
        for name, what, extra in rows
    )


def _told(kind: str, written: Written, out: Path) -> str:
    lines = [f"{kind}: {written.frames} frames of {written.rows} x {written.columns} cells in {out}"]
    if written.frames:
        lines.append(f"  {written.filled:.1%} of the cells hold a return")
    if written.already:
        lines.append(f"  {written.already} were there")
    if written.partial:
        lines.append(f"  {written.partial} turns that begin or end within the recording were passed over")
    sensor = written.sensor
    if sensor is not None:
        top, bottom = np.rad2deg(sensor.beams.elevation_rad[[0, -1]])
        lines.append(f"  beams from {top:.2f} to {bottom:.2f} degrees; points miss them by {sensor.beams.off_deg:.3f}")
        lines.append(f"  intensity 0..{sensor.full_scale:g} became 0..1")
        if not np.allclose(sensor.cloud_from_sensor, np.eye(4)):
            x, y, z = sensor.cloud_from_sensor[:3, 3]
            lines.append(f"  the sensor stands at x {x:.2f}, y {y:.2f}, z {z:.2f} m in the log's frame")
    return "\n".join(lines)
