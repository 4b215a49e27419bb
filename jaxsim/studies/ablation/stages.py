"""The stages of the ablation: train every network, judge all on the same frames, draw, write the table."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jaxsim.config import DataConfig
from jaxsim.data import open_dataset, select
from jaxsim.evaluate.fid import require_images
from jaxsim.evaluate.paired import baseline_scores
from jaxsim.metrics.inception import Extractor
from jaxsim.pairs.prepared import prepared
from jaxsim.report import save_picture
from jaxsim.simulate.beside_drive import simulate_batch, take
from jaxsim.simulate.predict import make_predict
from jaxsim.simulate.sensor import LearnedSensor, load
from jaxsim.studies.ablation.page import ablation_picture, ablation_table, write_ablation
from jaxsim.studies.ablation.table import MODALITIES, ablation_row, besides, labelled_prepare, named_sensors
from jaxsim.train.loop import TRAINER, train_apart

Rgb = UInt8[np.ndarray, "h w 3"]


def train_all(
    experiment: str,
    out: Path,
    flags: Sequence[str],
    *,
    more: Sequence[str] = (),
    trainer: Sequence[str] = TRAINER,
) -> list[Path]:
    """Trains the experiment once for each of MODALITIES, with `more` inputs, one after the other; the runs' folders.

    `trainer`, a program, itself resumes, refuses a run of other settings, and has nothing to do for one that is
    finished. Ends the program with its exit status where it fails.
    """
    runs = []
    for name, inputs in reversed(MODALITIES.items()):  # combined first: its pairs have labels and serve all
        print(f"ablation: {name} ({', '.join(inputs)})", flush=True)
        named = ["--prepare.inputs", *inputs, *more, "--run.name", name, "--run.out", str(out)]
        status = train_apart(experiment, *flags, *named, trainer=trainer)
        if status:
            sys.exit(f"error: ablation: training {name} ended with status {status}; the same command resumes")
        runs.insert(0, out / name)
    return runs


def compare_networks(
    folders: Sequence[Path],
    out: Path,
    *,
    frames: str = "",
    extractor: Extractor | None = None,
    pictures: int = 4,
    unmeasured: tuple[DataConfig, str] | None = None,
) -> None:
    """Judges the networks of runs on the same frames, and writes and prints their table.

    `frames` are those to judge, by default the runs' validation frames; `unmeasured` is a renderer's data set and its
    frames to draw as well. Raises ValueError for runs that cannot be compared, and for too few frames.
    """
    # Runs: the same frames, targets and settings, other inputs.
    sensors = named_sensors({str(folder): load(folder) for folder in folders})
    experiment = next(iter(sensors.values())).run.experiment
    data, prepare = experiment.data, labelled_prepare(sensors)
    predicts = {name: make_predict(s.generate, s.run.experiment.prepare) for name, s in sensors.items()}

    # Frames: one set for all.
    dataset = open_dataset(data)
    judged = prepared(dataset, select(frames or data.validation, dataset), data, prepare=prepare)
    if extractor:
        require_images(len(judged), extractor)
    baselines = baseline_scores(
        prepared(dataset, select(data.train, dataset), data, prepare=prepare), judged, [None] * len(judged)
    )

    # Scores.
    rows = []
    for name, sensor in sensors.items():
        rows.append(
            ablation_row(
                name, sensor, predicts[name], judged=judged, extractor=extractor, cache=data.cache / "statistics"
            )
        )
        print(f"ablation: {name}: mae {rows[-1].scores['mae'].value:.4f}", flush=True)

    # Pictures: evenly spread over the frames.
    drawn = {}
    for k in np.unique(np.linspace(0, len(judged) - 1, min(pictures, len(judged))).round().astype(int)).tolist():
        pair = judged[k]
        outputs = {name: np.asarray(predicts[name](sensor.params, pair)) for name, sensor in sensors.items()}
        drawn[judged.names[k]] = ablation_picture(pair.painted, outputs, pair.measured)
    if unmeasured:
        drawn |= draw_unmeasured(sensors, *unmeasured)
    for name, picture in drawn.items():
        save_picture(out / "pictures" / f"{name.replace('/', '_')}.png", picture)

    about = {"data": data.kind, "training frames": data.train, "judged frames": str(len(judged))}
    if more := besides(prepare.inputs):
        about["every network also sees"] = ", ".join(more)
    about |= {"updates": str(experiment.optim.steps), "batch": str(experiment.optim.batch)}
    page = write_ablation(out, rows, baselines, pictures=drawn, about=about)
    print(f"\n{ablation_table(rows, baselines)}\n\ntable, page and pictures: {page}")


def draw_unmeasured(sensors: Mapping[str, LearnedSensor], source: DataConfig, frames: str) -> dict[str, Rgb]:
    """Pictures of a renderer's frames, which have no measured intensity."""
    dataset = open_dataset(source)
    pictures = {}
    for position in select(frames, dataset):
        frame = dataset[position]
        outputs = {}
        painted = None
        for name, sensor in sensors.items():
            image, painted, _ = simulate_batch(sensor, [frame], 1)
            outputs[name] = take(image, 0).intensity * take(image, 0).valid
        pictures[f"{source.kind}: {frame.name}"] = ablation_picture(take(painted, 0), outputs, None)
    return pictures
