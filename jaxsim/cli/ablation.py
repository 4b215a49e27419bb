"""`python eval.py ablation`: networks that differ in their inputs, trained where they are missing, in one table."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxsim.cli.train import parse_experiment
from jaxsim.config import DataKind
from jaxsim.data import open_dataset, select, source_of
from jaxsim.evaluate.fid import require_images
from jaxsim.evaluate.paired import baseline_scores
from jaxsim.metrics.inception import open_extractor
from jaxsim.pairs.prepared import prepared
from jaxsim.report import save_picture
from jaxsim.simulate.beside_drive import simulate_batch, take
from jaxsim.simulate.predict import make_predict
from jaxsim.simulate.sensor import LearnedSensor, load
from jaxsim.studies.ablation import MODALITIES, ablation_row, besides, labelled_prepare, named_sensors
from jaxsim.studies.ablation_page import ablation_picture, ablation_table, write_ablation


@dataclass(frozen=True)
class Ablation:
    """The paper's first table: what each kind of input is worth. Give trained runs, or an experiment to train from.

        python eval.py ablation --runs runs/kitti_step_rgb runs/kitti_step_combined ...
        python eval.py ablation --train ablation --out runs/ablation [-- FLAGS OF train.py]

    `--train` trains the experiment five times, with the inputs rgb, semantic, edges, depth, and all four (combined), to
    OUT/NAME; inputs of the experiment that the paper has not (incidence, range, row) go to all five. A run that is
    finished is not trained again and one that was killed goes on. Writes ablation.md, ablation.json, ablation.html
    (opens from disk) and the pictures (inputs and measurement | five predictions) to OUT.
    """

    runs: tuple[Path, ...] = ()
    """Folders of trained runs that differ in their inputs alone."""
    train: str = ""
    """An experiment of configs/ to train with each kind of input, instead."""
    out: Path = Path("runs/ablation")
    """Where to write, and where `--train` keeps its runs."""
    frames: str = ""
    """Frames to judge: `0-2`, or a part by name: `evaluation`. Empty: the runs' validation frames."""
    fid: str = ""
    """Also the Fréchet Inception distance: weights from `jaxsim convert` (FILE.npz), or `random`: a network of random
    weights, whose score is called frechet_random."""
    fid_features: int = 2048
    """Features of Inception: 2048, or 768, 192, 64 for small sets (another score, under another name)."""
    pictures: int = 4
    """Frames to draw, evenly spread over those that are judged."""
    also: DataKind | None = None
    """Draw frames of this data set too, which no LiDAR measured: `vkitti2`."""
    also_root: Path | None = None
    """Its folder."""
    also_scenes: tuple[str, ...] = ()
    """Its scenes: `Scene01`. None named: all."""
    also_frames: str = "0-1"
    """Frames of it to draw."""


def train_all(
    script: Path, experiment: str, out: Path, flags: Sequence[str], *, more: Sequence[str] = ()
) -> list[Path]:
    """Trains the experiment once for each of MODALITIES, with `more` inputs, one after the other; the runs' folders.

    `train.py` itself resumes, refuses a run of other settings, and has nothing to do for one that is finished. Ends the
    program with its exit status where it fails.
    """
    runs = []
    for name, inputs in reversed(MODALITIES.items()):  # combined first: its pairs have labels and serve all
        print(f"ablation: {name} ({', '.join(inputs)})", flush=True)
        own = ["--prepare.inputs", *inputs, *more, "--run.name", name, "--run.out", str(out)]
        status = subprocess.run([sys.executable, str(script), experiment, *flags, *own]).returncode
        if status:
            sys.exit(f"error: ablation: training {name} ended with status {status}; the same command resumes")
        runs.insert(0, out / name)
    return runs


def ablation(args: Ablation, *, script: Path, flags: Sequence[str], configs: Any) -> None:
    """Runs the command. `script` is train.py, `flags` are for it, `configs` the package of experiments.

    Raises ValueError for runs that cannot be compared, and for flags that do not go together.
    """
    if bool(args.runs) == bool(args.train):
        raise ValueError("ablation: give either --runs FOLDER ... or --train EXPERIMENT")
    if flags and not args.train:
        raise ValueError(f"ablation: {' '.join(flags)}: flags after -- are for training; give --train EXPERIMENT")
    if twice := [run for k, run in enumerate(args.runs) if run.resolve() in {r.resolve() for r in args.runs[:k]}]:
        raise ValueError(f"ablation: {twice[0]} is named twice; name each run once")
    extractor = open_extractor(args.fid, args.fid_features) if args.fid else None
    folders = list(args.runs)
    if args.train:
        asked, _ = parse_experiment([args.train, *flags])
        folders = train_all(script, args.train, args.out, flags, more=besides(asked.prepare.inputs))

    # Runs: the same frames, targets and settings, other inputs.
    sensors = named_sensors({str(folder): load(folder) for folder in folders})
    experiment = next(iter(sensors.values())).run.experiment
    data, prepare = experiment.data, labelled_prepare(sensors)
    predicts = {name: make_predict(s.generate, s.run.experiment.prepare) for name, s in sensors.items()}

    # Frames: one set for all.
    dataset = open_dataset(data)
    judged = prepared(dataset, select(args.frames or data.validation, dataset), data, prepare)
    if extractor:
        require_images(len(judged), extractor)
    baselines = baseline_scores(
        prepared(dataset, select(data.train, dataset), data, prepare), judged, [None] * len(judged)
    )

    # Scores.
    rows = []
    for name, sensor in sensors.items():
        rows.append(ablation_row(name, sensor, predicts[name], judged, extractor, cache=data.cache / "statistics"))
        print(f"ablation: {name}: mae {rows[-1].scores['mae'].value:.4f}", flush=True)

    # Pictures.
    pictures = {}
    for k in np.unique(np.linspace(0, len(judged) - 1, min(args.pictures, len(judged))).round().astype(int)).tolist():
        pair = judged[k]
        outputs = {name: np.asarray(predicts[name](sensor.params, pair)) for name, sensor in sensors.items()}
        pictures[judged.names[k]] = ablation_picture(pair.painted, outputs, pair.measured)
    if args.also:
        pictures |= unmeasured(sensors, args)
    for name, picture in pictures.items():
        save_picture(args.out / "pictures" / f"{name.replace('/', '_')}.png", picture)

    about = {"data": data.kind, "training frames": data.train, "judged frames": str(len(judged))}
    if more := besides(prepare.inputs):
        about["every network also sees"] = ", ".join(more)
    about |= {"updates": str(experiment.optim.steps), "batch": str(experiment.optim.batch)}
    page = write_ablation(args.out, rows, baselines, pictures, about=about)
    print(f"\n{ablation_table(rows, baselines)}\n\ntable, page and pictures: {page}")


def unmeasured(sensors: Mapping[str, LearnedSensor], args: Ablation) -> dict[str, np.ndarray]:
    """Pictures of a renderer's frames, which have no measured intensity."""
    own = next(iter(sensors.values())).run.experiment.data
    dataset = open_dataset(source_of(own, str(args.also), root=args.also_root, scenes=args.also_scenes))
    pictures = {}
    for position in select(args.also_frames, dataset):
        frame = dataset[position]
        outputs = {}
        painted = None
        for name, sensor in sensors.items():
            image, painted, _ = simulate_batch(sensor, [frame], 1)
            outputs[name] = take(image, 0).intensity * take(image, 0).valid
        pictures[f"{args.also}: {frame.name}"] = ablation_picture(take(painted, 0), outputs, None)
    return pictures
