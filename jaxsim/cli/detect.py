"""`jaxsim detect`: a folder of clouds to KITTI result files and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from jaxsim.detect.results import Found
from jaxsim.detect.scenes import seen_by
from jaxsim.evaluate.cloud_folder import CloudFolder, cloud_files, read_points, write_detections
from jaxsim.evaluate.detector import LearnedDetector, find_all, load_detector, make_find
from jaxsim.report import draw_above, draw_on_image, save_picture


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
        todo = {file.stem: file for file in files if not self.result(file.stem).is_file()}
        views = {name: self.folder.view(name) for name in todo}

        def clouds() -> Iterator[tuple[str, np.ndarray]]:
            for name, file in todo.items():
                points = read_points(file)
                # As in training: a detector that saw only the camera's view would take the rest for something else.
                yield name, points[seen_by(points, views[name])] if self.calib and experiment.in_image else points

        total = 0
        find, roomier = make_find(experiment), "raise --max-voxels"
        detections = find_all(find, learned.network, clouds(), total=len(todo), more_room=roomier)
        for k, (name, found) in enumerate(detections):
            total += len(found.score)
            if k < self.pictures:
                self.draw(name, read_points(todo[name]), found, learned=learned)
            write_detections(self.result(name), found, kind, view=views[name])
        kept = f"{len(files) - len(todo)} clouds were there"
        print(f"{total} of {kind} in {len(todo)} clouds; {kept}: {self.out / 'results'}")
        if todo and not self.calib:
            print("no --calib: boxes are those of a camera that stands in the LiDAR, without rectangles in an image")
            if experiment.in_image:
                print("note: this detector learned from what a camera sees; without --calib it gets the whole cloud")

    @property
    def folder(self) -> CloudFolder:
        """The clouds and what belongs to them."""
        return CloudFolder(self.clouds, self.calib, self.images, self.labels, self.image_size)

    def claim(self, learned: LearnedDetector) -> None:
        """Writes OUT/detect.json. Raises ValueError where OUT holds results of another making."""
        self.folder.claim(self.out, learned, detector=str(self.detector), step=self.step or "latest")

    def result(self, name: str) -> Path:
        return self.out / "results" / f"{name}.txt"

    def draw(self, name: str, points: np.ndarray, found: Found, *, learned: LearnedDetector) -> None:
        """Writes a cloud's pictures."""
        view = self.folder.view(name)
        labelled = self.folder.labelled(name, view, learned.experiment.detector.anchors.kind)
        boxes = {"found": found.boxes, "score": found.score, "labelled": labelled, "title": name}
        above = draw_above(points, learned.experiment.voxels.range_m, **boxes)
        save_picture(self.out / "pictures" / f"{name}_above.png", above)
        if self.images:
            picture = draw_on_image(self.folder.image(name), view, **boxes)
            save_picture(self.out / "pictures" / f"{name}_image.png", picture)
