"""`python eval.py detection`: KITTI's scores of a detector's result files."""

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


def judge(args: Detection) -> None:
    """Scores, prints and writes."""
    names = frame_list(args.frames) if args.frames else found_frames(args.detections)
    truth, detections = read_truth(args.labels, names), read_detections(args.detections, names)
    passes = len(args.classes) * len(DIFFICULTIES) * len(METRICS) * len(OVERLAP_SETS)
    with tqdm(total=passes, desc="matching", unit="pass") as bar:
        curves = evaluate(truth, detections, rules=args.rules, classes=args.classes, done=bar.update)
    left_out = "" if args.frames else f" of {len(found_frames(args.labels))} labelled (--frames FILE fixes the list)"
    print(f"{len(names)} frames{left_out}, {args.rules} rules\n\n{detection_table(curves)}\n")
    out = args.out or args.detections.resolve().with_name(f"{args.detections.resolve().name}_evaluation")
    about = {"detections": str(args.detections), "labels": str(args.labels), "frames": len(names), "rules": args.rules}
    write_detection(out, curves, about=about)
    print(f"AP R11 (before 2019): {out / 'detection.md'}\nall scores and precision-recall curves: {out}")
