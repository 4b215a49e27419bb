"""Recordings as makers and data sets write them: Ouster, nuScenes, KITTI; and the table of all of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from jaxsim.data.clouds import SENSOR, compensated_spec, read_scan
from jaxsim.data.kitti import SCANS
from jaxsim.data.kitti_files import scan_time
from jaxsim.data.logs.argoverse2 import argoverse2_items
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, reading
from jaxsim.data.logs.velodyne import velodyne_items
from jaxsim.data.semantic_kitti import labels_of, read_point_labels
from jaxsim.data.sweeps import read_lidar_top, read_pcap
from jaxsim.files import files_in
from jaxsim.geometry import preset

_KITTI_COLUMNS = preset("hdl64e").columns
SWEEP_SCALE = 255
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
            yield Item(sweep.name, lambda sweep=sweep: sweep)


def nuscenes_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """The sweeps `*.pcd.bin` of a folder or below it. Raises ValueError for another scale than their intensity's."""
    if options.full_scale not in (None, SWEEP_SCALE):
        raise ValueError(
            f"nuscenes: --log.full-scale is {options.full_scale:g}; the intensity of these sweeps is 0..{SWEEP_SCALE}: "
            "leave it out"
        )
    files = [path] if path.is_file() else sorted(path.rglob("*.pcd.bin"))
    columns = {} if options.columns is None else {"columns": options.columns}
    for file in files:
        yield Item(file.name.removesuffix(".pcd.bin"), lambda file=file: read_lidar_top(file, **columns), (file,))


def kitti_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Scans of KITTI's raw drives, object and odometry benchmarks: every .bin of a `velodyne` folder below.
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
            columns=_KITTI_COLUMNS,
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
    folders = {p.parent for p in path.rglob("*.bin") if not p.name.endswith(".pcd.bin")}
    whole, cropped = SCANS
    files = []
    for folder in sorted(folders):
        if folder.name == cropped and folder.with_name(whole) in folders:
            continue
        drive = next((p.name for p in folder.parents if p.name.endswith(("_sync", "_extract"))), "")
        if not drive and folder.name == "velodyne" and folder.parent.parent.name == "sequences":
            drive = f"sequence_{folder.parent.name}"
        # The object benchmark's testing counts from 0 again.
        prefix = drive or ("testing" if folder.parent.name == "testing" else "")
        for file in files_in(folder, ".bin"):
            name = f"{prefix}-{file.stem}" if prefix else file.stem
            files.append((name, drive or name, file))
    if not files:
        raise ValueError(f"kitti: no .bin under {path}; pass the folder of a drive, of training/velodyne or sequences/")
    return files


def _times_beside(scan: Path) -> Path:
    """The file of a scan's time: timestamps.txt of a raw drive, else times.txt of the odometry benchmark."""
    raw = scan.absolute().parent.parent / "timestamps.txt"
    return raw if raw.is_file() else raw.with_name("times.txt")


def _is_ouster(path: Path) -> bool:
    if path.suffix == ".osf":
        return True
    return path.suffix == ".pcap" and path.with_suffix(".json").is_file()


def _below(path: Path, pattern: str) -> bool:
    return path.is_dir() and next(path.rglob(pattern), None) is not None


SOURCES: dict[str, Source] = {
    "ouster": Source("Ouster: .pcap with its .json, .osf", _is_ouster, ouster_items, "ouster"),
    "velodyne": Source(
        "Velodyne: .pcap", lambda p: p.suffix == ".pcap" and not _is_ouster(p), velodyne_items, "velodyne"
    ),
    "nuscenes": Source(
        "nuScenes: LIDAR_TOP/*.pcd.bin",
        lambda p: p.name.endswith(".pcd.bin") or _below(p, "*.pcd.bin"),
        nuscenes_items,
    ),
    "argoverse2": Source(
        "Argoverse 2: sensors/lidar/*.feather",
        lambda p: p.suffix == ".feather" or _below(p, "sensors/lidar/*.feather"),
        argoverse2_items,
        "argoverse2",
    ),
    "kitti": Source(
        "KITTI raw, object, odometry: velodyne*/**/*.bin",
        lambda p: (p.suffix == ".bin" and not p.name.endswith(".pcd.bin")) or _below(p, "velodyne*/**/*.bin"),
        kitti_items,
    ),
}
