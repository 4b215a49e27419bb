"""KITTI's file formats: scans, images, calibration, labels (Geiger et al., IJRR 2013; the devkit's readmes).

Every reader stops with a ValueError that names the file, what is wrong with it and what it should be.
"""

from __future__ import annotations

import re
import warnings
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxsim.data.calibration import APART_M, check_pinhole, check_rigid
from jaxsim.data.polar_checks import check_motion_of
from jaxsim.files import check_size, numbers, parse_number, read_once, read_pixels, read_text
from jaxsim.frame import Boxes, Camera
from jaxsim.geometry import camera_from_projection
from jaxsim.geometry.points import PAGE_BYTES, check_points

OBJECT_KINDS = ("Car", "Van", "Truck", "Pedestrian", "Person_sitting", "Cyclist", "Tram", "Misc", "DontCare")
LABEL_COLUMNS = (
    *("truncated", "occluded", "alpha", "left", "top", "right", "bottom"),
    *("height", "width", "length", "x", "y", "z", "rotation_y"),
)
"""Names of a label's numbers, after its kind."""
MOST, MOST_SIZE_M = 1e4, 100.0
"""No number of a label is larger, and no object longer: a tram has 40 m."""
LEVEL = 0.5
"""Cosine of the steepest slope of a road: what is steeper is a wall."""
LOST_POINTS = PAGE_BYTES // 16
"""So many points of zeros, one after another, are bytes that a disk reserved and that nothing was written to."""
MOST_POINTS = 4_000_000
"""Most points of a scan: 30 times those of a turn of the densest sensor."""


