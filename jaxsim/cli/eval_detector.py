"""`jaxsim eval RUN` of a detector: KITTI's scores of its last checkpoints, and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from jaxsim.cli.source import Source
from jaxsim.config import RunConfig
from jaxsim.data import open_dataset
from jaxsim.data.select import frames_to_judge
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, mean_curves, score_detector
from jaxsim.report import detection_picture, detection_table, mean_table, save_picture, write_detection
from jaxsim.runs.checkpoints import Checkpoints
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
    experiment, checkpoints = load_run(run, DetectorRun).experiment, Checkpoints(run)
    if not checkpoints.steps:
        raise ValueError(f"run: no checkpoint in {run}; the training has not saved one yet")
    source = data.config(experiment.data)
    judged = replace(experiment, data=source)
    dataset = open_dataset(source)
    positions = frames_to_judge(frames, dataset, validation="" if data.foreign else source.validation)
    scenes = experiment_scenes(dataset, positions, judged)
    find = make_find(judged)
    steps = checkpoints.steps[-MEAN_OF:]
    per_step, detections = [], []
    for step in tqdm(steps, desc="checkpoints", unit="checkpoint"):
        curves, detections = score_detector(find, load_detector(run, step=step).network, scenes, judged)
        per_step.append(curves)
    mean = said_mean(steps, experiment.run), mean_curves(per_step)
    about = {"run": str(run), "data": source.kind, "frames": len(scenes), "step": steps[-1], "rules": "official"}
    write_detection(out, per_step[-1], about=about | {"mean_of_steps": steps}, mean=mean)
    for scene, boxes in zip(scenes, detections[:PICTURES], strict=False):
        save_picture(out / f"{scene.name}.png", detection_picture(scene, boxes, judged.voxels.range_m, title=""))
    print(f"{len(scenes)} frames of {source.kind}, step {steps[-1]}\n\n{detection_table(per_step[-1])}\n")
    print(f"{mean[0]}\n\n{mean_table(mean[1])}\n\nscores, curves and pictures: {out}")


def said_mean(steps: Sequence[int], settings: RunConfig) -> str:
    """What a mean is over, and why of fewer checkpoints than the paper's."""
    name = "epochs" if settings.save_every == 0 else f"checkpoints, one every {settings.save_every} steps"
    said = f"AP R40, mean (standard deviation) of the last {len(steps)} {name} (steps {', '.join(map(str, steps))})"
    if len(steps) >= MEAN_OF:
        return said
    why = f"the run keeps {settings.keep}: --run.keep {MEAN_OF}" if settings.keep < MEAN_OF else "no more are there"
    return f"{said}; the paper's is of {MEAN_OF} ({why})"
