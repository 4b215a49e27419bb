"""Recordings of Velodyne's packets, through velodyne-decoder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import BufferedReader, FileIO
from pathlib import Path

import numpy as np

from jaxsim.data.logs.scan import Item, LogOptions, LogScan, offsets, reading
from jaxsim.files import need

_VELODYNE_BYTES = 1206
_LARGEST_PACKET = 2**18
"""libpcap's own limit."""
_WHOLE_TURN = 0.95
"""Share of the firings of the turn before that the last turn of a recording has where it is whole."""


def velodyne_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The turns of a .pcap of Velodyne's packets, through velodyne-decoder. The last one is partial where it has
    clearly fewer firings than the one before; a turn alone, where the file ends within a packet."""
    hint = "copy it again; an HDL-64E needs --log.meta calibration.yml"
    before: LogScan | None = None
    last: LogScan | None = None
    with reading("velodyne", path, hint), _Packets(FileIO(path)) as packets:
        # The decoder's turns begin where the recording does, so the last one alone can be partial.
        for scan in _velodyne_scans(path, packets, options):
            if last is not None:
                yield Item(last.name, lambda scan=last: scan)
            before, last = last, scan
    if last is None:
        raise ValueError(f"velodyne: {path} holds no packet of a Velodyne sensor ({_VELODYNE_BYTES} bytes each)")
    is_partial = packets.is_cut if before is None else _firings(last) < _WHOLE_TURN * _firings(before)
    scan = replace(last, is_partial=is_partial)
    yield Item(scan.name, lambda: scan)


def _velodyne_scans(path: Path, packets: _Packets, options: LogOptions) -> Iterator[LogScan]:
    decoder = need("velodyne_decoder", "velodyne", by="velodyne")
    config = decoder.Config()
    if options.meta is not None:
        config.calibration = decoder.Calibration.read(str(options.meta))
    for number, (stamp, points) in enumerate(decoder.read_pcap(packets, config, as_pcl_structs=True)):
        points = points[_fired(points)]
        yield LogScan(
            name=f"{path.stem}-{number:06d}",
            scene=path.stem,
            xyz_m=np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float32),
            intensity=points["intensity"].astype(np.float32),
            ring=points["ring"].astype(np.int64),
            offset_s=offsets(points["time"]),
            time_s=float(getattr(stamp, "host", stamp)),
            full_scale=255.0,
        )


def _firings(scan: LogScan) -> int:
    return 0 if scan.offset_s is None else len(np.unique(scan.offset_s))


class _Packets(BufferedReader):
    """A recording for a library that makes room for whatever length a packet's header promises, and that takes what
    is left of a packet for its end."""

    is_cut = False
    """Whether the file ended within a packet."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _LARGEST_PACKET:
            raise ValueError(f"a packet's header promises {size} bytes; it is damaged")
        content = super().read(size)
        self.is_cut |= size is not None and 0 < len(content) < size
        return content


def _fired(points: np.ndarray) -> np.ndarray:
    """Which points lie where they were fired at: not those that the decoder puts between the end of the sensor's window
    and its begin, since it interpolates azimuths to the next packet. The mirror does not turn three times as fast.
    """
    order = np.lexsort((points["time"], points["ring"]))
    azimuth = np.arctan2(points["y"], points["x"]).astype(np.float64)[order]
    time_s, ring = points["time"].astype(np.float64)[order], points["ring"][order]
    turned = np.abs((np.diff(azimuth) + np.pi) % (2 * np.pi) - np.pi)
    rate = turned / np.maximum(np.diff(time_s), 1e-6)
    same = (np.diff(ring) == 0) & (np.diff(time_s) > 1e-6)
    fast = same & (rate > 3 * np.median(rate[same])) if same.any() else same
    fired = np.ones(len(points), bool)
    fired[order[1:][fast]] = False
    return fired
