"""`python eval.py runs/NAME` of a detector: KITTI's scores of its last epochs, and pictures."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from pathlib import Path

from tqdm import tqdm

from jaxsim.data import open_dataset, select, source_of
from jaxsim.report import detection_picture, detection_table, save_picture, write_detection
from jaxsim.report.markdown import markdown_table
from jaxsim.simulate import (
    Checkpoints,
    DetectorRun,
    experiment_scenes,
    load_detector,
    load_run,
    make_find,
    mean_curves,
    score_detector,
)

EPOCHS, PICTURES = 5, 4
"""Checkpoints that the mean is over, as in the paper, and scenes to draw."""


def judge_run(
    run: Path, *, data: str, root: Path | None, scenes: tuple[str, ...], frames: str, out: Path | None
) -> None:
    """Scores the last kept checkpoints on a run's validation frames, or on those of another data set.

    Prints the last one's table and the mean over all; writes both and pictures to RUN/evaluation. Raises ValueError
    where no checkpoint is kept.
    """
    experiment, checkpoints = load_run(run, DetectorRun).experiment, Checkpoints(run)
    if not checkpoints.steps:
        raise ValueError(f"run: no checkpoint in {run}; the training has not saved one yet")
    source = source_of(experiment.data, data, root=root, scenes=scenes)
    judged = replace(experiment, data=source)
    dataset = open_dataset(source)
    foreign = data != "same"
    positions = select(frames or (f"0-{len(dataset) - 1}" if foreign else source.validation), dataset)
    found_in = experiment_scenes(dataset, positions, judged)
    find, steps = make_find(judged), checkpoints.steps[-EPOCHS:]
    per_step, found = [], []
    for step in tqdm(steps, desc="checkpoints", unit="checkpoint"):
        curves, found = score_detector(find, load_detector(run, step=step).network, found_in, judged)
        per_step.append(curves)
    out = out or run / ("evaluation" if not foreign else f"evaluation_{data}")
    about = {"run": str(run), "data": source.kind, "frames": len(found_in), "step": steps[-1], "rules": "official"}
    write_detection(out, per_step[-1], about=about)
    for scene, detections in zip(found_in, found[:PICTURES], strict=False):
        picture = detection_picture(scene, detections, judged.voxels.range_m, title="")
        save_picture(out / f"{scene.name}.png", picture)
    print(f"{len(found_in)} frames of {source.kind}, step {steps[-1]}\n\n{detection_table(per_step[-1])}\n")
    means = mean_curves(per_step)
    print(f"mean (and standard deviation) of the last {len(steps)} checkpoints, AP R40\n")
    rows = []
    for overlap, metric in (("0.7", "3d"), ("0.7", "bev"), ("0.5", "3d"), ("0.5", "bev"), ("0.7", "bbox")):
        cells = [means.get((metric, overlap, level), (float("nan"),) * 2) for level in ("easy", "moderate", "hard")]
        words = ["-" if isnan(mean) else f"{mean:.2f} ({spread:.2f})" for mean, spread in cells]
        rows.append([f"{overlap} {metric}", *words])
    print(markdown_table(["overlap set, metric", "easy", "moderate", "hard"], rows))
    print(f"\nscores, curves and pictures: {out}")
