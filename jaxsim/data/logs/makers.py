"""Recordings as makers and data sets write them: Ouster, Velodyne, nuScenes, Argoverse 2, KITTI; and their table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from io import BufferedReader, FileIO
from pathlib import Path

import numpy as np

from jaxsim.data.clouds import SENSOR, compensated_spec, read_scan
from jaxsim.data.kitti import SCANS
from jaxsim.data.kitti_files import scan_time
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, offsets, reading, scan_of_fields
from jaxsim.data.point_labels import labels_of, read_point_labels
from jaxsim.data.sweeps import read_lidar_top, read_pcap
from jaxsim.files import files_below, files_in, need

_VELODYNE_BYTES = 1206
_LARGEST_PACKET = 2**18
"""libpcap's own limit."""
_WHOLE_TURN = 0.95
"""Share of the firings of the turn before that the last turn of a recording has where it is whole."""
_UPPER_LASERS = 32
"""Of Argoverse 2: those below are the upper sensor's."""
_SWEEP_SCALE = 255
"""nuScenes' intensity at its top."""


def ouster_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The whole turns of a .pcap (with its .json), .osf or bag, through ouster-sdk."""
    sweeps = read_pcap(
        path,
        meta=options.meta,
        intensity=options.intensity or "reflectivity",
        full_scale=options.full_scale,
        returns=options.returns,
    )
    with reading("ouster", path, "copy it again, or record with a profile that ouster-sdk reads"):
        for sweep in sweeps:
            yield Item.of(sweep)


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
                yield Item.of(last)
            before, last = last, scan
    if last is None:
        raise ValueError(
            f"velodyne: {path} holds no packet of a Velodyne sensor ({_VELODYNE_BYTES} bytes each); an Ouster's .pcap "
            "is read with the sensor's .json, of the same name beside it, or --log.meta"
        )
    is_partial = packets.is_cut if before is None else _firings(last) < _WHOLE_TURN * _firings(before)
    yield Item.of(replace(last, is_partial=is_partial))


def _velodyne_scans(path: Path, packets: _Packets, options: LogOptions) -> Iterator[LogScan]:
    decoder = need("velodyne_decoder", "velodyne", by="velodyne")
    config = decoder.Config()
    if options.meta is not None:
        config.calibration = decoder.Calibration.read(str(options.meta))
    for number, (stamp, points) in enumerate(decoder.read_pcap(packets, config, as_pcl_structs=True)):
        points = points[_fired(points)]
        name = f"{path.stem}-{number:06d}"
        yield scan_of_fields(
            {field: points[field] for field in points.dtype.names},
            options,
            by="velodyne",
            where=name,
            name=name,
            scene=path.stem,
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


def nuscenes_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The sweeps `*.pcd.bin` of a folder or below it. Raises ValueError for another scale than their intensity's."""
    if options.full_scale not in (None, _SWEEP_SCALE):
        raise ValueError(
            f"nuscenes: --log.full-scale is {options.full_scale:g}; the intensity of these sweeps is "
            f"0..{_SWEEP_SCALE}: leave it out"
        )
    files = [path] if path.is_file() else sorted(files_below(path, ".pcd.bin"))
    columns = {} if options.columns is None else {"columns": options.columns}
    for file in files:
        yield Item(file.name.removesuffix(".pcd.bin"), lambda file=file: read_lidar_top(file, **columns), (file,))


def argoverse2_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Sweeps `sensors/lidar/*.feather` of a log: one of its two stacked sensors, in the frame of that sensor.

    The log's clouds lie in the car's frame with the car's motion taken out; where city_SE3_egovehicle.feather is there,
    each point goes back to where the sensor saw it. Lasers 0..31 are the upper sensor's (the default), 32..63 the
    lower one's, which hangs upside down (--log.rings 32-63). Where on the car it stands is told from its beams.
    """
    need("pyarrow", "argoverse2", by="argoverse2")
    files = [path] if path.is_file() else sorted(filter(_is_sweep, files_below(path, ".feather")))
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


def kitti_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Scans of KITTI's raw drives, object, odometry and tracking benchmarks: every .bin of a `velodyne` folder below.
    SemanticKITTI's labels beside them become classes and objects. A point is of the nearest beam where the sensor was
    named, else of the line that its place in the file says."""
    files = kitti_files(path)
    if options.sensor not in ("", SENSOR):
        raise ValueError(f"kitti: --log.sensor is {options.sensor!r}; these scans are of {SENSOR}")
    rows = "elevation" if options.sensor or options.lines else "file_order"

    def read(file: Path, *, name: str, scene: str) -> LogScan:
        time_s = scan_time(_times_beside(file), int(file.stem)) if file.stem.isdecimal() else None
        cloud = read_scan(file, rows)
        labels = labels_of(file)
        layers: dict[str, np.ndarray] = {}
        if labels.is_file():
            layers["semantic"], layers["instance"] = read_point_labels(labels, len(cloud.xyz_m))
        return LogScan(
            name=name,
            scene=scene,
            xyz_m=np.asarray(cloud.xyz_m),
            intensity=np.asarray(cloud.intensity),
            ring=np.asarray(cloud.row).astype(np.int64),
            time_s=time_s,
            full_scale=1.0,
            spec=compensated_spec(files[0][2], rows),
            layers=layers,
        )

    for name, scene, file in files:
        yield Item(name, partial(read, file, name=name, scene=scene), (file, labels_of(file), _times_beside(file)))


