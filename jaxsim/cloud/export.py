"""Clouds to files that other tools open: KITTI .bin, PCD, PLY, npz."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32

from jaxsim.files import replacing
from jaxsim.frame import Cloud

Points = Float32[np.ndarray, "n 4"]


def points_of(cloud: Cloud) -> Points:
    """The valid points of one unbatched cloud as rows x, y, z (m), intensity (0..1)."""
    xyz = np.asarray(cloud.xyz_m)
    if xyz.ndim != 2:
        raise ValueError(f"cloud: expected one cloud of shape (n, 3), got {xyz.shape}; save a batch cloud by cloud")
    return np.column_stack([xyz, np.asarray(cloud.intensity)]).astype(np.float32)[np.asarray(cloud.valid)]


def _bin(points: Points, file: BinaryIO) -> None:
    file.write(points.astype("<f4").tobytes())


def _pcd(points: Points, file: BinaryIO) -> None:
    count = len(points)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\n"
        f"TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    file.write(header.encode() + points.astype("<f4").tobytes())


def _ply(points: Points, file: BinaryIO) -> None:
    fields = "".join(f"property float {name}\n" for name in ("x", "y", "z", "intensity"))
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{fields}end_header\n"
    file.write(header.encode() + points.astype("<f4").tobytes())


def _npz(points: Points, file: BinaryIO) -> None:
    np.savez_compressed(file, xyz=points[:, :3], intensity=points[:, 3])


FORMATS: dict[str, Callable[[Points, BinaryIO], None]] = {".bin": _bin, ".pcd": _pcd, ".ply": _ply, ".npz": _npz}


def save_cloud(path: Path | str, cloud: Cloud) -> Path:
    """Writes the valid points of one cloud; the suffix chooses the format.

    `.bin` is KITTI's velodyne format (float32 x, y, z, intensity); `.pcd` is PCD 0.7 binary; `.ply` is binary
    little endian; `.npz` holds `xyz` and `intensity`. Raises ValueError for another suffix.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise ValueError(f"cloud: no format for {path.name!r}; known suffixes: {', '.join(FORMATS)}")
    points = points_of(cloud)
    with replacing(path) as temporary, temporary.open("wb") as file:
        FORMATS[path.suffix](points, file)
    return path
