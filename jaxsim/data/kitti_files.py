"""KITTI's file formats: scans, images, calibration, labels (Geiger et al., IJRR 2013; the devkit's readmes).

Every reader stops with a ValueError that names the file, what is wrong with it and what it should be.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxsim.frame import Boxes, Camera
from jaxsim.geometry import camera_from_projection

KINDS = ("Car", "Van", "Truck", "Pedestrian", "Person_sitting", "Cyclist", "Tram", "Misc", "DontCare")
COLUMNS = (
    *("truncated", "occluded", "alpha", "left", "top", "right", "bottom"),
    *("height", "width", "length", "x", "y", "z", "rotation_y"),
)
"""Of a label, after its kind."""


def read_velodyne(path: Path) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Points (x forward, y left, z up; metres) and intensity 0..1 of a `.bin`, in file order."""
    size = _existing(path).stat().st_size
    if size % 16:
        raise ValueError(
            f"kitti: {path} is truncated: {size} bytes are no whole number of points (x y z intensity, "
            "float32, 16 bytes each); copy it again"
        )
    if size == 0:
        raise ValueError(f"kitti: {path} is empty; a scan has about 120000 points; copy it again")
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    broken = int((~np.isfinite(points).all(axis=1)).sum())
    if broken:
        raise ValueError(
            f"kitti: {path}: {broken} of {len(points)} points are NaN or infinite; a ray without return is "
            "left out of a .bin, so remove these rows"
        )
    intensity = points[:, 3]
    low, high = intensity.min(), intensity.max()
    if low < 0 or high > 1:
        raise ValueError(
            f"kitti: {path}: intensity spans {low:g}..{high:g}; KITTI's scale is 0..1, so this is another "
            "sensor's file or one that was rescaled (divide 0..255 by 255)"
        )
    return np.ascontiguousarray(points[:, :3]), np.ascontiguousarray(intensity)


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """An image file as RGB."""
    image = cv2.imread(str(_existing(path)), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"kitti: {path} is not an image that can be read; copy it again")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def object_camera(path: Path, size: tuple[int, int]) -> Camera:
    """Camera 2 of an object-benchmark frame from `calib/NNNNNN.txt`, for an image of `size` (h, w).

    The file does not say the image's size, so the principal point must lie near the image's middle.
    """
    return _camera(path, size, rectify="R0_rect", velo="Tr_velo_to_cam")


def object_rect_from_velo(path: Path) -> Float[np.ndarray, "4 4"]:
    """R0_rect Tr_velo_to_cam of `calib/NNNNNN.txt`: from `velo` to the rectified camera 0, where labels are written.

    `object_camera` holds camera 2 instead, which stands 6 cm beside it (P2's fourth column).
    """
    values = _read_calibration(path, {"R0_rect": 9, "Tr_velo_to_cam": 12})
    return _homogeneous(values["R0_rect"]) @ _homogeneous(values["Tr_velo_to_cam"])


def read_motion(path: Path) -> tuple[float, float]:
    """Forward speed (m/s) and heading (rad, 0 east, counter-clockwise) of `oxts/data/NNNNNNNNNN.txt` of a raw drive.

    Source: the devkit's dataformat.txt: 30 numbers, yaw the sixth, vf the ninth.
    """
    try:
        values = [float(value) for value in _existing(path).read_text().split()]
    except ValueError as error:
        raise ValueError(f"kitti: {path}: an oxts file holds 30 numbers ({error}); copy it again") from None
    if len(values) != 30 or not np.isfinite(values).all():
        raise ValueError(f"kitti: {path} has {len(values)} values; an oxts file holds 30 finite numbers; copy it again")
    return values[8], values[5]


def read_plane(path: Path) -> Float[np.ndarray, " 4"]:
    """Road plane a, b, c, d of `planes/NNNNNN.txt` (Chen et al.'s, as OpenPCDet uses), in the labels' frame; b < 0."""
    lines = _existing(path).read_text().split("\n")
    try:
        plane = np.array([float(value) for value in lines[3].split()])
        normal = np.linalg.norm(plane[:3])
    except (IndexError, ValueError) as error:
        raise ValueError(f"kitti: {path}: the fourth line must hold the plane's four numbers ({error})") from None
    if plane.shape != (4,) or not normal > 0 or not np.isfinite(plane).all():
        raise ValueError(f"kitti: {path}: the fourth line must hold the plane's four numbers, not {lines[3]!r}")
    return plane / normal * (-1 if plane[1] > 0 else 1)


