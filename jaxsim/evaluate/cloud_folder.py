"""A folder of clouds for a detector, the cameras that stand beside them, and the folder of its results.

Results are KITTI's (one NAME.txt a cloud). OUT/detect.json says what made them, so that a resumed command adds none of
another making, and keeps none of a cloud that has changed since.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Float32
from pydantic import TypeAdapter

from jaxsim.config import DetectorExperiment
from jaxsim.data import clouds
from jaxsim.data.clouds import SUFFIXES, read_cloud
from jaxsim.data.kitti_files import object_camera, object_rect_from_velo, read_image, read_labels
from jaxsim.detect.results import Detected, result_lines, write_lines
from jaxsim.detect.scenes import View, check_detectable, seen_by
from jaxsim.evaluate.detector import LearnedDetector, find_all, make_find
from jaxsim.files import CHANGED, claim, digest_of_values, files_in, parse_json, stamp, tell_anew, why_anew, write_text
from jaxsim.frame import Boxes
from jaxsim.geometry import camera_at_lidar
from jaxsim.geometry.boxes import lidar_boxes
from jaxsim.metrics.detection.files import read_detections
from jaxsim.progress import check_all_done

_AXES = np.asarray(camera_at_lidar(np.eye(3)).cam_from_velo, np.float64)
AT_LIDAR = View(intrinsics=np.eye(3), cam_from_velo=_AXES, rect_from_velo=_AXES, size=(1, 1))
"""Where boxes are written without a calibration: a camera that stands in the LiDAR. Their rectangles are empty."""

_FIELDS = ("centre_m", "size_m", "yaw_rad", "bbox_px", "truncated", "occluded")


@dataclass(frozen=True)
class CloudFolder:
    """Clouds NAME.bin or NAME.npz, and folders of files of the same names that belong to them."""

    clouds: Path
    calib: Path | None = None
    """Of NAME.txt, KITTI's object calibration."""
    images: Path | None = None
    """Of NAME.png."""
    labels: Path | None = None
    """Of NAME.txt, KITTI's labels."""
    image_size: tuple[int, int] = (375, 1242)
    """Rows and columns of the images where they are not given."""

    def view(self, name: str) -> View:
        """The camera of a cloud. Raises ValueError where its calibration or image is missing."""
        if not self.calib:
            return AT_LIDAR
        path = self.calib / f"{name}.txt"
        size = self.image(name).shape[:2] if self.images else self.image_size
        camera = object_camera(path, size)
        return View(
            np.asarray(camera.intrinsics, np.float64),
            np.asarray(camera.cam_from_velo, np.float64),
            rect_from_velo=object_rect_from_velo(path),
            size=size,
        )

    def image(self, name: str) -> np.ndarray:
        """The image of a cloud, rows x columns x 3, 0..255."""
        if not self.images:
            raise ValueError("detect: there is no folder of images; give --images")
        return read_image(self.images / f"{name}.png")

    def labelled(self, name: str, view: View, kind: str) -> Float[np.ndarray, "g 7"] | None:
        """The labelled boxes of a class in the LiDAR's axes; None where no labels are given."""
        if not self.labels:
            return None
        labels = read_labels(self.labels / f"{name}.txt")
        of_kind = np.array([k == kind for k in labels.kind], bool)
        return lidar_boxes(labels, view.rect_from_velo)[of_kind]

    def detected(self, name: str, results: Path) -> Detected:
        """What a result file in the folder `results` holds, in the LiDAR's axes."""
        listed = read_detections(results, [name])
        boxes = Boxes(**{field: getattr(listed, field) for field in _FIELDS})
        return Detected(
            lidar_boxes(boxes, self.view(name).rect_from_velo).astype(np.float32), listed.score.astype(np.float32)
        )

    def source(self, name: str, cloud: Path) -> str:
        """The stamp of all that a cloud's result depends on; labels are only drawn."""
        beside = (self.calib and self.calib / f"{name}.txt", self.images and self.images / f"{name}.png")
        return stamp([cloud, *(path for path in beside if path)])

    def claim(self, out: Path, learned: LearnedDetector, **about: Any) -> None:
        """Writes OUT/detect.json: all that decides what results hold, the stamps of their clouds (`sources`), and what
        else is to be said `about` them. Removes the results of clouds that have changed since.

        Raises ValueError where OUT holds results of something else, or of nobody knows what.
        """
        path = out / "detect.json"
        made = made_with(learned) | {
            "clouds": str(self.clouds.resolve()),
            "calib": str(self.calib.resolve()) if self.calib else None,
            # Of images each has its own size; without a calibration no rectangle is written.
            "image_size": None if self.images or not self.calib else list(self.image_size),
        }
        there = {file.stem: file for file in files_in(out / "results", ".txt")}
        was: dict[str, str] = {}

        def read(record: bytes) -> dict[str, Any]:
            content = parse_json(record)
            was.update(content.get("sources", {}))
            return content["made"]

        claim(path, made, by="detect", filled=bool(there), read=read)
        now = {file.stem: self.source(file.stem, file) for file in clouds_in(self.clouds)}
        anew = {name: CHANGED for name in sorted({*there} & {*now}) if why_anew(was.get(name, ""), now[name])}
        tell_anew(anew, by="detect")
        for name in anew:
            there.pop(name).unlink()
        # Of what is to be made, before it is: a cloud that changes meanwhile is seen the next time. Of what stays, what
        # was said of it, if anything was.
        sources = {name: was.get(name, "") if name in there else now[name] for name in now}
        write_text(path, json.dumps(about | {"made": made, "sources": sources}, indent=1))


