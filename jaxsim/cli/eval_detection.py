"""`jaxsim eval detection`: KITTI's scores of a detector's result files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from jaxsim.metrics.detection import CLASSES, DIFFICULTIES, METRICS, OVERLAP_SETS, Rules, evaluate
from jaxsim.metrics.detection.files import found_frames, frame_list, read_detections, read_truth
from jaxsim.report import detection_table, write_detection


@dataclass(frozen=True)
class Detection:
    """KITTI's object evaluation of any detector's result files: AP in 2D, from above and in 3D, and orientation.

    Prints AP R40; writes detection.json (R40, R11, precision and recall at every threshold), detection.md and curves.
    """

    detections: Path
    """Folder of NUMBER.txt with 16 columns a line; an empty file where nothing was found."""
    labels: Path
    """Folder of NUMBER.txt with 15 columns a line (label_2)."""
    frames: Path | None = None
    """File with the number of one frame a line, as ImageSets/val.txt: all of them must be there. Without it, the
    frames that have a file of detections, as the official tool does."""
    rules: Rules = "official"
    """The official tool's, or OpenPCDet's (heights of exactly 25 or 40 px, the case of DontCare, float occlusions)."""
    classes: tuple[str, ...] = tuple(CLASSES)
    """Classes to score."""
    out: Path | None = None
    """Where to write; by default beside the folder of detections, in NAME_evaluation."""

    def __call__(self) -> None:
        names = frame_list(self.frames) if self.frames else found_frames(self.detections)
        truth = read_truth(self.labels, names)
        detections = read_detections(self.detections, names)
        passes = len(self.classes) * len(DIFFICULTIES) * len(METRICS) * len(OVERLAP_SETS)
        with tqdm(total=passes, desc="matching", unit="pass") as bar:
            curves = evaluate(truth, detections, rules=self.rules, classes=self.classes, done=bar.update)
        omitted = "" if self.frames else f" of {len(found_frames(self.labels))} labelled (--frames FILE fixes the list)"
        print(f"{len(names)} frames{omitted}, {self.rules} rules\n\n{detection_table(curves)}\n")
        folder = self.detections.resolve()
        out = self.out or folder.with_name(f"{folder.name}_evaluation")
        compared = {"detections": str(self.detections), "labels": str(self.labels)}
        write_detection(out, curves, about=compared | {"frames": len(names), "rules": self.rules})
        print(f"AP R11 (before 2019): {out / 'detection.md'}\nall scores and precision-recall curves: {out}")
