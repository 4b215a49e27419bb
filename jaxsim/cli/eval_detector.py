"""`jaxsim eval RUN` of a detector: KITTI's scores of its last checkpoints, and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxsim.cli.source import Source
from jaxsim.config import RunConfig
from jaxsim.evaluate.detector import mean_curves
from jaxsim.evaluate.runs import score_checkpoints
from jaxsim.report import detection_picture, detection_table, mean_table, save_picture, write_detection
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import load_run

MEAN_OF, PICTURES = 5, 4
"""Checkpoints that the mean is over, and scenes to draw. The paper averages five epochs; a checkpoint is an epoch where
the run saved with `save_every` 0."""


def judge_run(run: Path, data: Source, *, frames: str, out: Path) -> None:
    """Scores the last kept checkpoints on a run's validation frames, or on those of another data set.

    Prints the last one's table and the mean over all, of fewer than five too; writes both (detection.json, .md) and
    pictures to `out`. Raises ValueError where no checkpoint is kept.
    """
    experiment = load_run(run, DetectorRun).experiment
    source = data.config(experiment.data)
    validation = "" if data.foreign else source.validation
    judged = score_checkpoints(run, source, frames=frames, validation=validation, last=MEAN_OF)
    scenes = judged.scenes
    steps = judged.steps
    last = judged.per_step[-1]
    mean = said_mean(steps, experiment.run), mean_curves(judged.per_step)
    about = {"run": str(run), "data": source.kind, "frames": len(scenes), "step": steps[-1], "rules": "official"}
    write_detection(out, last, about=about | {"mean_of_steps": steps}, mean=mean)
    for scene, boxes in zip(scenes, judged.detections[:PICTURES], strict=False):
        save_picture(out / f"{scene.name}.png", detection_picture(scene, boxes, experiment.voxels.range_m, title=""))
    print(f"{len(scenes)} frames of {source.kind}, step {steps[-1]}\n\n{detection_table(last)}\n")
    print(f"{mean[0]}\n\n{mean_table(mean[1])}\n\nscores, curves and pictures: {out}")


def said_mean(steps: Sequence[int], settings: RunConfig) -> str:
    """What a mean is over, and why of fewer checkpoints than the paper's."""
    name = "epochs" if settings.save_every == 0 else f"checkpoints, one every {settings.save_every} steps"
    said = f"AP R40, mean (standard deviation) of the last {len(steps)} {name} (steps {', '.join(map(str, steps))})"
    if len(steps) >= MEAN_OF:
        return said
    why = f"the run keeps {settings.keep}: --run.keep {MEAN_OF}" if settings.keep < MEAN_OF else "no more are there"
    return f"{said}; the paper's is of {MEAN_OF} ({why})"
