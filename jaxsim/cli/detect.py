"""`jaxsim detect`: a folder of clouds to KITTI result files and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.cli.flags import IntoFolder
from jaxsim.config.ranges import Count, Whole
from jaxsim.evaluate.cloud_folder import CloudFolder, clouds_in, detect_folder
from jaxsim.evaluate.detector import load_detector
from jaxsim.progress import counted
from jaxsim.report.clouds import is_drawn, write_detected


@dataclass(frozen=True)
class Detect(IntoFolder):
    """Finds objects in every cloud of a folder.

    Writes KITTI result files (results/NAME.txt) and pictures (pictures/NAME_above.png, and NAME_image.png where there
    is an image) to OUT, and clouds.html, a page that turns the drawn clouds in 3D. A cloud that has a result file is
    not looked at again, unless it has changed since, so that a killed command resumes; OUT's detect.json says what made
    the results, and another detector, cap or folder of clouds is refused there.
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

    def __call__(self) -> None:
        for name in ("images", "labels"):
            if getattr(self, name) and not self.calib:
                raise ValueError(f"detect: --{name} needs --calib, which says where the camera is on the LiDAR")
        learned = load_detector(self.detector, step=self.step).capped(self.max_voxels)
        experiment = learned.experiment
        kind = experiment.detector.anchors.kind
        files = clouds_in(self.clouds)
        self.folder.claim(self.out, learned, detector=str(self.detector), step=self.step or "latest")
        detections = detect_folder(self.folder, learned, self.out)
        drawn = files[: self.pictures]
        if drawn and (detections.clouds or not is_drawn(self.folder, drawn, self.out)):
            sentence = f"{kind}s that {self.detector.name} finds in clouds of {self.clouds.name}."
            write_detected(self.folder, drawn, self.out, experiment=experiment, sentence=sentence)
        already = f"{len(files) - detections.clouds} clouds were there"
        found = f"{detections.objects} of {kind} in {counted(detections.clouds, 'cloud')}"
        print(f"{found}; {already}: {self.out / 'results'}")
        if detections.clouds and not self.calib:
            print("no --calib: boxes are those of a camera that stands in the LiDAR, without rectangles in an image")
            if experiment.in_image:
                print("note: this detector learned from what a camera sees; without --calib it gets the whole cloud")

    @property
    def folder(self) -> CloudFolder:
        """The clouds, and what stands beside them."""
        return CloudFolder(self.clouds, self.calib, self.images, self.labels, self.image_size)
