"""Clouds on disk: KITTI's scans with their laser lines and their unit's beam table, and clouds of points alone.

Points alone come from `.bin` files, as KITTI has them, and from `.npz`, as `jaxsim simulate` writes them.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxsim.data.kitti_files import read_velodyne
from jaxsim.files import array_names, as_argument, files_in, read_arrays, read_once, repeated
from jaxsim.frame import Cloud
from jaxsim.geometry import LidarSpec, UnorderedCloud, fit_beams, preset, recover_rows, rows_by_elevation
from jaxsim.geometry.points import check_points

SUFFIXES = (".bin", ".npz")
SENSOR = "hdl64e"
ROWS = ("file_order", "elevation")
"""How a point's laser line is told: by its place in the file, or as the nearest beam."""
NEAREST_BEAM = f'--data.rows elevation (of `jaxsim frames` --log.sensor {SENSOR}, in Python rows="elevation")'
"""How the latter is asked for."""
ALL_ROUND, LAST_DEG = 0.25, 339.0
"""Share of points behind the car from which a scan looks all round, and the azimuth that its lowest line reaches. In
116 scans of 20 KITTI drives the share is 0.43 to 0.53, and all end in the lowest line at 339.5 to 342.4 degrees, where
the car itself is in the way."""
ROAD_DEG = -2.5
"""Lines that point lower meet the road within 40 m wherever they look."""
LEAST_POINTS = 1000
"""Fewer points are no scan: one that is cropped to the camera has 17 000, a whole one 104 000 to 127 000."""
DENSE = 0.56
"""Share of the sensor's firings that come back along the middle one of the lines that see the road: 0.84 to 1.07 in 116
scans of 20 KITTI drives, and at most 0.54 where every second point was taken out."""
CLOCKWISE = 0.5
"""Share of the steps from point to point in which the azimuth falls: one in two thousand where lines run as recorded,
nearly all in a scan that was mirrored."""
DARK = 0.01
"""KITTI's intensity is a whole number of hundredths, up to 0.99 in every scan: one that stays below a single hundredth
was set to 0 or divided once more."""


