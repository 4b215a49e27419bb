"""Clouds on disk: KITTI's scans with their laser lines and their unit's beam table, and clouds of points alone.

Points alone come from `.bin` files, as KITTI has them, and from `.npz`, as `jaxsim simulate` writes them.
"""

from __future__ import annotations

import zipfile
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.kitti_files import read_velodyne
from jaxsim.frame import Cloud
from jaxsim.geometry import LidarSpec, UnorderedCloud, fit_beams, preset, recover_rows, rows_by_elevation

SUFFIXES = (".bin", ".npz")
SENSOR = "hdl64e"
ROWS = ("file_order", "elevation")
"""How a point's laser line is told: by its place in the file, or as the nearest beam."""


def read_cloud(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows x, y, z (m) and intensity (0..1); three columns alone where an `.npz` has no intensity.

    Raises ValueError where the file is broken or is no cloud.
    """
    if path.suffix == ".bin":
        return np.column_stack(read_velodyne(path))
    try:
        with path.open("rb") as file, np.load(file) as archive:
            arrays = {name: np.asarray(archive[name], np.float32) for name in ("xyz", "intensity") if name in archive}
    except (zipfile.BadZipFile, EOFError, OSError, ValueError) as error:
        raise ValueError(f"clouds: {path} is no readable .npz of plain arrays ({error})") from error
    if "xyz" not in arrays:
        raise ValueError(f"clouds: {path} holds no array xyz (n, 3); `jaxsim simulate --formats npz` writes it")
    return np.column_stack(list(arrays.values()))


def check_rows(rows: str) -> str:
    """The same name back. Raises ValueError where it is not in ROWS."""
    if rows not in ROWS:
        raise ValueError(f"kitti: rows is {rows!r}; it is 'file_order' or 'elevation'")
    return rows


def read_scan(path: Path, rows: str) -> Cloud:
    """The points of a `.bin` with their laser lines. Raises UnorderedCloud where the order hides them."""
    xyz_m, intensity = read_velodyne(path)
    return Cloud(xyz_m=xyz_m, intensity=intensity, valid=np.ones(len(xyz_m), bool), row=_lines(path, xyz_m, rows))


@cache
def fitted_spec(path: Path, rows: str) -> LidarSpec:
    """The beam table fitted to one scan; the nominal one where lines were told by it."""
    spec = preset(SENSOR)
    if rows == "elevation":  # rows that were told by the nominal table cannot correct it
        return spec
    xyz_m, _ = read_velodyne(path)
    return fit_beams(xyz_m, _lines(path, xyz_m, rows), lines=spec.rows, name=f"{SENSOR}, fitted to {path.stem}")


def _lines(path: Path, xyz_m: Float[np.ndarray, "n 3"], rows: str) -> Int[np.ndarray, " n"]:
    spec = preset(SENSOR)
    if rows == "elevation":
        return rows_by_elevation(xyz_m, spec)
    try:
        return recover_rows(xyz_m, lines=spec.rows, spec=spec)
    except UnorderedCloud as error:
        raise UnorderedCloud(
            f"{path}: {error}. Use the file as recorded, or take the nearest beam: --data.rows elevation "
            '(rows="elevation" in Python)'
        ) from error
