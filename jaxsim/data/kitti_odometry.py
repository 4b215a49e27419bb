"""KITTI's odometry benchmark, with SemanticKITTI's labels where they are.

    ROOT/sequences/00/calib.txt                   P0 .. P3, Tr (from `velo` to the rectified camera 0)
    ROOT/sequences/00/velodyne/000000.bin         scans with the car's motion taken out
    ROOT/sequences/00/image_2/000000.png          optional
    ROOT/sequences/00/labels/000000.label         optional: SemanticKITTI
    ROOT/sequences/00/times.txt                   optional: seconds

Labels are of points. The camera's classes are those of the points that it sees, spread to the pixels around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxsim.data.clouds import check_rows, compensated_spec, read_scan
from jaxsim.data.kitti_files import listing, odometry_camera, read_image, scan_time
from jaxsim.data.point_labels import TRAINING, VALIDATION, classes_in_image, labels_of, read_point_labels
from jaxsim.data.select import frame_number
from jaxsim.files import files_in
from jaxsim.frame import CameraFrame, Cloud, Frame
from jaxsim.geometry import LidarSpec


class KittiOdometry:
    """Scans of the odometry benchmark's sequences: a sequence is a scene. `sequences` chooses some; else all that are.

    A frame needs its scan alone. Without its image it has a black one (`has_image` is False), of the size that KITTI's
    cameras of that focal length have; without its labels it has no classes.
    """

    name = "kitti_odometry"

    def __init__(self, root: Path, *, sequences: Sequence[str] = (), rows: str = "file_order"):
        self.root = Path(root)
        self._rows = check_rows(rows)
        self._folder = _sequences_folder(self.root)
        self.sequences = _present(self._folder, sequences)
        self._frames = [(name, scan.stem) for name in self.sequences for scan in _scans(self._folder / name)]

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def spec(self) -> LidarSpec:
        """The beam table: the sensor's nominal one where the scans' motion was taken out, as the benchmark's was."""
        return compensated_spec(self._path(0, "velodyne", ".bin"), self._rows)

    def __getitem__(self, index: int) -> Frame:
        sequence, number = self._frames[frame_number(index, self.name, len(self))]
        scan, image = self._path(index, "velodyne", ".bin"), self._path(index, "image_2", ".png")
        rgb = read_image(image) if image.is_file() else None
        camera, size = odometry_camera(self._folder / sequence / "calib.txt", None if rgb is None else rgb.shape[:2])
        cloud = read_scan(scan, self._rows)
        view = CameraFrame(
            rgb=np.zeros((*size, 3), np.uint8) if rgb is None else rgb, camera=camera, has_image=rgb is not None
        )
        return Frame(
            name=self.name_of(index),
            scene=f"sequence_{sequence}",
            camera=self._labelled(view, cloud, labels_of(scan)),
            cloud=cloud,
            time_s=scan_time(self._folder / sequence / "times.txt", int(number)),
        )

    def name_of(self, index: int) -> str:
        """The sequence and the scan's number in it."""
        sequence, number = self._frames[index]
        return f"sequence_{sequence}-{number}"

    def files_of(self, index: int) -> list[Path]:
        """All that the frame is read from, with its sequence's calibration and times."""
        sequence, _ = self._frames[index]
        scan, image = self._path(index, "velodyne", ".bin"), self._path(index, "image_2", ".png")
        return [scan, image, labels_of(scan), *(self._folder / sequence / name for name in ("calib.txt", "times.txt"))]

    @property
    def splits(self) -> dict[str, list[int]]:
        """Positions by sequence (`sequence_00`); of frames with labels (`labelled`), and of these SemanticKITTI's own
        parts, `training` and `evaluation`; of frames with an image (`pictured`)."""
        parts: dict[str, list[int]] = {f"sequence_{name}": [] for name in self.sequences}
        labelled = [labels_of(self._path(i, "velodyne", ".bin")).is_file() for i in range(len(self))]
        pictured = [self._path(i, "image_2", ".png").is_file() for i in range(len(self))]
        of = {"labelled": labelled, "pictured": pictured}
        for part, chosen in (("training", TRAINING), ("evaluation", VALIDATION)):
            of[part] = [has and name in chosen for has, (name, _) in zip(labelled, self._frames, strict=True)]
        for position, (name, _) in enumerate(self._frames):
            parts[f"sequence_{name}"].append(position)
        return parts | {part: [int(i) for i in np.flatnonzero(chosen)] for part, chosen in of.items()}

    def _labelled(self, view: CameraFrame, cloud: Cloud, labels: Path) -> CameraFrame:
        """The view with the classes and objects of the points that it sees; as it is where there are no labels."""
        if not labels.is_file():
            return view
        semantic, instance = read_point_labels(labels, len(cloud.xyz_m))
        xyz_m, size = np.asarray(cloud.xyz_m), view.rgb.shape[-3:-1]
        semantic, instance = classes_in_image(xyz_m, semantic, instance, camera=view.camera, size=size)
        return replace(view, semantic=semantic, instance=instance)

    def _path(self, index: int, kind: str, suffix: str) -> Path:
        sequence, number = self._frames[index]
        return self._folder / sequence / kind / f"{number}{suffix}"


def _sequences_folder(root: Path) -> Path:
    """The folder of sequences: `sequences` in ROOT, or in ROOT/dataset, as the benchmark's archives have it."""
    for folder in (root / "sequences", root / "dataset" / "sequences"):
        if folder.is_dir():
            return folder
    if (root / "velodyne").is_dir() and (root / "calib.txt").is_file():
        raise ValueError(f"kitti_odometry: {root} is the folder of one sequence; pass the one that holds sequences/")
    raise ValueError(
        f"kitti_odometry: no sequences/: {listing(root)}; pass the folder that holds sequences/00/velodyne"
    )


def _present(folder: Path, wanted: Sequence[str]) -> tuple[str, ...]:
    """Names of sequences with scans. Raises ValueError where one that is wanted has none, or none is there."""
    sequences = tuple(sorted(p.name for p in folder.iterdir() if (p / "velodyne").is_dir() and _scans(p)))
    missing = [name for name in wanted if name not in sequences]
    if missing or not sequences:
        what = f"sequence {', '.join(missing)}" if missing else "sequence"
        raise ValueError(
            f"kitti_odometry: no {what} with velodyne/NUMBER.bin in {folder}; it has {', '.join(sequences) or 'none'}"
        )
    return tuple(dict.fromkeys(wanted)) or sequences


def _scans(sequence: Path) -> list[Path]:
    return [p for p in files_in(sequence / "velodyne", ".bin") if p.stem.isdecimal()]
