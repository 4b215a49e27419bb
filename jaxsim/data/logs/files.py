"""Clouds in files of general formats, one scan a file: PCD, PLY, LAS and LAZ. Also CARLA's raw buffers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from os import SEEK_END
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.data import carla
from jaxsim.data.cityscapes import IDS
from jaxsim.data.logs.scan import Item, LogOptions, LogScan, Source, reading, scan_of_fields
from jaxsim.files import check_size, files_in, need, parse_number, read_json
from jaxsim.geometry import LidarSpec
from jaxsim.geometry.points import FAR_M, check_end

MOST_POINTS = 2**23
"""Of a scan: four times those of the densest sensors."""
MOST_BEAMS, MOST_COLUMNS = 1024, 2**16
_LAS_SCALE = 65535.0
_RECORD_BYTES = 54
"""Of a LAS record's own header, the least that one takes."""
_SEMANTIC = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("cos", "<f4"), ("idx", "<u4"), ("tag", "<u4")])
"""CARLA's sensor.lidar.ray_cast_semantic, 24 bytes a point (carla.SemanticLidarDetection)."""
_RAY_CAST = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
"""CARLA's sensor.lidar.ray_cast, 16 bytes a point (carla.LidarDetection)."""
ATTENUATION_PER_M = 0.004
"""CARLA's default atmosphere_attenuation_rate."""

Read = Callable[[Path, LogOptions], LogScan]


def _items(suffixes: tuple[str, ...], read: Read, by: str) -> Callable[[Path, LogOptions], Iterator[Item]]:
    """Items of a family with one scan a file: the files of a folder, or one file. The folder is the scene."""

    def items(path: Path, options: LogOptions) -> Iterator[Item]:
        files = files_in(path, *suffixes) if path.is_dir() else [path]
        if not files:
            raise ValueError(f"{by}: no {' or '.join(suffixes)} in {path}")
        for file in files:
            # Beside it CARLA's description of the sensor, where there is one.
            yield Item(file.stem, partial(read, file, options), (file, file.parent / "attributes.json"))

    return items


def read_pcd(file: Path, options: LogOptions) -> LogScan:
    """A PCD of any encoding, organised or not."""
    pcd = need("pypcd4", "pcd", by="pcd")
    with reading("pcd", file, "it is cut off, or no PCD; write it again"):
        cloud = pcd.PointCloud.from_path(file)
        data, about = cloud.pc_data, cloud.metadata
        names = data.dtype.names or ()
        if len(data) != about.points or about.width * about.height != about.points:
            raise ValueError(f"its header promises {about.width} x {about.height} points, {len(data)} are there")
        values = {name: np.asarray(data[name]) for name in names}
        check_end([*values.values()], record_bytes=data.dtype.itemsize)
    shape = (about.height, about.width) if about.height > 1 else None
    return scan_of_fields(values, options, by="pcd", where=str(file), name=file.stem, scene=_scene(file), shape=shape)


def read_ply(file: Path, options: LogOptions) -> LogScan:
    """The vertices of a PLY, ascii or binary of either byte order."""
    ply = need("plyfile", "ply", by="ply")
    with reading("ply", file, "it is cut off, or no PLY; write it again"):
        data = ply.PlyData.read(str(file))
        if "vertex" not in data:
            raise ValueError("it has no element vertex")
        vertex = data["vertex"].data
        # Files of either byte order: from here on the machine's own.
        values = {name: vertex[name].astype(vertex[name].dtype.newbyteorder("=")) for name in vertex.dtype.names or ()}
        check_end([*values.values()], record_bytes=vertex.dtype.itemsize)
    return scan_of_fields(values, options, by="ply", where=str(file), name=file.stem, scene=_scene(file))


def _check_records(file: Path) -> None:
    """Raises ValueError where a LAS promises more variable length records than lie before its points: laspy would look
    for all of them, for minutes."""
    with file.open("rb") as raw:
        head = raw.read(104)
    if len(head) < 104:
        raise ValueError("its header is cut off")
    size = int.from_bytes(head[94:96], "little")
    points = int.from_bytes(head[96:100], "little")
    records = int.from_bytes(head[100:104], "little")
    if records * _RECORD_BYTES > max(points - size, 0):
        raise ValueError(f"its header promises {records} records in {points - size} bytes")


def _check_promises(file: Path, header: Any) -> None:
    """Raises ValueError where a LAS promises more points than a scan has, or a LAZ more chunks than points: lazrs, for
    want of memory, would end the program."""
    if header.point_count > MOST_POINTS:
        raise ValueError(f"its header promises {header.point_count} points, and a scan has at most {MOST_POINTS}")
    if not header.are_points_compressed:
        return
    with file.open("rb") as raw:
        raw.seek(header.offset_to_point_data)
        table = int.from_bytes(raw.read(8), "little", signed=True)
        if table < 0:  # written by a program that could not go back: its place is the file's end
            raw.seek(-8, SEEK_END)
            table = int.from_bytes(raw.read(8), "little")
        raw.seek(table + 4)
        if (chunks := int.from_bytes(raw.read(4), "little")) > header.point_count:
            raise ValueError(f"it promises {chunks} chunks of {header.point_count} points")


