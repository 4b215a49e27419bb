"""Recordings as makers and data sets write them: Ouster, nuScenes, KITTI; and the table of all of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from jaxsim.data.clouds import compensated_spec, read_scan
from jaxsim.data.logs.argoverse2 import argoverse2_items
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, reading
from jaxsim.data.logs.velodyne import velodyne_items
from jaxsim.data.semantic_kitti import labels_of, read_point_labels
from jaxsim.data.sweeps import read_lidar_top, read_pcap
from jaxsim.files import files_in, numbers, placed, read_text
from jaxsim.geometry import preset

_KITTI_COLUMNS = preset("hdl64e").columns


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
    """The sweeps `*.pcd.bin` of a folder or below it."""
    files = [path] if path.is_file() else sorted(path.rglob("*.pcd.bin"))
    columns = {} if options.columns is None else {"columns": options.columns}
    for file in files:
        yield Item(file.name.removesuffix(".pcd.bin"), lambda file=file: read_lidar_top(file, **columns), (file,))


def kitti_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Scans of KITTI's raw drives, object and odometry benchmarks: every .bin of a `velodyne` folder below.
    SemanticKITTI's labels beside them become classes and objects."""
    files = kitti_files(path)
    rows = "elevation" if options.lines else "file_order"

    def read(file: Path, *, name: str, scene: str, time_s: float | None) -> LogScan:
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

    for name, scene, file, time_s in files:
        yield Item(name, partial(read, file, name=name, scene=scene, time_s=time_s), (file, labels_of(file)))


def kitti_files(path: Path) -> list[tuple[str, str, Path, float | None]]:
    """Name, drive, file and time of every scan under a folder. Raises ValueError where there is none."""
    if path.is_file():
        return [(path.stem, path.stem, path, None)]
    folders = sorted({p.parent for p in path.rglob("*.bin") if not p.name.endswith(".pcd.bin")})
    files = []
    for folder in folders:
        drive = next((p.name for p in folder.parents if p.name.endswith(("_sync", "_extract"))), "")
        if not drive and folder.name == "velodyne" and folder.parent.parent.name == "sequences":
            drive = f"sequence_{folder.parent.name}"
        times = _times(folder)
        for number, file in enumerate(files_in(folder, ".bin")):
            name = f"{drive}-{file.stem}" if drive else file.stem
            files.append((name, drive or file.stem, file, times[number] if number < len(times) else None))
    if not files:
        raise ValueError(f"kitti: no .bin under {path}; pass the folder of a drive, of training/velodyne or sequences/")
    return files


def _times(folder: Path) -> list[float]:
    """Seconds of a drive's scans: timestamps.txt of raw drives, times.txt of odometry."""
    raw, odometry = folder.parent / "timestamps.txt", folder.parent / "times.txt"
    if raw.is_file():
        stamps = [line.strip().replace(" ", "T") for line in read_text(raw, by="kitti").splitlines() if line.strip()]
        with placed(f"kitti: {raw} holds what is no time", then="copy it again"):
            return (np.array(stamps, "datetime64[ns]").astype(np.int64) / 1e9).tolist()
    return numbers(read_text(odometry, by="kitti").split(), where=f"kitti: {odometry}") if odometry.is_file() else []


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
