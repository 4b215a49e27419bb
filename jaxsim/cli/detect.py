"""`jaxsim detect`: a folder of clouds to KITTI result files and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.detect.scenes import seen_by
from jaxsim.evaluate.cloud_folder import CloudFolder, cloud_files, read_points, write_detections
from jaxsim.evaluate.detector import LearnedDetector, find_all, load_detector, make_find
from jaxsim.report import cloud_with_boxes, draw_above, draw_on_image, save_picture, write_clouds
from jaxsim.report.scenes import TurnedScene

PAGE = "clouds.html"


@dataclass(frozen=True)
class Detect(Checked):
    """Finds objects in every cloud of a folder.

    Writes KITTI result files (results/NAME.txt) and pictures (pictures/NAME_above.png, and NAME_image.png where there
    is an image) to OUT, and clouds.html, a page that turns the drawn clouds in 3D. A cloud that has a result file is
    not looked at again, so that a killed command resumes; OUT's detect.json says what made the results, and another
    detector, cap or folder of clouds is refused there.
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
    image_size: tuple[Count, Count] = (375, 1242)
    """Rows and columns of the images, where --images is not given."""
    max_voxels: Count | None = None
    """Cap on voxels instead of the detector's own."""
    step: Count | None = None
    """Checkpoint of the run to use; by default its latest."""
    pictures: Whole = 8
    """Clouds to draw."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        return self.out

    def __call__(self) -> None:
        for name in ("images", "labels"):
            if getattr(self, name) and not self.calib:
                raise ValueError(f"detect: --{name} needs --calib, which says where the camera is on the LiDAR")
        learned = load_detector(self.detector, step=self.step).capped(self.max_voxels)
        experiment = learned.experiment
        kind = experiment.detector.anchors.kind
        files = cloud_files(self.clouds)
        self.folder.claim(self.out, learned, detector=str(self.detector), step=self.step or "latest")
        results = {file.stem: self.out / "results" / f"{file.stem}.txt" for file in files}
        todo = {file.stem: file for file in files if not results[file.stem].is_file()}
        views = {name: self.folder.view(name) for name in todo}

        def clouds() -> Iterator[tuple[str, np.ndarray]]:
            for name, file in todo.items():
                points = read_points(file)
                # As in training: a detector that saw only the camera's view would take the rest for something else.
                yield name, points[seen_by(points, views[name])] if self.calib and experiment.in_image else points

        detected = 0
        finder = make_find(experiment)
        detections = find_all(finder, learned.network, clouds(), total=len(todo), more_room="raise --max-voxels")
        for name, boxes in detections:
            detected += len(boxes.score)
            write_detections(results[name], boxes, kind, view=views[name])
        drawn = files[: self.pictures]
        if drawn and (todo or not (self.out / PAGE).is_file()):
            self.write_page([self.draw(file, learned) for file in drawn], kind)
        kept = f"{len(files) - len(todo)} clouds were there"
        print(f"{detected} of {kind} in {len(todo)} clouds; {kept}: {self.out / 'results'}")
        if todo and not self.calib:
            print("no --calib: boxes are those of a camera that stands in the LiDAR, without rectangles in an image")
            if experiment.in_image:
                print("note: this detector learned from what a camera sees; without --calib it gets the whole cloud")

    @property
    def folder(self) -> CloudFolder:
        """The clouds, and what stands beside them."""
        return CloudFolder(self.clouds, self.calib, self.images, self.labels, self.image_size)

    def draw(self, file: Path, learned: LearnedDetector) -> TurnedScene:
        """Writes a cloud's pictures, of its result file so that a resumed command draws the same; gives it for the
        page."""
        name, points = file.stem, read_points(file)
        view, detected = self.folder.view(name), self.folder.detected(name, self.out / "results")
        labelled = self.folder.labelled(name, view, learned.experiment.detector.anchors.kind)
        drawn = {"detected": detected.boxes, "score": detected.score, "labelled": labelled, "title": name}
        pictures = {"above": draw_above(points, learned.experiment.voxels.range_m, **drawn)}
        if self.images:
            pictures["image"] = draw_on_image(self.folder.image(name), view, **drawn)
        for kind, picture in pictures.items():
            save_picture(self.out / "pictures" / f"{name}_{kind}.png", picture)
        return cloud_with_boxes(name, points, detected=detected.boxes, labelled=labelled)

    def write_page(self, scenes: list[TurnedScene], kind: str) -> None:
        """Writes clouds.html, which turns the drawn clouds."""
        write_clouds(
            self.out / PAGE,
            scenes,
            title="jaxsim detect",
            sentence=f"{kind}s that {self.detector.name} finds in clouds of {self.clouds.name}.",
            words="Found boxes are orange, labelled ones green; the crossed side is the front.",
        )
