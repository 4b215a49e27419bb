"""Polar frames as clouds that other programs open: a recording of all, or a file a frame (`jaxsim frames --to`)."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np

from jaxsim.cloud.export import save_cloud, table_of
from jaxsim.cloud.recordings import Stamped, write_mcap, write_osi, write_rrd
from jaxsim.data.polar_frames import PolarFrames, open_polar_frames
from jaxsim.files import file_of
from jaxsim.frame import Cloud
from jaxsim.geometry import polar_to_points
from jaxsim.progress import Progress

WHOLE = {"mcap": write_mcap, "osi": write_osi, "rrd": write_rrd}
"""Forms that hold all frames in one file."""


def write_clouds(folder: Path, out: Path, to: str, *, every: int = 1, most: int = 0) -> int:
    """Writes a folder's polar frames as clouds, with ring and time a point; how many there are.

    `out` is one file where `to` is one of WHOLE, else a folder of files NAME.`to`, of which those that are there are
    not written again. Every `every`-th frame is taken, and at most `most` (0: all). Raises ValueError for a folder
    without frames, ModuleNotFoundError where the form's own library is not installed.
    """
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