def kitti_files(path: Path) -> list[tuple[str, str, Path]]:
    """Name, drive and file of every scan under a folder; the drive of a scan that is of none is its name. Of the object
    benchmark's scans those that are cropped to the image are left out where the whole ones are there.

    Raises ValueError where there is none.
    """
    if path.is_file():
        return [(path.stem, path.stem, path)]
    folders = {p.parent for p in files_below(path, ".bin") if not p.name.endswith(".pcd.bin")}
    whole, cropped = SCANS
    files = []
    for folder in sorted(folders):
        if folder.name == cropped and folder.with_name(whole) in folders:
            continue
        drive = _drive_of(folder.absolute())
        # The object benchmark's testing counts from 0 again.
        prefix = drive or ("testing" if folder.absolute().parent.name == "testing" else "")
        for file in files_in(folder, ".bin"):
            name = f"{prefix}-{file.stem}" if prefix else file.stem
            files.append((name, drive or name, file))
    if not files:
        raise ValueError(f"kitti: no .bin under {path}; pass the folder of a drive, of training/velodyne or sequences/")
    return files


def _drive_of(scans: Path) -> str:
    """The drive, or the sequence, of a folder of scans; empty where each is for itself, as in the object benchmark."""
    above, top = scans.parents[:2]
    for one in (above, top):
        if one.name.endswith(("_sync", "_extract")):
            return one.name
    if scans.name == "velodyne" and top.name == "sequences":
        return f"sequence_{above.name}"
    if above.name == "velodyne":  # tracking: velodyne/0000; its testing counts from 0 again
        return f"testing_{scans.name}" if top.name == "testing" else scans.name
    return ""


def _times_beside(scan: Path) -> Path:
    """The file of a scan's time: timestamps.txt of a raw drive, else times.txt of the odometry benchmark."""
    raw = scan.absolute().parent.parent / "timestamps.txt"
    return raw if raw.is_file() else raw.with_name("times.txt")


def _is_ouster(path: Path) -> bool:
    if path.suffix.lower() == ".osf":
        return True
    return path.suffix.lower() == ".pcap" and path.with_suffix(".json").is_file()


def _is_kitti(path: Path) -> bool:
    if not path.is_dir():
        return path.suffix.lower() == ".bin" and not path.name.endswith(".pcd.bin")
    # The folder of the scans itself is one, too: `velodyne`, or a raw drive's `velodyne_points/data`.
    return any(
        one.name.startswith("velodyne")
        for file in files_below(path, ".bin")
        for one in (file.absolute().parent, file.absolute().parent.parent)
    )


def _is_sweep(file: Path) -> bool:
    """Whether a table of Argoverse 2 is a sweep: others of its log have the same ending."""
    return file.parent.name == "lidar" and file.parent.parent.name == "sensors"


SOURCES: dict[str, Source] = {
    "ouster": Source("Ouster: .pcap with its .json, .osf", _is_ouster, ouster_items, "ouster"),
    "velodyne": Source(
        "Velodyne: .pcap", lambda p: p.suffix.lower() == ".pcap" and not _is_ouster(p), velodyne_items, "velodyne"
    ),
    "nuscenes": Source(
        "nuScenes: LIDAR_TOP/*.pcd.bin",
        lambda p: any(True for _ in files_below(p, ".pcd.bin")) if p.is_dir() else p.name.endswith(".pcd.bin"),
        nuscenes_items,
    ),
    "argoverse2": Source(
        "Argoverse 2: sensors/lidar/*.feather",
        lambda p: any(map(_is_sweep, files_below(p, ".feather"))) if p.is_dir() else p.suffix.lower() == ".feather",
        argoverse2_items,
        "argoverse2",
    ),
    "kitti": Source(
        "KITTI raw, object, odometry, tracking: velodyne*/**/*.bin",
        _is_kitti,
        kitti_items,
    ),
}
