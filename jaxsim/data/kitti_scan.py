"""A KITTI scan as a cloud with laser lines, and the beam table of the unit that made it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.kitti_files import read_velodyne
from jaxsim.frame import Cloud
from jaxsim.geometry import LidarSpec, UnorderedCloud, fit_beams, preset, recover_rows, rows_by_elevation

SENSOR = "hdl64e"
ROWS = ("file_order", "elevation")
"""How a point's laser line is told: by its place in the file, or as the nearest beam."""


def check_rows(rows: str) -> str:
    """The same name back. Raises ValueError where it is not in ROWS."""
    if rows not in ROWS:
        raise ValueError(f"kitti: rows is {rows!r}; it is 'file_order' or 'elevation'")
    return rows


def read_scan(path: Path, rows: str) -> Cloud:
    """The points of a `.bin` with their laser lines. Raises UnorderedCloud where the order hides them."""
    xyz_m, intensity = read_velodyne(path)
    return Cloud(
        xyz_m=xyz_m,
        intensity=intensity,
        valid=np.ones(len(xyz_m), bool),
        row=_lines(path, xyz_m, rows),
    )


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
