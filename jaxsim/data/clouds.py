"""Clouds on disk: KITTI's scans with their laser lines and their unit's beam table, and clouds of points alone.

Points alone come from `.bin` files, as KITTI has them, and from `.npz`, as `jaxsim simulate` writes them.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.kitti_files import read_velodyne
from jaxsim.files import files_in, read_arrays
from jaxsim.frame import Cloud
from jaxsim.geometry import LidarSpec, UnorderedCloud, fit_beams, preset, recover_rows, rows_by_elevation
from jaxsim.geometry.points import check_points

SUFFIXES = (".bin", ".npz")
SENSOR = "hdl64e"
ROWS = ("file_order", "elevation")
"""How a point's laser line is told: by its place in the file, or as the nearest beam."""
ALL_ROUND, LAST_DEG = 0.25, 300.0
"""Share of points behind the car from which a scan looks all round, and the azimuth that its last line reaches. In 116
scans of 20 KITTI drives the share is 0.43 to 0.53, and all end in the lowest line at 339 to 342 degrees, where the car
itself is in the way."""


def read_cloud(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows x, y, z (m) and intensity (0..1); three columns alone where an `.npz` has no intensity.

    Raises ValueError where the file is broken, is no cloud, or holds what no LiDAR measures (`check_points`).
    """
    if path.suffix == ".bin":
        return np.column_stack(read_velodyne(path))
    arrays = read_arrays(path, ("xyz", "intensity"), by="clouds")
    xyz_m, intensity = arrays.get("xyz"), arrays.get("intensity")
    if xyz_m is None or xyz_m.ndim != 2 or xyz_m.shape[1] != 3 or xyz_m.dtype.kind not in "fiu":
        raise ValueError(f"clouds: {path} holds no array xyz (n, 3); `jaxsim simulate --formats npz` writes it")
    if intensity is not None and (intensity.shape != xyz_m.shape[:1] or intensity.dtype.kind not in "fiu"):
        raise ValueError(
            f"clouds: {path} holds intensity {intensity.shape} of {intensity.dtype} for {len(xyz_m)} points; it must "
            "be one number a point"
        )
    points = np.column_stack([xyz_m] if intensity is None else [xyz_m, intensity]).astype(np.float32)
    check_points(points, f"clouds: {path}")
    return points


def cloud_files(folder: Path) -> list[Path]:
    """The clouds of a folder, by name; none where there is no such folder. Raises ValueError where a name comes twice,
    once with each suffix."""
    files = files_in(folder, *SUFFIXES)
    twice = [file.stem for file, after in pairwise(files) if file.stem == after.stem]
    if twice:
        raise ValueError(f"clouds: {folder} holds {twice[0]} twice, as {' and '.join(SUFFIXES)}; leave one")
    return files


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
        row = recover_rows(xyz_m, lines=spec.rows, spec=spec)
    except UnorderedCloud as error:
        raise UnorderedCloud(
            f"{path}: {error}. Use the file as recorded, or take the nearest beam: --data.rows elevation "
            '(rows="elevation" in Python)'
        ) from error
    _check_end(path, xyz_m, row, lines=spec.rows)
    return row


def _check_end(path: Path, xyz_m: Float[np.ndarray, "n 3"], row: Int[np.ndarray, " n"], *, lines: int) -> None:
    """Raises ValueError where a scan that looks all round does not end with its lowest line, nearly all of it: a file
    cut between two points is else no different from a whole one."""
    azimuth = np.rad2deg(np.arctan2(xyz_m[:, 1], xyz_m[:, 0])) % 360
    all_round = ((azimuth > 90) & (azimuth < 270)).mean() > ALL_ROUND
    if all_round and (row[-1] < lines - 1 or azimuth[-1] < LAST_DEG):
        raise ValueError(
            f"{path} ends in laser line {row[-1]} of {lines - 1} at {azimuth[-1]:.0f} degrees; a scan that looks all "
            f"round ends in the lowest line, beyond {LAST_DEG:g}: the file is cut off; copy it again"
        )