def read_velodyne(path: Path) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Points (x forward, y left, z up; metres) and intensity 0..1 of a `.bin`, in file order."""
    size = check_size(_existing(path), by="kitti", most=MOST_POINTS * 16)
    if size % 16:
        raise ValueError(
            f"kitti: {path} is truncated: {size} bytes are no whole number of points (x y z intensity, "
            "float32, 16 bytes each); copy it again"
        )
    if size == 0:
        raise ValueError(f"kitti: {path} is empty; a scan has about 120000 points; copy it again")
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    _check_written(points, f"kitti: {path}")
    check_points(points, f"kitti: {path}")
    return np.ascontiguousarray(points[:, :3]), np.ascontiguousarray(points[:, 3])


def _check_written(points: Float[np.ndarray, "n 4"], where: str) -> None:
    """Raises ValueError, beginning with `where`, where a part of the file was never written, or is lost."""
    if np.count_nonzero(points[:, 0] == 0) < LOST_POINTS:  # nearly every file, at once
        return
    ends = np.flatnonzero(np.diff(~points.any(axis=1), prepend=False, append=False))
    first, length = ends[::2], ends[1::2] - ends[::2]
    if length.max(initial=0) >= LOST_POINTS:
        longest = int(length.argmax())
        raise ValueError(
            f"{where}: {length[longest]} of {len(points)} points hold zeros alone, from number {first[longest]} on: "
            "what was there is lost, as where a copy broke off; copy it again. A ray without return is no point: leave "
            "these out"
        )


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """An image file as RGB."""
    return cv2.cvtColor(read_pixels(_existing(path), cv2.IMREAD_COLOR, by="kitti"), cv2.COLOR_BGR2RGB)


def object_camera(path: Path, size: tuple[int, int]) -> Camera:
    """Camera 2 of a frame of the object benchmark from `calib/NNNNNN.txt`, or of a tracking sequence from
    `calib/NNNN.txt`, for an image of `size` (h, w).

    The file does not say the image's size, so the principal point must lie near the image's middle.
    """
    values = _read_calibration(path, {"P2": 12})
    return _pinhole(path, values, "P2", size=size, rect_from_velo=object_rect_from_velo(path))


def object_rect_from_velo(path: Path) -> Float[np.ndarray, "4 4"]:
    """R0_rect Tr_velo_to_cam of `calib/NNNNNN.txt`: from `velo` to the rectified camera 0, where labels are written. A
    tracking sequence's file calls the same numbers R_rect and Tr_velo_cam.

    `object_camera` holds camera 2 instead, which stands 6 cm beside it (P2's fourth column).
    """
    of_tracking = re.search(r"^(R_rect|Tr_velo_cam)\b", _text(path), re.MULTILINE)
    rectify, velo = ("R_rect", "Tr_velo_cam") if of_tracking else ("R0_rect", "Tr_velo_to_cam")
    values = _read_calibration(path, {rectify: 9, velo: 12})
    return _rigid(path, values, rectify) @ _rigid(path, values, velo)


def read_motion(path: Path) -> tuple[float, float]:
    """Forward speed (m/s) and heading (rad, 0 east, counter-clockwise) of `oxts/data/NNNNNNNNNN.txt` of a raw drive.

    Source: the devkit's dataformat.txt: 30 numbers, yaw the sixth, vf the ninth.
    """
    values = numbers(_text(path).split(), where=f"kitti: {path}: an oxts file holds 30 numbers")
    if len(values) != 30 or not np.isfinite(values).all():
        lost = len(values) - int(np.isfinite(values).sum())
        which = f", of which {lost} are not finite" if lost else ""
        raise ValueError(f"kitti: {path} has {len(values)} values{which}; an oxts file holds 30 finite numbers")
    check_motion_of(values[8], values[5], f"kitti: {path}")
    return values[8], values[5]


def read_plane(path: Path) -> Float[np.ndarray, " 4"]:
    """Road plane a, b, c, d of `planes/NNNNNN.txt` (Chen et al.'s, as OpenPCDet uses), in the labels' frame; a, b, c
    are its unit normal, and b is at most -LEVEL."""
    lines = _text(path).split("\n")
    fourth = lines[3] if len(lines) > 3 else ""
    right = f"kitti: {path}: the fourth line must hold the plane's four numbers"
    plane = np.array(numbers(fourth.split(), where=right))
    normal = np.linalg.norm(plane[:3])
    if plane.shape != (4,) or not normal > 0 or not np.isfinite(plane).all():
        raise ValueError(f"{right}, not {fourth!r}")
    if abs(plane[3]) > APART_M * normal:
        raise ValueError(
            f"kitti: {path}: the road lies {abs(plane[3]) / normal:g} m from the camera; it must be in metres, and at "
            f"most {APART_M:g}"
        )
    if abs(plane[1]) < LEVEL * normal:
        raise ValueError(
            f"kitti: {path}: the road's normal is {' '.join(fourth.split()[:3])}; a road's points up, nearly 0 -1 0: "
            "fit the plane to points of the road, or leave the frame out"
        )
    return plane / normal * (-1 if plane[1] > 0 else 1)


def raw_camera(folder: Path, size: tuple[int, int], *, camera: int = 2, image: Path | None = None) -> Camera:
    """The camera of a raw drive from the two calibration files of its date, for an image of `size` (h, w), which is the
    file `image` in errors."""
    tag = f"{camera:02d}"
    path = folder / "calib_cam_to_cam.txt"
    values = _read_calibration(path, {f"P_rect_{tag}": 12, "R_rect_00": 9, f"S_rect_{tag}": 2})
    lidar_file = folder / "calib_velo_to_cam.txt"
    velo = _read_calibration(lidar_file, {"R": 9, "T": 3})
    velo["[R | T]"] = np.column_stack([velo["R"].reshape(3, 3), velo["T"]])
    width, height = values[f"S_rect_{tag}"].astype(int)
    if size != (height, width):
        raise ValueError(
            f"kitti: {image or f'an image of image_{tag}'} is {size[1]} x {size[0]}, but {path} says "
            f"{width} x {height}: copy it again, or "
            "use the synced and rectified drive (..._sync), with the calibration of the same date"
        )
    rect_from_velo = _rigid(path, values, "R_rect_00") @ _rigid(lidar_file, velo, "[R | T]")
    return _pinhole(path, values, f"P_rect_{tag}", size=size, rect_from_velo=rect_from_velo)


IMAGE_SIZES = {718.856: (376, 1241), 721.5377: (375, 1242), 707.0912: (370, 1226)}
"""Rows and columns of the rectified images by their focal length in pixels: KITTI's three days of calibration."""


def odometry_camera(path: Path, size: tuple[int, int] | None) -> tuple[Camera, tuple[int, int]]:
    """Camera 2 of an odometry sequence from its `calib.txt`, and the size (h, w) of its images.

    The file does not say the size: without an image (`size` None) it is that of KITTI's cameras of the same focal
    length. Raises ValueError where there is none, and for what is no camera.
    """
    values = _read_calibration(path, {"P2": 12, "Tr": 12})
    if size is None:
        focal = float(values["P2"][0])
        size = next((known for length, known in IMAGE_SIZES.items() if abs(length - focal) < 0.1), None)
    if size is None:
        raise ValueError(
            f"kitti: {path}: P2 has the focal length {focal:g}, none of KITTI's cameras "
            f"({', '.join(f'{length:g}' for length in IMAGE_SIZES)}), so the images' size is not known; copy image_2/"
        )
    return _pinhole(path, values, "P2", size=size, rect_from_velo=_rigid(path, values, "Tr")), size


def read_labels(path: Path) -> Boxes:
    """Labelled objects of `label_2/NNNNNN.txt`.

    A `DontCare` region is a rectangle in the image alone: its 3-D fields are 0 and mean nothing. `occluded` are KITTI's
    levels, or, where one of a file is a fraction, all the hidden share 0..1 (float), as `jaxsim export --occlusion
    paper` writes it. Raises ValueError, with the line, for another count of columns, unknown kinds, numbers that are
    not finite, rectangles whose sides are swapped, sizes of 0 or less, and other values of `occluded` and `truncated`.
    """
    rows = _rows_of(path)
    for line, row in rows:
        if len(row) != 15:
            raise ValueError(
                f"kitti: {path}, line {line} has {len(row)} columns; a label has 15 (16 is a detector's result)"
            )
    return _boxes(path, rows)


def read_tracking_labels(path: Path) -> dict[int, Boxes]:
    """Labelled objects of a sequence's `label_02/NNNN.txt` by frame number; a frame without objects has no entry.

    The columns are frame, track, and then those of `read_labels`; `truncated` is a level here: 0 not, 1 partly,
    2 largely. `Person` is what this set calls the object benchmark's `Person_sitting`.
    """
    frames: dict[int, list[tuple[int, list[str]]]] = {}
    for line, (number, *row) in _rows_of(path):
        if len(row) != 16 or not (number.isdecimal() and number.isascii()):
            raise ValueError(
                f"kitti: {path}, line {line} has {len(row) + 1} columns and starts with {number!r}; a tracking label "
                "has 17: frame, track, type ... (15 is the object benchmark's, 18 a tracker's result)"
            )
        kind = "Person_sitting" if row[1] == "Person" else row[1]
        frames.setdefault(int(number), []).append((line, [kind, *row[2:]]))
    return {number: _boxes(path, rows) for number, rows in frames.items()}


def scan_time(path: Path, number: int) -> float | None:
    """Seconds of a drive's scan by its number, a line each: since 1970 in timestamps.txt of a raw drive, from the first
    scan on in times.txt of the odometry benchmark. None where the drive came without the file.

    Raises ValueError where the file has no line of that number, or the line holds no time.
    """
    if not path.is_file():
        return None
    lines = _lines(path)
    if number >= len(lines):
        raise ValueError(f"kitti: {path} has {len(lines)} lines, none for frame {number}; copy it again")
    time_s = _time_of(path, number)
    if number and time_s < _time_of(path, number - 1):
        warnings.warn(f"kitti: {path}: line {number + 1} lies before the line above it: a clock was set", stacklevel=2)
    return time_s


def _time_of(path: Path, number: int) -> float:
    line, where = _lines(path)[number].strip(), f"kitti: {path}, line {number + 1}"
    if path.name == "times.txt":
        return parse_number(line, float, where=where)
    try:  # nine decimals in the file, six are what a datetime holds
        return datetime.fromisoformat(line[:26]).replace(tzinfo=UTC).timestamp()
    except ValueError:
        raise ValueError(f"{where}: {line!r} is no time such as 2011-09-26 13:02:25.594360375") from None


@read_once
def _lines(path: Path) -> list[str]:
    return read_text(path, by="kitti").splitlines()


def _rows_of(path: Path) -> list[tuple[int, list[str]]]:
    lines = enumerate(_text(path).splitlines(), 1)
    return [(number, line.split()) for number, line in lines if line.strip()]


def _boxes(path: Path, rows: list[tuple[int, list[str]]]) -> Boxes:
    """Objects of numbered lines in the order of the object benchmark's 15 columns."""
    values = np.zeros((len(rows), 14))
    for k, (line, row) in enumerate(rows):
        if row[0] not in OBJECT_KINDS:
            raise ValueError(f"kitti: {path}, line {line}: unknown kind {row[0]!r}; known: {', '.join(OBJECT_KINDS)}")
        values[k] = numbers(row[1:], where=f"kitti: {path}, line {line}")
        _check_numbers(path, line, row, numbers=values[k])
    kinds = tuple(row[0] for _, row in rows)
    # Of a region without an object the rectangle alone means anything; the files have -1, -10 and -1000.
    values[np.array(kinds, str) == "DontCare"] *= _DONT_CARE_KEEPS
    hidden = values[:, 1]
    fractions = hidden != np.round(hidden)
    if fractions.any() and ((hidden < 0) | (hidden > 1)).any():
        line, row = rows[int(np.argmax((hidden < 0) | (hidden > 1)))]
        raise ValueError(
            f"kitti: {path}, line {line}: occluded is {row[2]}, but line {rows[int(np.argmax(fractions))][0]} has a "
            "fraction; a file has whole numbers 0..3, or the hidden shares of all its objects, 0..1"
        )
    n = values.astype(np.float32)
    return Boxes(
        centre_m=n[:, 10:13],
        # The file has height, width, length.
        size_m=n[:, [9, 8, 7]],
        yaw_rad=n[:, 13],
        bbox_px=n[:, 3:7],
        truncated=n[:, 0],
        occluded=n[:, 1] if fractions.any() else n[:, 1].astype(np.int32),
        kind=kinds,
    )


def _check_numbers(path: Path, line: int, row: list[str], *, numbers: Float[np.ndarray, " 14"]) -> None:
    """Raises ValueError for columns that hold no object: not finite, a rectangle whose sides are swapped, a size of 0
    or less, a strange `occluded` or `truncated`."""
    if not np.isfinite(numbers).all():
        bad = int(np.argmin(np.isfinite(numbers)))
        raise ValueError(
            f"kitti: {path}, line {line}: {LABEL_COLUMNS[bad]} of {row[0]} is {row[bad + 1]}; it must be finite: mend "
            "the label or leave the object out"
        )
    if np.abs(numbers).max() > MOST:
        bad = int(np.argmax(np.abs(numbers)))
        raise ValueError(
            f"kitti: {path}, line {line}: {LABEL_COLUMNS[bad]} of {row[0]} is {row[bad + 1]}; no metre, pixel or "
            f"radian of a label is beyond {MOST:g}: mend the label or leave the object out"
        )
    if (numbers[3:5] > numbers[5:7]).any():
        raise ValueError(
            f"kitti: {path}, line {line}: the rectangle of {row[0]} is {' '.join(row[4:8])}; it must be left, top, "
            "right, bottom"
        )
    if row[0] == "DontCare":
        return
    if not (0 < numbers[1] < 1 or numbers[1] in range(4)):
        raise ValueError(
            f"kitti: {path}, line {line}: occluded is {row[2]}; it is a whole number 0..3, or the hidden share 0..1"
        )
    if numbers[0] < 0:
        raise ValueError(
            f"kitti: {path}, line {line}: truncated is {row[1]}; it is the share outside the image, 0..1, or in the "
            "tracking set a level 0..2"
        )
    if not ((numbers[7:10] > 0) & (numbers[7:10] <= MOST_SIZE_M)).all():
        raise ValueError(
            f"kitti: {path}, line {line}: {row[0]} is {' x '.join(row[8:11])} m (height, width, length); sizes must be "
            f"above 0 and at most {MOST_SIZE_M:g}: mend the label, leave the object out, or call it DontCare"
        )


_DONT_CARE_KEEPS = np.array([0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0])


def _pinhole(
    path: Path, values: dict[str, np.ndarray], name: str, *, size: tuple[int, int], rect_from_velo: np.ndarray
) -> Camera:
    projection = values[name].reshape(3, 4)
    check_pinhole(projection[:, :3], size, f"kitti: {path}: {name}")
    camera = camera_from_projection(projection, rect_from_velo)
    check_rigid(np.asarray(camera.cam_from_velo), f"kitti: {path}: the camera's place by {name}")
    return camera


def _text(path: Path) -> str:
    return read_text(_existing(path), by="kitti")


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise ValueError(f"kitti: there is no {path}; the frame needs it, copy it from the data set")
    return path


def _read_calibration(path: Path, needed: dict[str, int]) -> dict[str, np.ndarray]:
    """Lines of `name: numbers`; the colon is left out in the tracking set."""
    entries: dict[str, list[str]] = {}
    for line in _text(path).splitlines():
        name, *words = line.replace(":", " ", 1).split() or [""]
        if name and name in entries:
            raise ValueError(f"kitti: {path} has {name} twice; copy the calibration file that belongs to the drive")
        entries[name] = words
    for name, count in needed.items():
        if name not in entries:
            raise ValueError(
                f"kitti: {path} has no {name} (it has {', '.join(filter(None, entries)) or 'nothing'}); copy "
                "the calibration file that belongs to the drive"
            )
        if len(entries[name]) != count:
            raise ValueError(f"kitti: {path}: {name} has {len(entries[name])} numbers; it must have {count}")
    values = {name: np.array(numbers(entries[name], where=f"kitti: {path}: {name}")) for name in needed}
    if not all(np.isfinite(value).all() for value in values.values()):
        raise ValueError(f"kitti: {path} holds NaN or infinite numbers; copy it again")
    return values


def _rigid(path: Path, values: dict[str, np.ndarray], name: str) -> np.ndarray:
    """4 x 4 from the 9 numbers of a rotation, or from the 12 of a 3 x 4 matrix. Raises ValueError where it is no rigid
    transform."""
    upper = values[name].reshape(3, -1)
    matrix = np.eye(4)
    matrix[:3, : upper.shape[1]] = upper
    check_rigid(matrix, f"kitti: {path}: {name}")
    return matrix


NO_BOXES = _boxes(Path(), [])
"""Boxes of a frame in which nothing is labelled."""


LISTED = 6


def listing(folder: Path) -> str:
    """What stands in a folder, its first few names, for an error."""
    if not folder.is_dir():
        return f"there is no folder {folder}"
    names = sorted(p.name + "/" * p.is_dir() for p in folder.iterdir())
    shown = names[:LISTED] + ["..."] * (len(names) > LISTED)
    return f"{folder} holds {', '.join(shown) or 'nothing'}"
