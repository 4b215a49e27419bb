"""`jaxsim eval detection`: KITTI's scores of a detector's result files; and those of a run, for `jaxsim eval RUN`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jaxsim.cli.flags import DataSource
from jaxsim.evaluate.detector import mean_curves
from jaxsim.evaluate.runs import mean_words, score_checkpoints
from jaxsim.files import check_apart
from jaxsim.metrics.detection import DIFFICULTIES, METRICS, OVERLAP_SETS, SCORED, MatchingRules, evaluate
from jaxsim.metrics.detection.files import frame_list, frames_with_results, read_detections, read_truth
from jaxsim.progress import Progress, counted
from jaxsim.report.clouds import detection_picture
from jaxsim.report.detection import detection_table, mean_table, write_detection
from jaxsim.report.pictures import save_pictures
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import load_run


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
    rules: MatchingRules = "official"
    """The official tool's, or OpenPCDet's (heights of exactly 25 or 40 px, the case of DontCare, float occlusions)."""
    classes: tuple[str, ...] = tuple(SCORED)
    """Classes to score."""
    out: Path | None = None
    """Where to write; by default beside the folder of detections, in NAME_evaluation."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        folder = self.detections.resolve()
        return self.out or folder.with_name(f"{folder.name}_evaluation")

    def __call__(self) -> None:
        if not self.classes:
            raise ValueError(f"detection: --classes names none; give some of {', '.join(SCORED)}, or leave it out")
        check_apart(self.writes_to, self.detections, self.labels, by="detection")
        names = frame_list(self.frames) if self.frames else frames_with_results(self.detections)
        truth = read_truth(self.labels, names)
        detections = read_detections(self.detections, names)
        passes = len(self.classes) * len(DIFFICULTIES) * len(METRICS) * len(OVERLAP_SETS)
        with Progress(total=passes, desc="matching", unit="pass") as bar:
            curves = evaluate(truth, detections, rules=self.rules, classes=self.classes, done=bar.update)
        judged = counted(len(names), "frame")
        if not self.frames:
            judged += f" of {len(frames_with_results(self.labels))} labelled (--frames FILE fixes the list)"
        print(f"{judged}, {self.rules} rules\n\n{detection_table(curves)}\n")
        out = self.writes_to
        compared = {"detections": str(self.detections), "labels": str(self.labels)}
        write_detection(out, curves, about=compared | {"frames": len(names), "rules": self.rules})
        print(f"AP R11 (before 2019): {out / 'detection.md'}\nall scores and precision-recall curves: {out}")


def judge_run(run: Path, data: DataSource, *, frames: str, out: Path, pictures: int) -> None:
    """Scores the last kept checkpoints on a run's validation frames, or on those of another data set.

    Prints the last one's table and the mean over all, of fewer than five too; writes both (detection.json, .md) and
    so many `pictures` to `out`. Raises ValueError where no checkpoint is kept.
    """
    experiment = load_run(run, DetectorRun).experiment
    source = data.config(experiment.data)
    judged = score_checkpoints(run, source, frames=frames, validation=data.validation(experiment.data))
    scenes = judged.scenes
    steps = judged.steps
    curves = judged.per_step[-1]
    mean = mean_words(steps, experiment.run), mean_curves(judged.per_step)
    about = {"run": str(run), "data": source.kind, "frames": len(scenes), "step": steps[-1], "rules": "official"}
    write_detection(out, curves, about=about | {"mean_of_steps": steps}, mean=mean)
    both = zip(scenes, judged.detections[:pictures], strict=False)
    range_m = experiment.voxels.range_m
    drawn = ((scene.name, detection_picture(scene, boxes, range_m, title="")) for scene, boxes in both)
    save_pictures(out, drawn, by="eval")
    print(f"{counted(len(scenes), 'frame')} of {source.kind}, step {steps[-1]}\n\n{detection_table(curves)}\n")
    print(f"{mean[0]}\n\n{mean_table(mean[1])}\n\nscores, curves and pictures: {out}")
