"""`jaxsim frames`: any log of a LiDAR as polar frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.data.logs import LogOptions, source_for, source_table, write_log
from jaxsim.files import check_apart, tidy_file
from jaxsim.progress import counted
from jaxsim.recordings import WHOLE_FILE, export_frames


@dataclass(frozen=True)
class Frames(Checked):
    """Reads a log and writes its turns as polar frames, which `jaxsim discover` compares.

        jaxsim frames recording.pcap --out measured
        jaxsim frames bag/ --log.topic /lidar_top/points --out measured
        jaxsim frames measured --to mcap --out measured.mcap
        jaxsim frames --list

    Ouster, Velodyne, nuScenes, KITTI, Argoverse 2, ROS bags and MCAP, PCD, PLY, LAS, CARLA's LiDARs, ASAM OSI; others
    by entry points of the group jaxsim.sources. Rows are the sensor's beams, from the log's ring or beam number, else
    from gaps between elevations; columns are its firings. A killed command goes on where it was.
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
        return None if self.list or self.to in WHOLE_FILE else self.out

    def __call__(self) -> None:
        if self.list:
            print(source_table())
            return
        if self.source is None or self.out is None:
            raise ValueError("frames: give the log and --out FOLDER; `jaxsim frames --list` tells what can be read")
        check_apart(self.out, self.source, by="frames")
        if self.to:
            if self.to in WHOLE_FILE:
                tidy_file(self.out)
            count = export_frames(self.source, self.out, self.to, every=self.every, most=self.most)
            print(f"{counted(count, 'cloud')}: {self.out}")
            return
        kind, source = source_for(self.source, self.kind)
        written = write_log(self.source, kind, source, out=self.out, options=self.log, every=self.every, most=self.most)
        print(f"{kind}: {written.words(self.out)}")
