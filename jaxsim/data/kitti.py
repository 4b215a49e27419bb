"""KITTI drives as frames: the raw recordings and the object-detection benchmark.

    raw      ROOT/2011_09_26/calib_cam_to_cam.txt, calib_velo_to_cam.txt
             ROOT/2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin
             ROOT/2011_09_26/2011_09_26_drive_0001_sync/image_02/data/0000000000.png
             ROOT/2011_09_26/2011_09_26_drive_0001_sync/oxts/data/0000000000.txt    optional: speed and heading
    object   ROOT/training/{velodyne, image_2, calib, label_2}/000000.{bin, png, txt, txt}
             ROOT/testing/{velodyne, image_2, calib}/000000.{bin, png, txt}                   optional: no labels

A `.bin` does not name the laser of a point. It follows from the order of the file; a cloud that was shuffled
has lost it, and then `rows="elevation"` takes the nearest beam of the nominal table instead, which puts
part of the points one line off.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from pathlib import Path

from jaxsim.data.clouds import check_rows, fitted_spec, read_scan
from jaxsim.data.kitti_files import (
    listing,
    object_camera,
    object_rect_from_velo,
    raw_camera,
    read_image,
    read_labels,
    read_motion,
    read_plane,
    scan_time,
)
from jaxsim.data.select import frame_number
from jaxsim.files import files_in, in_order, read_names
from jaxsim.frame import CameraFrame, Frame
from jaxsim.geometry import LidarSpec
from jaxsim.progress import counted

_log = logging.getLogger(__name__)

DATE = re.compile(r"\d{4}_\d\d_\d\d")
_FRAME = re.compile(r"\d+")
SCANS = ("velodyne", "velodyne_reduced")
"""Folders of the object benchmark's scans: whole ones, and such as are cropped to the image."""


class KittiRaw:
    """Synced and rectified raw drives: every drive of every date under `root`, in order of name.

    A frame needs both its scan and its image: numbers that lack one are left out (drive 2011_09_26_drive_0009
    lacks four scans), and so are drives that have no scan or no image at all, which it says. A drive is a scene.
    """

    name = "kitti_raw"

    def __init__(self, root: Path, *, rows: str = "file_order"):
        self.root = Path(root)
        self._rows = check_rows(rows)
        drives = _drives(self.root)
        folders = {drive: (drive / "velodyne_points" / "data", drive / "image_02" / "data") for drive in drives}
        self._left_out = {drive: why for drive, both in folders.items() if (why := _lacking(*both))}
        if why := next(iter(self._left_out.values()), ""):
            if len(self._left_out) == len(folders):
                raise ValueError(why)
            _log.warning(f"{len(self._left_out)} of {len(folders)} drives left out: {why}")
        whole = {drive: both for drive, both in folders.items() if drive not in self._left_out}
        self._frames = [(drive, number) for drive, both in whole.items() for number in _numbers(*both)]

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def spec(self) -> LidarSpec:
        """This unit's own beam table, fitted to the first scan."""
        return fitted_spec(self._scan(0), self._rows)

    def __getitem__(self, index: int) -> Frame:
        drive, number = self._frames[frame_number(index, self.name, len(self))]
        image = drive / "image_02" / "data" / f"{number}.png"
        rgb = read_image(image)
        motion = drive / "oxts" / "data" / f"{number}.txt"
        speed_mps, heading_rad = read_motion(motion) if motion.is_file() else (None, None)
        return Frame(
            name=self.name_of(index),
            scene=drive.name,
            camera=CameraFrame(rgb=rgb, camera=raw_camera(drive.parent, rgb.shape[:2], image=image)),
            cloud=read_scan(self._scan(index), self._rows),
            time_s=scan_time(drive / "velodyne_points" / "timestamps.txt", int(number)),
            speed_mps=speed_mps,
            heading_rad=heading_rad,
        )

    def name_of(self, index: int) -> str:
        """The frame's number in the files, for a drive's frame after the drive's name."""
        drive, number = self._frames[index]
        return f"{drive.name}-{number}"

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from, with the calibration of its date."""
        drive, number = self._frames[index]
        calibration = [drive.parent / name for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt")]
        image, motion = drive / "image_02" / "data" / f"{number}.png", drive / "oxts" / "data" / f"{number}.txt"
        times = drive / "velodyne_points" / "timestamps.txt"
        return [self._scan(index), image, motion, times, *calibration]

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by drive: `drive_0009`, or by its whole name, `2011_09_26_drive_0009`, where two dates have it."""
        drives: dict[Path, list[int]] = {}
        for position, (drive, _) in enumerate(self._frames):
            drives.setdefault(drive, []).append(position)
        short = {drive: _short(drive) for drive in drives}
        times = Counter(short.values())
        names = {d: short[d] if times[short[d]] == 1 else d.name.removesuffix("_sync") for d in drives}
        return {names[drive]: positions for drive, positions in drives.items()}

    @property
    def lacks(self) -> dict[str, str]:
        """Why a drive is left out, by its names."""
        here = self.splits
        named = {d: (_short(d), d.name.removesuffix("_sync")) for d in self._left_out}
        return {name: self._left_out[d] for d, names in named.items() for name in names if name not in here}

    def _scan(self, index: int) -> Path:
        drive, number = self._frames[index]
        return drive / "velodyne_points" / "data" / f"{number}.bin"


