"""Clouds to files that other tools open: KITTI .bin, PCD, PLY, npz, LAS.

A point has its laser line as `ring` (0 the top one) where the cloud has rows, and its `time` in the scan where it is
given; KITTI's .bin has room for neither.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped

from jaxsim.files import need, replacing
from jaxsim.frame import Cloud
from jaxsim.geometry.points import check_points

_Points = Float32[np.ndarray, "n 4"]
_PCD = {"f4": ("F", 4), "u2": ("U", 2)}
_PLY = {"f4": "float", "u2": "ushort"}
_FULL_LAS = 65535


def points_of(cloud: Cloud) -> _Points:
    """The valid points of one unbatched cloud as rows x, y, z (m), intensity (0..1). Raises ValueError for what is no
    such cloud."""
    if not isinstance(cloud, Cloud):
        raise ValueError(
            f"cloud: {type(cloud).__name__} came; give a Cloud (jaxsim.frame): Cloud(xyz_m=points[:, :3], "
            "intensity=points[:, 3], valid=np.ones(len(points), bool))"
        )
    xyz = np.asarray(cloud.xyz_m)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise ValueError(
            f"cloud: expected one cloud of shape (n, 3), got {xyz.shape}; intensity is a field of its own, and a batch "
            "is saved cloud by cloud"
        )
    one = {name: np.asarray(getattr(cloud, name)) for name in ("intensity", "valid")}
    for name, values in one.items():
        if values.shape != xyz.shape[:1] or (name == "valid" and values.dtype != bool):
            kind = "true or false" if name == "valid" else "a number"
            raise ValueError(
                f"cloud: {name} is {values.shape} of {values.dtype} for {len(xyz)} points; give {kind} a point"
            )
    return np.column_stack([xyz, np.asarray(cloud.intensity)]).astype(np.float32)[np.asarray(cloud.valid)]


def table_of(cloud: Cloud, time_s: Float[np.ndarray, " n"] | None = None) -> np.ndarray:
    """The valid points as records x, y, z, intensity, and ring and time where they are known.

    Raises ValueError as `points_of`, and for rows and times that are not one a point, no whole numbers of a file's
    ring, or not finite.
    """
    points, valid = points_of(cloud), np.asarray(cloud.valid)
    known = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
    known += [] if cloud.row is None else [("ring", "<u2")]
    known += [] if time_s is None else [("time", "<f4")]
    table = np.empty(len(points), known)
    for k, name in enumerate(("x", "y", "z", "intensity")):
        table[name] = points[:, k]
    if cloud.row is not None:
        row = _of_points(cloud.row, valid, kinds="iu", what="row", right="a whole number")
        if len(row) and not (row.min() >= 0 and row.max() < 2**16):
            raise ValueError(f"cloud: rows span {row.min()}..{row.max()}; a file's ring is 0 to 65535: leave rows out")
        table["ring"] = row
    if time_s is not None:
        time = _of_points(time_s, valid, kinds="fiu", what="time_s", right="seconds")
        if not np.isfinite(time).all():
            raise ValueError(
                f"cloud: time_s is NaN or infinite in {int((~np.isfinite(time)).sum())} of {len(time)} points; give "
                "seconds, or leave it out"
            )
        table["time"] = time
    return table


def _of_points(
    values: Any, valid: Bool[np.ndarray, " n"], *, kinds: str, what: str, right: str
) -> Shaped[np.ndarray, " m"]:
    """The values of the valid points. Raises ValueError where they are not one a point, or of another kind."""
    given = np.asarray(values)
    if given.shape != valid.shape or given.dtype.kind not in kinds:
        raise ValueError(
            f"cloud: {what} is {given.shape} of {given.dtype} for {len(valid)} points; give {right} a point, or leave "
            "it out"
        )
    return given[valid]


def _bin(table: np.ndarray, file: BinaryIO) -> None:
    file.write(np.stack([table[name] for name in ("x", "y", "z", "intensity")], axis=1).astype("<f4").tobytes())


def _pcd(table: np.ndarray, file: BinaryIO) -> None:
    names, count = table.dtype.names or (), len(table)
    # A dtype's `str` begins with its byte order.
    kinds = [_PCD[table.dtype[name].str[1:]] for name in names]
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(names)}\n"
        f"SIZE {' '.join(str(size) for _, size in kinds)}\nTYPE {' '.join(kind for kind, _ in kinds)}\n"
        f"COUNT {' '.join('1' for _ in names)}\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\n"
        "DATA binary\n"
    )
    # NumPy packs records without padding, as the header says.
    file.write(header.encode() + table.tobytes())


def _ply(table: np.ndarray, file: BinaryIO) -> None:
    names = table.dtype.names or ()
    fields = "".join(f"property {_PLY[table.dtype[name].str[1:]]} {name}\n" for name in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{fields}end_header\n"
    file.write(header.encode() + table.tobytes())


def _npz(table: np.ndarray, file: BinaryIO) -> None:
    xyz = np.stack([table[axis] for axis in "xyz"], axis=1)
    per_point: dict[str, Any] = {name: table[name] for name in ("ring", "time") if name in (table.dtype.names or ())}
    np.savez_compressed(file, xyz=xyz, intensity=table["intensity"], **per_point)


def _las(table: np.ndarray, file: BinaryIO) -> None:
    """LAS 1.4, in millimetres and intensities of 16 bits; the ring is an extra dimension, the time is `gps_time`."""
    laspy = need("laspy", "las", by="cloud")
    # Format 6: the plainest of LAS 1.4 that has a time a point.
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-3)
    names = table.dtype.names or ()
    if "ring" in names:
        header.add_extra_dim(laspy.ExtraBytesParams(name="ring", type=np.uint16))
    data = laspy.LasData(header)
    data.x = table["x"].astype(np.float64)
    data.y = table["y"].astype(np.float64)
    data.z = table["z"].astype(np.float64)
    data.intensity = np.round(np.clip(table["intensity"], 0, 1) * _FULL_LAS).astype(np.uint16)
    if "ring" in names:
        data["ring"] = table["ring"]
    if "time" in names:
        data.gps_time = table["time"].astype(np.float64)
    data.write(file)


FORMATS: dict[str, Callable[[np.ndarray, BinaryIO], None]] = {
    ".bin": _bin,
    ".pcd": _pcd,
    ".ply": _ply,
    ".npz": _npz,
    ".las": _las,
}


def save_cloud(path: Path | str, cloud: Cloud, *, time_s: Float[np.ndarray, " n"] | None = None) -> Path:
    """Writes the valid points of one cloud; the suffix chooses the format.

    `.bin` is KITTI's velodyne format (float32 x, y, z, intensity); `.pcd` is PCD 0.7 binary; `.ply` is binary
    little endian; `.npz` holds `xyz` and `intensity`; `.las` is LAS 1.4 (extra las). All but `.bin` have `ring` where
    the cloud has rows, and `time` (s) where `time_s` is given.

    Raises ValueError for another suffix, and for what readers refuse (`check_points`): points that are not finite or
    beyond what any LiDAR sees, intensity beyond 0..1. Warns of a cloud without points, which they refuse, too.
    """
    path = Path(path)
    write = FORMATS.get(path.suffix.lower())
    if write is None:
        raise ValueError(f"cloud: no format for {path.name!r}; known suffixes: {', '.join(FORMATS)}")
    table = table_of(cloud, time_s)
    if len(table):
        check_points(points_of(cloud), f"cloud: {path.name}")
    else:
        # It may be the truth, and where clouds are written one after the other the next ones are wanted.
        warnings.warn(f"cloud: {path.name} holds no points: no reader here takes it", stacklevel=2)
    with replacing(path) as temporary, temporary.open("wb") as file:
        write(table, file)
    return path
