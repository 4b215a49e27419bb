"""`jaxsim detect`: a folder of clouds to KITTI result files and pictures."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import tyro
from pydantic import TypeAdapter

from jaxsim.config import DetectorExperiment
from jaxsim.data.kitti_files import object_camera, object_rect_from_velo, read_image, read_labels, read_velodyne
from jaxsim.detect.results import Found, result_lines, write_lines
from jaxsim.detect.scenes import View, check_points, seen_by
from jaxsim.evaluate.detector import LearnedDetector, find_all, load_detector, make_find
from jaxsim.files import claim
from jaxsim.geometry.boxes import lidar_boxes
from jaxsim.report import draw_above, draw_on_image, save_picture

SUFFIXES = (".bin", ".npz")
AT_LIDAR = View(
    intrinsics=np.eye(3),
    cam_from_velo=np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    rect_from_velo=np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    size=(1, 1),
)
"""Where boxes are written without a calibration: a camera that stands in the LiDAR. Their rectangles are empty."""


@dataclass(frozen=True)
class Detect:
    """Finds objects in every cloud of a folder.

    Writes KITTI result files (results/NAME.txt) and pictures (pictures/NAME_above.png, and NAME_image.png where there
    is an image) to OUT. A cloud that has a result file is not looked at again, so that a killed command resumes; OUT's
    detect.json says what made the results, and another detector, cap or folder of clouds is refused there.
    """

    detector: Annotated[Path, tyro.conf.Positional]
    """Folder of a detector's run, or published weights that `jaxsim convert voxel_rcnn_car` wrote."""
    clouds: Path
    """Folder of NAME.bin (KITTI: x, y, z, intensity, float32) or NAME.npz (xyz, intensity)."""
    out: Path
    """Folder to write to."""
    calib: Path | None = None
    """Folder of NAME.txt, KITTI's object calibration. Without it boxes are written as seen by a camera that stands in
    the LiDAR, with empty rectangles in the image."""
    images: Path | None = None
    """Folder of NAME.png to draw on; needs --calib."""
    labels: Path | None = None
    """Folder of NAME.txt with labels to draw; needs --calib."""
    image_size: tuple[int, int] = (375, 1242)
    """Rows and columns of the images, where --images is not given."""
    max_voxels: int | None = None
    """Cap on voxels instead of the detector's own."""
    step: int | None = None
    """Checkpoint of the run to use; by default its latest."""
    pictures: int = 8
    """Clouds to draw."""

    def __call__(self) -> None:
        for name in ("images", "labels"):
            if getattr(self, name) and not self.calib:
                raise ValueError(f"detect: --{name} needs --calib, which says where the camera is on the LiDAR")
        learned = load_detector(self.detector, step=self.step)
        experiment = learned.experiment
        if self.max_voxels:
            experiment = replace(experiment, voxels=replace(experiment.voxels, max_voxels=self.max_voxels))
        learned = replace(learned, experiment=experiment)
        kind = experiment.detector.anchors.kind
        files = cloud_files(self.clouds)
        self.claim(learned)
        todo = [file for file in files if not self.result(file).is_file()]
        files_of = {file.stem: file for file in todo}
        views = {name: self.view(name) for name in files_of}

        def clouds() -> Iterator[tuple[str, np.ndarray]]:
            for name, file in files_of.items():
                points = read_cloud(file)
                # As in training: a detector that saw only the camera's view would take the rest for something else.
                yield name, points[seen_by(points, views[name])] if self.calib and experiment.in_image else points

        total = drawn = 0
        finds = find_all(
            make_find(experiment), learned.network, clouds(), total=len(todo), more_room="raise --max-voxels"
        )
        for name, found in finds:
            total += len(found.score)
            if drawn < self.pictures:
                points = read_cloud(files_of[name])
                self.draw(name, points, found, view=views[name], kind=kind, range_m=experiment.voxels.range_m)
                drawn += 1
            lines = result_lines(found, kind, views[name])
            if not self.calib:
                lines = [without_rectangle(line) for line in lines]
            write_lines(self.out / "results" / f"{name}.txt", lines)
        there = len(files) - len(todo)
        print(f"{total} of {kind} in {len(todo)} clouds; {there} clouds were there: {self.out / 'results'}")
        if todo and not self.calib:
            print("no --calib: boxes are those of a camera that stands in the LiDAR, without rectangles in an image")
            if experiment.in_image:
                print("note: this detector learned from what a camera sees; without --calib it gets the whole cloud")

    def claim(self, learned: LearnedDetector) -> None:
        """Writes OUT/detect.json: all that decides what results hold.

        Raises ValueError where OUT holds results of something else, or of nobody knows what.
        """
        path = self.out / "detect.json"
        made = made_with(learned) | {
            "clouds": str(self.clouds.resolve()),
            "calib": str(self.calib.resolve()) if self.calib else None,
            "image_size": None if self.images or not self.calib else list(self.image_size),
        }
        about = {"detector": str(self.detector), "step": self.step or "latest"}
        claim(
            path,
            made,
            by="detect",
            text=json.dumps(about | {"made": made}, indent=1),
            filled=any((self.out / "results").glob("*.txt")),
            read=lambda record: json.loads(record)["made"],
        )

    def result(self, file: Path) -> Path:
        return self.out / "results" / f"{file.stem}.txt"

    def view(self, name: str) -> View:
        """The camera of a cloud. Raises ValueError where its calibration or image is missing."""
        if not self.calib:
            return AT_LIDAR
        path = self.calib / f"{name}.txt"
        size = read_image(self.images / f"{name}.png").shape[:2] if self.images else self.image_size
        camera = object_camera(path, size)
        matrices = (np.asarray(m, np.float64) for m in (camera.intrinsics, camera.cam_from_velo))
        return View(*matrices, rect_from_velo=object_rect_from_velo(path), size=size)

    def draw(
        self, name: str, points: np.ndarray, found: Found, *, view: View, kind: str, range_m: tuple[float, ...]
    ) -> None:
        """Writes a cloud's pictures."""
        labelled = None
        if self.labels:
            labels = read_labels(self.labels / f"{name}.txt")
            mine = np.array([k == kind for k in labels.kind], bool)
            labelled = lidar_boxes(labels, view.rect_from_velo)[mine]
        boxes = {"found": found.boxes, "score": found.score, "labelled": labelled, "title": name}
        save_picture(self.out / "pictures" / f"{name}_above.png", draw_above(points, range_m, **boxes))
        if self.images:
            image = read_image(self.images / f"{name}.png")
            save_picture(self.out / "pictures" / f"{name}_image.png", draw_on_image(image, view, **boxes))