class KittiObject:
    """The object benchmark: the single frames of `training`, then those of `testing`, from many drives.

    The files do not say which frames belong to one drive, so each frame is its own scene: to split by drive,
    use the published lists. Scans are in `velodyne`, else in `velodyne_reduced` (clouds cropped to the image). Frames
    of `testing` have no labels. Where both parts are there, one without scans or images is left out.
    """

    name = "kitti_object"

    def __init__(self, root: Path, *, rows: str = "file_order"):
        self.root = Path(root)
        self._rows = check_rows(rows)
        self._frames = _object_scans(self.root)

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def spec(self) -> LidarSpec:
        """The beam table, fitted to the first scan."""
        return fitted_spec(self._frames[0], self._rows)

    def __getitem__(self, index: int) -> Frame:
        scan = self._frames[frame_number(index, self.name, len(self))]
        folder, number = scan.parent.parent, scan.stem
        rgb = read_image(folder / "image_2" / f"{number}.png")
        calibration = folder / "calib" / f"{number}.txt"
        labels, plane = folder / "label_2" / f"{number}.txt", folder / "planes" / f"{number}.txt"
        return Frame(
            name=self.name_of(index),
            scene=self.name_of(index),
            camera=CameraFrame(rgb=rgb, camera=object_camera(calibration, rgb.shape[:2])),
            cloud=read_scan(scan, self._rows),
            boxes=read_labels(labels) if labels.is_file() else None,
            rect_from_velo=object_rect_from_velo(calibration),
            ground=read_plane(plane) if plane.parent.is_dir() else None,
        )

    def name_of(self, index: int) -> str:
        """The frame's number in the files; of `testing`, which counts from 0 again, after that word."""
        scan = self._frames[index]
        return scan.stem if scan.parent.parent.name == "training" else f"testing-{scan.stem}"

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from."""
        scan = self._frames[index]
        folder, number = scan.parent.parent, scan.stem
        texts = [folder / name / f"{number}.txt" for name in ("calib", "label_2", "planes")]
        return [scan, folder / "image_2" / f"{number}.png", *texts]

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by folder, `training` and `testing`, where there are frames, and by the name of a list:
        ROOT/ImageSets/NAME.txt, one number a line (`train`, `val` in OpenPCDet; `test` is of `testing`)."""
        places: dict[str, dict[str, int]] = {}
        for position, scan in enumerate(self._frames):
            places.setdefault(scan.parent.parent.name, {})[scan.stem] = position
        splits = {name: list(numbers.values()) for name, numbers in places.items()}
        for path in self._lists():
            numbers = places.get(_part_of(path), {})
            splits[path.stem] = [numbers[n] for n in read_names(path, by="kitti") if n in numbers]
        return splits

    @property
    def lacks(self) -> dict[str, str]:
        """What a list of ImageSets names and is not here, by the list's name."""
        here = {(scan.parent.parent.name, scan.stem) for scan in self._frames}
        lacks: dict[str, str] = {}
        for path in self._lists():
            named = read_names(path, by="kitti")
            if not named:
                lacks[path.stem] = f"{path} names no frame; write one number a line"
            elif missing := [number for number in named if (_part_of(path), number) not in here]:
                lacks[path.stem] = (
                    f"{path} names {len(named)} frames, of which {len(named) - len(missing)} have a scan and an image "
                    f"here; {_part_of(path)}/ lacks {missing[0]}, the first. Copy the rest, or go on with a list of "
                    f"those that are here: another .txt in {path.parent}, called by its name"
                )
        return lacks

    def _lists(self) -> list[Path]:
        return files_in(self.root / "ImageSets", ".txt")