def read_las(file: Path, options: LogOptions) -> LogScan:
    """A LAS or LAZ; the ring is an extra dimension (ring, laser_number ...)."""
    laspy = need("laspy", "las", by="las")
    with reading("las", file, "it is cut off, or no LAS; copy it again (.laz needs lazrs, in the extra, too)"):
        _check_records(file)
        # One thread: it reads what it finds, where several make room for the sizes in the table of chunks.
        with laspy.open(str(file), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as opened:
            _check_promises(file, opened.header)
            data = opened.read()
        # As they are written: offset and scale make a place of a zero.
        check_end([data.X, data.Y, data.Z], record_bytes=data.point_format.size)
        names = list(data.point_format.dimension_names)
        values = {name: np.asarray(data[name]) for name in names if name not in ("X", "Y", "Z")}
        values |= {axis: np.asarray(getattr(data, axis)) for axis in "xyz"}
        promised = int(data.header.point_count)
    if promised != len(values["x"]):
        raise ValueError(f"las: {file} promises {promised} points and has {len(values['x'])}; copy it again")
    # The standard scales intensity to 16 bits; many writers leave 0..255.
    largest = float(values["intensity"].max(initial=0)) if "intensity" in values else 0.0
    scale = _LAS_SCALE if largest > 255 else 255.0
    path, name = str(file), file.stem
    return scan_of_fields(values, options, by="las", where=path, name=name, scene=_scene(file), full_scale=scale)


def read_carla(file: Path, options: LogOptions) -> LogScan:
    """A buffer `raw_data` of CARLA's ray_cast (16 bytes a point) or ray_cast_semantic (24), as bytes in a file.

    `attributes.json` beside it holds the sensor's attributes, `json.dump(dict(lidar.attributes), ...)`: its type tells
    one buffer from the other, its channels and field of view the beams. The semantic sensor measures no intensity: it
    gets the one that CARLA's ray_cast would give, exp(-0.004 range). The points' y is turned to the left.

    Source: CARLA's sensor reference; https://carla.readthedocs.io/en/latest/ref_sensors/#lidar-sensor
    """
    where = options.meta or file.parent / "attributes.json"
    about = _attributes(where)
    semantic = "semantic" in about["type"]
    dtype = _SEMANTIC if semantic else _RAY_CAST
    check_size(file, by="carla", most=MOST_POINTS * dtype.itemsize)
    raw = file.read_bytes()
    if not raw or len(raw) % dtype.itemsize:
        raise ValueError(
            f"carla: {file} has {len(raw)} bytes, no whole number of points of {about['type']} ({dtype.itemsize} bytes "
            "each): cut off, or of the other LiDAR; write bytes(measurement.raw_data)"
        )
    points = np.frombuffer(raw, dtype)
    if not all(np.isfinite(points[axis]).all() for axis in (dtype.names or ())[:4]):
        raise ValueError(f"carla: {file} has points that are NaN or infinite; write bytes(measurement.raw_data)")
    xyz = carla.mirror_y(np.stack([points[axis] for axis in "xyz"], axis=1))
    spec = _carla_spec(about, where)
    layers: dict[str, np.ndarray] = {}
    if semantic:
        tags = carla.tags_of(options.version)
        if points["tag"].max(initial=0) >= len(tags):
            raise ValueError(
                f"carla: {file} has tags up to {points['tag'].max()}; CARLA {options.version} has {len(tags)}"
            )
        classes = np.array([IDS[name] for name in tags], np.int32)[points["tag"]]
        layers = {
            "incidence": np.arccos(np.clip(np.abs(points["cos"]), 0, 1)).astype(np.float32),
            "semantic": classes,
            "instance": np.where(np.isin(classes, carla.THINGS), points["idx"], 0).astype(np.int32),
        }
        rate = _attribute(about, "atmosphere_attenuation_rate", where, span=(0, 10), default=ATTENUATION_PER_M)
        intensity = np.exp(-rate * np.linalg.norm(xyz, axis=1)).astype(np.float32)
    else:
        intensity = points["intensity"].astype(np.float32)
    elevation = np.rad2deg(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    # The beams lie evenly: the nearest is exact but for the noise that ray_cast adds along the ray.
    even = np.asarray(spec.elevation_deg)
    ring = np.round((even[0] - elevation) / (even[0] - even[-1]) * (spec.rows - 1)).astype(np.int64)
    off = float(np.abs(elevation - even[np.clip(ring, 0, spec.rows - 1)]).max(initial=0))
    if off > (even[0] - even[-1]) / (spec.rows - 1) / 4 + 1e-3:
        raise ValueError(
            f"carla: points of {file} lie {off:.2f} degrees off the beams of attributes.json; is it this sensor's?"
        )
    return LogScan(
        name=file.stem,
        scene=_scene(file),
        xyz_m=xyz.astype(np.float32),
        intensity=intensity,
        ring=ring,
        full_scale=1.0,
        spec=spec,
        columns=spec.columns,
        layers=layers,
    )


def _attributes(path: Path) -> dict[str, str]:
    if not path.is_file():
        raise ValueError(
            f"carla: there is no {path}; write the sensor's attributes beside its buffers: "
            "json.dump(dict(lidar.attributes) | {'type': lidar.type_id}, open('attributes.json', 'w'))"
        )
    about = read_json(path, by="carla", hint="write dict(lidar.attributes)")
    needed = ("type", "channels", "upper_fov", "lower_fov", "points_per_second", "rotation_frequency", "range")
    if not isinstance(about, dict) or (missing := [key for key in needed if key not in about]):
        lacking = ", ".join(missing) if isinstance(about, dict) else "everything"
        raise ValueError(f"carla: {path} lacks {lacking}; write dict(lidar.attributes) | {{'type': lidar.type_id}}")
    return {key: str(value) for key, value in about.items()}


def _attribute(
    about: dict[str, str], key: str, where: Path, *, span: tuple[float, float], default: float | None = None
) -> float:
    """A number of the attributes. Raises ValueError where it is none, or outside of `span`."""
    low, high = span
    value = parse_number(about.get(key, str(default)), float, where=f"carla: {where}: {key}")
    if not low <= value <= high:
        raise ValueError(f"carla: {where}: {key} is {value:g}; it must lie in {low:g}..{high:g}")
    return value


def _carla_spec(about: dict[str, str], where: Path) -> LidarSpec:
    """CARLA spaces its channels evenly from upper_fov to lower_fov; a channel fires points_per_second over channels."""
    channels = int(_attribute(about, "channels", where, span=(2, MOST_BEAMS)))
    upper = _attribute(about, "upper_fov", where, span=(-90, 90))
    lower = _attribute(about, "lower_fov", where, span=(-90, 90))
    rate = _attribute(about, "points_per_second", where, span=(1, 1e9))
    turn = rate / channels / _attribute(about, "rotation_frequency", where, span=(0.01, 1e4))
    if not lower < upper or turn > MOST_COLUMNS:
        raise ValueError(
            f"carla: {where}: beams from {upper:g} down to {lower:g} degrees with {turn:g} points a turn are no "
            "sensor's; write dict(lidar.attributes)"
        )
    return LidarSpec(
        name="carla",
        elevation_deg=tuple(float(e) for e in np.linspace(upper, lower, channels)),
        origin_m=(0.0,) * channels,
        columns=max(round(turn), 2),
        min_range_m=0.0,
        max_range_m=_attribute(about, "range", where, span=(0.1, FAR_M)),
    )


def _scene(file: Path) -> str:
    return file.parent.name or file.stem


def _has(*suffixes: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.lower() in suffixes or (path.is_dir() and bool(files_in(path, *suffixes)))


def _is_carla(path: Path) -> bool:
    return any("sensor.lidar" in json.dumps(read_json(one, by="carla", hint="write it again")) for one in _about(path))


def _about(path: Path) -> list[Path]:
    """attributes.json of a CARLA recording: its own, or of a folder of recordings those of all."""
    description = (path if path.is_dir() else path.parent) / "attributes.json"
    return [description] if description.is_file() else sorted(path.glob("*/attributes.json"))


def _carla_items(path: Path, options: LogOptions) -> Iterator[Item]:
    """Buffers of one recording; or of a folder of recordings, each a scene, whose frames are named SCENE_FRAME.

    Raises ValueError where recordings are not of one sensor: their frames could not lie on one grid.
    """
    places = _about(path)
    if len(places) < 2:
        yield from _items(_RAW, read_carla, "carla")(places[0].parent if places and path.is_dir() else path, options)
        return
    described = [options.meta or attributes_file for attributes_file in places]
    first, *others = [(about, _carla_spec(_attributes(about), about)) for about in described]
    for attributes_file, spec in others:
        if spec != first[1]:
            raise ValueError(
                f"carla: {first[0]} and {attributes_file} are of different sensors (channels, field of view, points a "
                "turn, range); write each sensor to a folder of its own"
            )
    for attributes_file in places:
        for file in files_in(attributes_file.parent, *_RAW):
            name = f"{attributes_file.parent.name}_{file.stem}"
            read = partial(read_carla, file, options)
            yield Item(name, lambda read=read, name=name: replace(read(), name=name), (file, attributes_file))


_RAW = (".raw", ".bin")
SOURCES: dict[str, Source] = {
    "carla": Source("CARLA: raw_data of ray_cast and ray_cast_semantic", _is_carla, _carla_items),
    "pcd": Source("PCD: ascii, binary, compressed", _has(".pcd"), _items((".pcd",), read_pcd, "pcd"), "pcd"),
    "ply": Source("PLY", _has(".ply"), _items((".ply",), read_ply, "ply"), "ply"),
    "las": Source("LAS, LAZ", _has(".las", ".laz"), _items((".las", ".laz"), read_las, "las"), "las"),
}