def made_with(learned: LearnedDetector) -> dict[str, Any]:
    """What of a detector decides its results: SHA-256 of its weights, the voxels with their cap, its score limit and
    all else of its settings. Where and on what it was trained is in the weights."""
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(learned.network):
        digest.update(np.ascontiguousarray(leaf).tobytes())
    settings = TypeAdapter(DetectorExperiment).dump_python(learned.experiment, mode="json")
    return {"weights": digest.hexdigest()} | {key: settings[key] for key in ("in_image", "voxels", "detector")}


def without_rectangle(line: str) -> str:
    """A result line whose rectangle in the image is empty."""
    words = line.split()
    return " ".join([*words[:4], "0", "0", "0", "0", *words[8:]])


def cloud_files(folder: Path) -> list[Path]:
    """The clouds of a folder, by name. Raises ValueError where there is none, or two of a name."""
    files = sorted(f for f in folder.iterdir() if f.suffix in SUFFIXES) if folder.is_dir() else []
    if not files:
        there = "there is no such folder" if not folder.is_dir() else f"it holds no {' or '.join(SUFFIXES)}"
        raise ValueError(f"detect: no clouds in {folder}: {there}")
    twice = [file.stem for file, after in pairwise(files) if file.stem == after.stem]
    if twice:
        raise ValueError(f"detect: {folder} holds {twice[0]} twice, as {' and '.join(SUFFIXES)}; leave one")
    return files


def read_cloud(path: Path) -> np.ndarray:
    """x, y, z (m) and intensity (0..1) of a file. Raises ValueError where it is broken or lacks intensity."""
    if path.suffix == ".bin":
        points = np.column_stack(read_velodyne(path))
    else:
        try:
            with np.load(path) as archive:
                parts = [archive[name] for name in ("xyz", "intensity") if name in archive]
        except (zipfile.BadZipFile, EOFError, OSError, ValueError) as error:
            raise ValueError(f"detect: {path} is no readable .npz ({error})") from error
        if not parts:
            raise ValueError(f"detect: {path} holds no array xyz (n, 3); `jaxsim simulate --formats npz` writes it")
        points = np.column_stack(parts).astype(np.float32)
    check_points(points, path.name)
    return points