def tracking_camera(path: Path, size: tuple[int, int]) -> Camera:
    """Camera 2 of a tracking sequence from `calib/NNNN.txt`, for an image of `size` (h, w).

    The same numbers as the object benchmark's under other names, three of them without a colon.
    """
    return _camera(path, size, rectify="R_rect", velo="Tr_velo_cam")


def tracking_rect_from_velo(path: Path) -> Float[np.ndarray, "4 4"]:
    """R_rect Tr_velo_cam of a tracking sequence's `calib/NNNN.txt`: to the frame in which its labels are written."""
    values = _read_calibration(path, {"R_rect": 9, "Tr_velo_cam": 12})
    return _homogeneous(values["R_rect"]) @ _homogeneous(values["Tr_velo_cam"])


def raw_camera(folder: Path, size: tuple[int, int], *, camera: int = 2) -> Camera:
    """The camera of a raw drive from the two calibration files of its date, for an image of `size` (h, w)."""
    tag = f"{camera:02d}"
    path = folder / "calib_cam_to_cam.txt"
    values = _read_calibration(path, {f"P_rect_{tag}": 12, "R_rect_00": 9, f"S_rect_{tag}": 2})
    velo = _read_calibration(folder / "calib_velo_to_cam.txt", {"R": 9, "T": 3})
    width, height = values[f"S_rect_{tag}"].astype(int)
    if size != (height, width):
        raise ValueError(
            f"kitti: images of image_{tag} are {size[1]} x {size[0]}, but {path} says {width} x {height}: "
            "use the synced and rectified drive (..._sync), with the calibration of the same date"
        )
    return camera_from_projection(
        values[f"P_rect_{tag}"].reshape(3, 4),
        _homogeneous(values["R_rect_00"]) @ _homogeneous(np.column_stack([velo["R"].reshape(3, 3), velo["T"]])),
    )


def read_labels(path: Path) -> Boxes:
    """Labelled objects of `label_2/NNNNNN.txt`.

    A `DontCare` region is a rectangle in the image alone: its 3-D fields are 0 and mean nothing. `occluded` are KITTI's
    levels, or, where one of a file is a fraction, all the hidden share 0..1 (float), as `jaxsim export --occlusion
    paper` writes it. Raises ValueError, with the line, for another count of columns, unknown kinds, numbers that are
    not finite, sizes of 0 or less, and other values of `occluded`.
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
        if len(row) != 16 or not number.isdigit():
            raise ValueError(
                f"kitti: {path}, line {line} has {len(row) + 1} columns and starts with {number!r}; a tracking label "
                "has 17: frame, track, type ... (15 is the object benchmark's, 18 a tracker's result)"
            )
        kind = "Person_sitting" if row[1] == "Person" else row[1]
        frames.setdefault(int(number), []).append((line, [kind, *row[2:]]))
    return {number: _boxes(path, rows) for number, rows in frames.items()}


def _rows_of(path: Path) -> list[tuple[int, list[str]]]:
    lines = enumerate(_existing(path).read_text().splitlines(), 1)
    return [(number, line.split()) for number, line in lines if line.strip()]


def _boxes(path: Path, rows: list[tuple[int, list[str]]]) -> Boxes:
    """Objects of numbered lines in the order of the object benchmark's 15 columns."""
    numbers = np.zeros((len(rows), 14))
    for k, (line, row) in enumerate(rows):
        if row[0] not in KINDS:
            raise ValueError(f"kitti: {path}, line {line}: unknown kind {row[0]!r}; known: {', '.join(KINDS)}")
        try:
            numbers[k] = [float(value) for value in row[1:]]
        except ValueError as error:
            raise ValueError(f"kitti: {path}, line {line}: {error}") from None
        _check_numbers(path, line, row, numbers=numbers[k])
    kinds = tuple(row[0] for _, row in rows)
    # Of a region without an object the rectangle alone means anything; the files have -1, -10 and -1000.
    numbers[np.array(kinds, str) == "DontCare"] *= _DONT_CARE_KEEPS
    hidden = numbers[:, 1]
    fractions = hidden != np.round(hidden)
    if fractions.any() and ((hidden < 0) | (hidden > 1)).any():
        line, row = rows[int(np.argmax((hidden < 0) | (hidden > 1)))]
        raise ValueError(
            f"kitti: {path}, line {line}: occluded is {row[2]}, but line {rows[int(np.argmax(fractions))][0]} has a "
            "fraction; a file has whole numbers 0..3, or the hidden shares of all its objects, 0..1"
        )
    n = numbers.astype(np.float32)
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
    """Raises ValueError for columns that hold no object: not finite, a size of 0 or less, a strange `occluded`."""
    if not np.isfinite(numbers).all():
        bad = int(np.argmin(np.isfinite(numbers)))
        raise ValueError(
            f"kitti: {path}, line {line}: {COLUMNS[bad]} of {row[0]} is {row[bad + 1]}; it must be finite: mend the "
            "label or leave the object out"
        )
    if row[0] == "DontCare":
        return
    if numbers[1] != round(numbers[1]) and not 0 < numbers[1] < 1:
        raise ValueError(
            f"kitti: {path}, line {line}: occluded is {row[2]}; it is a whole number 0..3, or the hidden share 0..1"
        )
    if not (numbers[7:10] > 0).all():
        raise ValueError(
            f"kitti: {path}, line {line}: {row[0]} is {' x '.join(row[8:11])} m (height, width, length); sizes must be "
            "above 0: mend the label, leave the object out, or call it DontCare"
        )