def read_cloud(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows x, y, z (m) and intensity (0..1); three columns alone where an `.npz` has no intensity.

    Raises ValueError where the file is broken, is no cloud, or holds what no LiDAR measures (`check_points`).
    """
    if path.suffix.lower() == ".bin":
        return np.column_stack(read_velodyne(path))
    arrays = read_arrays(path, ("xyz", "intensity"), by="clouds")
    xyz_m, intensity = arrays.get("xyz"), arrays.get("intensity")
    if xyz_m is None or xyz_m.ndim != 2 or xyz_m.shape[1] != 3 or xyz_m.dtype.kind not in "fiu":
        held = ", ".join(array_names(path, by="clouds")) or "nothing"
        polar = (path.parent / "grid.json").is_file()
        command = f"jaxsim frames {as_argument(path.parent)} --to npz --out CLOUDS"
        frame = f"it is a polar frame: `{command}` writes clouds of these"
        lacks = "where these are range and intensity it is a polar frame, and its folder lacks grid.json"
        raise ValueError(
            f"clouds: {path} holds no array xyz (n, 3), as `jaxsim simulate --formats npz` writes it, but {held}; "
            f"{frame if polar else lacks}"
        )
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
    if twice := repeated(file.stem for file in files):
        raise ValueError(f"clouds: {folder} holds {twice[0]} twice, as {' and '.join(SUFFIXES)}; leave one")
    return files


def check_rows(rows: str) -> str:
    """The same name back. Raises ValueError where it is not in ROWS."""
    if rows not in ROWS:
        raise ValueError(f"kitti: rows is {rows!r}; it is 'file_order' or 'elevation'")
    return rows


def read_scan(path: Path, rows: str) -> Cloud:
    """The points of a `.bin` with their laser lines.

    Raises UnorderedCloud where the order hides them, and ValueError where a scan in file order is not whole.
    """
    xyz_m, intensity = read_velodyne(path)
    cloud = Cloud(xyz_m=xyz_m, intensity=intensity, valid=np.ones(len(xyz_m), bool), row=_lines(path, xyz_m, rows))
    if rows == "file_order":  # the sensor's own file, not what was made of it
        _check_whole(path, cloud, preset(SENSOR))
    return cloud


@read_once
def fitted_spec(path: Path, rows: str) -> LidarSpec:
    """The beam table fitted to one scan; the nominal one where lines were told by it. Fitted once while the file stays
    as it is."""
    if rows == "elevation":  # rows that were told by the nominal table cannot correct it
        return preset(SENSOR)
    return _fitted(read_scan(path, rows), path.stem)


@read_once
def compensated_spec(path: Path, rows: str) -> LidarSpec:
    """The beam table of scans like this one: fitted, or the sensor's nominal one where the car's motion was taken out
    of it, as of the odometry benchmark's, so that no cone fits its lines."""
    if rows == "elevation":
        return preset(SENSOR)
    scan = read_scan(path, rows)  # a scan that cannot be read is no matter of motion
    try:
        return _fitted(scan, path.stem)
    except ValueError:
        return preset(SENSOR)


def _fitted(scan: Cloud, name: str) -> LidarSpec:
    xyz_m, row = np.asarray(scan.xyz_m), np.asarray(scan.row)
    return fit_beams(xyz_m, row, lines=preset(SENSOR).rows, name=f"{SENSOR}, fitted to {name}")


def _lines(path: Path, xyz_m: Float[np.ndarray, "n 3"], rows: str) -> Int[np.ndarray, " n"]:
    spec = preset(SENSOR)
    if rows == "elevation":
        return rows_by_elevation(xyz_m, spec)
    if len(xyz_m) < LEAST_POINTS:
        raise ValueError(
            f"{path} holds {len(xyz_m)} points; a whole scan has about 120000, and one that is cropped to the camera "
            "17000: the file is cut off; copy it again, or leave the frame out"
        )
    try:
        return recover_rows(xyz_m, lines=spec.rows, spec=spec)
    except UnorderedCloud as error:
        raise UnorderedCloud(
            f"{path}: {error}. Use the file as recorded, or take the nearest beam: {NEAREST_BEAM}"
        ) from error


def _check_whole(path: Path, scan: Cloud, spec: LidarSpec) -> None:
    """Raises ValueError where a scan that looks all round lacks a line that sees the road, does not have nearly all of
    its lowest, or has too few points or too little intensity in all: a damaged file is else no different from a whole
    one, and its missing points would be learned as dropped rays. Warns where upper lines lack, which the open sky may
    swallow."""
    xyz_m, row = np.asarray(scan.xyz_m), np.asarray(scan.row)
    azimuth = np.rad2deg(np.arctan2(xyz_m[:, 1], xyz_m[:, 0])) % 360
    if (np.diff(azimuth) < 0).mean() > CLOCKWISE:
        warnings.warn(
            f"{path}: its points run clockwise, and a recorded scan's counter-clockwise: if y was mirrored (axes of "
            "the left hand), cloud and image do not fit, and the scan must be mirrored back; if they were but written "
            "in another order, nothing is wrong",
            stacklevel=3,
        )
    if ((azimuth > 90) & (azimuth < 270)).mean() <= ALL_ROUND:
        return
    lowest, lines = int(row.max()), spec.rows
    reach = float(azimuth[row == lowest].max())
    if lowest < lines - 1 or reach < LAST_DEG:
        raise ValueError(
            f"{path} ends in laser line {lowest} of {lines - 1} at {reach:.0f} degrees; a scan that looks all "
            f"round ends in the lowest line, beyond {LAST_DEG:g}: the file is cut off; copy it again"
        )
    _check_lines(path, np.bincount(row, minlength=lines), spec)
    if (brightest := float(np.max(scan.intensity))) < DARK:
        raise ValueError(
            f"{path}: no point has an intensity above {brightest:.2g}; a scan's lie in 0..1, up to about 0.99: they "
            "were lost, or divided once too often; use the file as recorded"
        )


def _check_lines(path: Path, points: Int[np.ndarray, " rows"], spec: LidarSpec) -> None:
    """Checks how many points each line of a scan that looks all round has."""
    lost, road = np.flatnonzero(points == 0), np.asarray(spec.elevation_deg) < ROAD_DEG
    what = (
        f"{path} has no point in laser lines {', '.join(map(str, lost))} of 0..{spec.rows - 1}, though it looks all "
        "round"
    )
    if road[lost].any():
        raise ValueError(
            f"{what}; these see the road: the file was thinned or damaged; use it as recorded, or copy it again"
        )
    middle = int(np.median(points[road]))
    if middle < DENSE * spec.columns:
        raise ValueError(
            f"{path} has {middle} points in the middle one of the laser lines that see the road; of a whole scan "
            f"nearly all of {spec.columns} firings come back: the file was thinned or damaged; use it as recorded, or "
            f"copy it again. Of a sensor that turns faster, take the nearest beam: {NEAREST_BEAM}"
        )
    if len(lost):
        warnings.warn(f"{what}; a sky without anything in it swallows them, else the file was thinned", stacklevel=2)