class Found(NamedTuple):
    """What a detector found in clouds that had no result file."""

    objects: int
    clouds: int


def detect_folder(folder: CloudFolder, learned: LearnedDetector, out: Path) -> Found:
    """Writes OUT/results/NAME.txt of every cloud of a folder; one that is there is not made again.

    `CloudFolder.claim` sees to it that those are of the same making. Raises ValueError where there is no cloud, and,
    once the others are done, for those that are broken, or lack intensity, a calibration or an image.
    """
    experiment = learned.experiment
    files = clouds_in(folder.clouds)
    paths = {file.stem: out / "results" / f"{file.stem}.txt" for file in files}
    todo = {file.stem: file for file in files if not paths[file.stem].is_file()}
    views: dict[str, View] = {}
    failures: list[str] = []

    def clouds_to_do() -> Iterator[tuple[str, np.ndarray]]:
        for name, file in todo.items():
            try:
                points, views[name] = read_points(file), folder.view(name)
            except (ValueError, OSError) as error:
                failures.append(str(error))
                continue
            # As in training: a detector that saw only the camera's view would take the rest for something else.
            yield name, points[seen_by(points, views[name])] if folder.calib and experiment.in_image else points

    objects = 0
    finder = make_find(experiment)
    detections = find_all(finder, learned.network, clouds_to_do(), total=len(todo), more_room="raise --max-voxels")
    for name, boxes in detections:
        objects += len(boxes.score)
        write_detections(paths[name], boxes, experiment.detector.anchors.kind, view=views.pop(name))
    check_all_done(failures, len(todo), by="detect")
    return Found(objects, len(todo))


def made_with(learned: LearnedDetector) -> dict[str, Any]:
    """What of a detector decides its results: SHA-256 of its weights, the voxels with their cap, its score limit and
    all else of its settings. Where and on what it was trained is in the weights."""
    weights = digest_of_values(jax.tree.leaves(learned.network))
    settings = TypeAdapter(DetectorExperiment).dump_python(learned.experiment, mode="json")
    return {"weights": weights} | {key: settings[key] for key in ("in_image", "voxels", "detector")}


def write_detections(path: Path, detected: Detected, kind: str, *, view: View) -> None:
    """Writes KITTI's lines; boxes as seen from the LiDAR (AT_LIDAR) have no rectangle in an image."""
    lines = result_lines(detected, kind, view)
    if view is AT_LIDAR:
        words = [line.split() for line in lines]
        # Columns 4 to 7 are the rectangle.
        lines = [" ".join([*w[:4], "0", "0", "0", "0", *w[8:]]) for w in words]
    write_lines(path, lines)


def clouds_in(folder: Path) -> list[Path]:
    """The clouds of a folder, by name. Raises ValueError where there is none, or two of a name."""
    files = clouds.cloud_files(folder)
    if not files:
        why = "there is no such folder" if not folder.is_dir() else f"it holds no {' or '.join(SUFFIXES)}"
        raise ValueError(f"detect: no clouds in {folder}: {why}")
    return files


def read_points(path: Path) -> Float32[np.ndarray, "n 4"]:
    """x, y, z (m) and intensity (0..1) of a file. Raises ValueError where it is broken or lacks intensity."""
    points = read_cloud(path)
    check_detectable(points, path.name)
    return points