def _part_of(path: Path) -> str:
    """The folder whose frames a list names."""
    return "testing" if path.stem == "test" else "training"


def _short(drive: Path) -> str:
    """A drive's name without its date, `drive_0009`."""
    return re.sub(rf"^{DATE.pattern}_|_(sync|extract)$", "", drive.name)


def _frames_in(folder: Path, *suffixes: str) -> list[str]:
    return [p.stem for p in files_in(folder, *suffixes) if _FRAME.fullmatch(p.stem)]


def _lacking(scans: Path, images: Path) -> str:
    """What a drive or a part of the benchmark lacks, in words; empty where it has scans and images."""
    wanted = {scans: ".bin", images: ".png"}
    empty = [folder for folder, suffix in wanted.items() if not _frames_in(folder, suffix)]
    return f"kitti: {listing(empty[0])}; expected NUMBER{wanted[empty[0]]} files in it" if empty else ""


def _numbers(scans: Path, images: Path) -> list[str]:
    """Frame numbers that have a scan and an image; scans without an image are told."""
    numbers = set(_frames_in(scans, ".bin")), set(_frames_in(images, ".png"))
    both = sorted(set.intersection(*numbers), key=in_order)
    if both and (alone := sorted(numbers[0].difference(both), key=in_order)):
        _log.warning(
            f"{counted(len(alone), 'scan')} of {len(numbers[0])} in {scans} left out, as {images} has no image of the "
            f"same number: {alone[0]}{' ...' if len(alone) > 1 else ''}"
        )
    if not both:
        raise ValueError(
            f"kitti: no scan of {scans} ({min(numbers[0])}.bin, ...) has an image of the same number in "
            f"{images} ({min(numbers[1])}.png, ...); a frame needs both"
        )
    return both


def _drives(root: Path) -> list[Path]:
    """Folders of drives under the date folders of `root`."""
    if not root.is_dir():
        raise ValueError(f"kitti: there is no folder {root}; pass the one that holds 2011_09_26/")
    if DATE.fullmatch(root.resolve().name) and (root / "calib_velo_to_cam.txt").is_file():
        raise ValueError(f"kitti: {root} is the folder of one date; pass the folder above it")
    if (root / "velodyne_points").is_dir():
        raise ValueError(
            f"kitti: {root} is the folder of one drive; pass the folder two levels up, that holds 2011_09_26/"
        )
    dates = sorted(p for p in root.iterdir() if p.is_dir() and DATE.fullmatch(p.name))
    if not dates and ((root / "training").is_dir() or (root / "testing").is_dir()):
        raise ValueError(f"kitti: {listing(root)}: this is the object benchmark; use --data.kind kitti_object")
    if not dates:
        raise ValueError(f"kitti: no date folder: {listing(root)}; pass the folder that holds 2011_09_26/")
    drives = sorted(p for date in dates for p in date.iterdir() if (p / "velodyne_points").is_dir())
    if not drives:
        raise ValueError(
            f"kitti: no drive with velodyne_points/: {listing(dates[0])}; expected e.g. "
            f"{dates[0].name}_drive_0001_sync/velodyne_points/data in it"
        )
    return drives


def _object_scans(root: Path) -> list[Path]:
    """Scans of the frames of `training`, then of `testing`. A part without scans or images is left out, unless it is
    the only one: then the error says what it lacks."""
    parts = [root / name for name in ("training", "testing") if (root / name).is_dir()]
    if not parts and (root / "image_2").is_dir():
        raise ValueError(f"kitti: {root} is a split of the object benchmark; pass the folder above it")
    if not parts and root.is_dir() and any(DATE.fullmatch(p.name) for p in root.iterdir()):
        raise ValueError(f"kitti: {listing(root)}: these are raw drives; use --data.kind kitti_raw")
    if not parts:
        raise ValueError(f"kitti: no training/: {listing(root)}; pass the folder that holds training/velodyne")
    # The first of the folders that may hold scans and does.
    scans = {p: next((p / name for name in SCANS if _frames_in(p / name, ".bin")), p / SCANS[0]) for p in parts}
    lacking = {part: why for part in parts if (why := _lacking(scans[part], part / "image_2"))}
    if len(lacking) == len(parts):
        raise ValueError(lacking[parts[0]])
    for part, why in lacking.items():
        _log.warning(f"{part} left out: {why}")
    whole = [part for part in parts if part not in lacking]
    return [scans[part] / f"{number}.bin" for part in whole for number in _numbers(scans[part], part / "image_2")]
