"""Logs of LiDARs, as makers, data sets, robots and simulators write them, as folders of polar frames.

scan          what a source delivers, scan by scan, and the options that it is read with
makers        Ouster, Velodyne, nuScenes, Argoverse 2, KITTI
files         PCD, PLY, LAS; CARLA's raw buffers
range_images  labelled range images, which segmentation learns from, too
messages      ROS bags and MCAP, ASAM OSI traces
gridding      the sensor's beams and columns from its first scans, and every scan on that grid
folder        a log to a folder: `write_log` (`jaxsim frames`)

A source of one's own is a `Source`, and joins by an entry point:

    [project.entry-points."jaxsim.sources"]
    acme = "acme_lidar.log:SOURCE"
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path

from jaxsim.data.logs import files, makers, messages, range_images
from jaxsim.data.logs.folder import write_log
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source
from jaxsim.files import files_in, guess, loaded

__all__ = [
    "SOURCES",
    "Item",
    "LogOptions",
    "LogScan",
    "Source",
    "known_sources",
    "source_for",
    "source_table",
    "write_log",
]

_log = logging.getLogger(__name__)

GROUP = "jaxsim.sources"
RECORDINGS = (".pcap", ".osf", ".mcap", ".bag", ".osi")
"""Files that are a whole log: a folder of such is no log."""
SOURCES: dict[str, Source] = files.SOURCES | makers.SOURCES | messages.SOURCES | range_images.SOURCES
"""Every family by its name, those that are told most surely first."""


def known_sources() -> dict[str, Source]:
    """The families here and those of installed packages. Raises ValueError where a package's is no Source."""
    installed: dict[str, Source] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        source = loaded(point, by="frames", what=f"the source {point.name} ({point.value})")
        if not isinstance(source, Source) or point.name in SOURCES:
            raise ValueError(
                f"frames: the entry point {point.name} ({point.value}) must be a Source of a name of its own"
            )
        installed[point.name] = source
    return installed | SOURCES


def source_for(path: Path, kind: str = "") -> tuple[str, Source]:
    """The family of a log: the one that is named, else the first that takes the path; a warning tells of others that
    would take the folder, too. Raises ValueError with all known."""
    known = known_sources()
    names = ", ".join(known)
    if kind:
        if kind not in known:
            raise ValueError(f"frames: no source {kind!r}{guess(kind, known)} Known: {names}")
        return kind, known[kind]
    if not path.exists():
        raise ValueError(f"frames: there is no {path}")
    for name, source in known.items():
        if source.takes(path):
            if path.is_dir():
                _tell_of_others(path, name, known)
            return name, source
    if (path / "grid.json").is_file():
        raise ValueError(
            f"frames: {path} holds polar frames already; --to mcap (osi, rrd, pcd ...) makes clouds of them"
        )
    if recordings := files_in(path, *RECORDINGS):
        raise ValueError(
            f"frames: {path} holds {len(recordings)} recordings, each of which is a log of its own; give one, as "
            f"{recordings[0]}"
        )
    raise ValueError(f"frames: {path} looks like no log that is known; name its kind: --kind {' or '.join(known)}")


def _tell_of_others(path: Path, taken: str, known: Mapping[str, Source]) -> None:
    """Warns where other families than the one that is `taken` would take a folder, too."""
    others = []
    for name, source in known.items():
        with suppress(ValueError):  # a damaged file of theirs
            if name != taken and source.takes(path):
                others.append(name)
    if others:
        _log.warning(
            f"frames: {path} holds logs of several kinds, and {taken} is read; for the other give --kind "
            f"{' or '.join(others)}, and an --out of its own"
        )


def source_table() -> str:
    """A line a family: its name, what it is, and what to install for it."""
    rows = [(name, source.title, source.extra) for name, source in known_sources().items()]
    width = max(len(name) for name, _, _ in rows) + 2
    title = max(len(what) for _, what, _ in rows) + 2
    # Quoted: some shells take the brackets for a pattern.
    install = {extra: f"pip install 'jaxsim-lidar[{extra}]'" if extra else "" for _, _, extra in rows}
    return "\n".join(f"{name:<{width}}{what:<{title}}{install[extra]}".rstrip() for name, what, extra in rows)