_DONT_CARE_KEEPS = np.array([0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0])


def _camera(path: Path, size: tuple[int, int], *, rectify: str, velo: str) -> Camera:
    values = _read_calibration(path, {"P2": 12, rectify: 9, velo: 12})
    projection = values["P2"].reshape(3, 4)
    (cx, cy), (h, w) = projection[:2, 2], size
    if abs(cx - w / 2) > 0.1 * w or abs(cy - h / 2) > 0.1 * h:
        raise ValueError(
            f"kitti: {path} puts the optical axis at ({cx:.0f}, {cy:.0f}), far from the middle of its "
            f"image of {w} x {h}: calibration and image do not belong together, or the image was resized"
        )
    return camera_from_projection(projection, _homogeneous(values[rectify]) @ _homogeneous(values[velo]))


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise ValueError(f"kitti: there is no {path}; the frame needs it, copy it from the data set")
    return path


def _read_calibration(path: Path, needed: dict[str, int]) -> dict[str, np.ndarray]:
    """Lines of `name: numbers`; the colon is left out in the tracking set."""
    found: dict[str, list[str]] = {}
    for line in _existing(path).read_text().splitlines():
        name, *numbers = line.replace(":", " ", 1).split() or [""]
        found[name] = numbers
    for name, count in needed.items():
        if name not in found:
            raise ValueError(
                f"kitti: {path} has no {name} (it has {', '.join(filter(None, found)) or 'nothing'}); copy "
                "the calibration file that belongs to the drive"
            )
        if len(found[name]) != count:
            raise ValueError(f"kitti: {path}: {name} has {len(found[name])} numbers; it must have {count}")
    try:
        values = {name: np.array(found[name], float) for name in needed}
    except ValueError as error:
        raise ValueError(f"kitti: {path}: {error}") from None
    if not all(np.isfinite(value).all() for value in values.values()):
        raise ValueError(f"kitti: {path} holds NaN or infinite numbers; copy it again")
    return values


def _homogeneous(numbers: np.ndarray) -> np.ndarray:
    """4 x 4 from the 9 numbers of a rotation, or from the 12 of a 3 x 4 matrix."""
    upper = numbers.reshape(3, -1)
    matrix = np.eye(4)
    matrix[:3, : upper.shape[1]] = upper
    return matrix


NO_BOXES = _boxes(Path(), [])
"""Of a frame in which nothing is labelled."""


def listing(folder: Path, most: int = 6) -> str:
    """What stands in a folder, for an error."""
    if not folder.is_dir():
        return f"there is no folder {folder}"
    names = sorted(p.name + "/" * p.is_dir() for p in folder.iterdir())
    more = ", ..." if len(names) > most else ""
    return f"{folder} holds {', '.join(names[:most]) or 'nothing'}{more}"
