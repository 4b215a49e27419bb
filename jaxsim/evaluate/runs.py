"""Scoring a run whole: a learned sensor beside its baselines, or the last checkpoints of a detector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from jaxsim.config import DataConfig
from jaxsim.data import open_dataset, select
from jaxsim.data.records import PreparedPairs
from jaxsim.data.select import frames_to_judge
from jaxsim.detect.results import Found
from jaxsim.detect.scenes import Scene
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, score_detector
from jaxsim.evaluate.intensity import Predict, baseline_scores, frechet_of_run, require_images, score_pairs
from jaxsim.metrics import Score
from jaxsim.metrics.detection import Curve
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.metrics.inception import Extractor
from jaxsim.pairs.prepared import pairs_before, prepared
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.simulate.predict import make_predict
from jaxsim.simulate.sensor import LearnedSensor


@dataclass(frozen=True)
class SensorScores:
    """What a learned sensor scores on frames, and what pictures of it need."""

    pairs: PreparedPairs
    """The judged frames."""
    predict: Predict
    scores: dict[str, dict[str, Score]]
    """Paired scores of `network` and of each baseline, on the same cells."""
    frechet: FrechetScore | None
    """Between predicted and measured intensity images; None where no extractor was given."""


def score_sensor(
    learned: LearnedSensor,
    data: DataConfig,
    *,
    frames: str = "",
    validation: str = "",
    extractor: Extractor | None = None,
) -> SensorScores:
    """Scores a learned sensor on frames of a data set, chosen by `frames_to_judge`.

    The baselines average the training frames of the run's own data set. Raises ValueError for frames that are not
    there, and where there are too few for the extractor's features.
    """
    # Frames: those to judge, the one before each, and those that the baselines average.
    own = learned.run.experiment.data
    prepare = learned.run.experiment.prepare
    own_dataset = open_dataset(own)
    dataset = open_dataset(data) if data != own else own_dataset
    positions = frames_to_judge(frames, dataset, validation=validation)
    judged = prepared(dataset, positions, data, prepare=prepare)
    before = pairs_before(dataset, positions, data, prepare=prepare)
    train = prepared(own_dataset, select(own.train, own_dataset), own, prepare=prepare)
    if extractor:
        require_images(len(judged), extractor)

    # Scores: the network and the baselines, on the same cells.
    predict = make_predict(learned.generate, prepare)
    scores = {"network": score_pairs(predict, learned.params, judged), **baseline_scores(train, judged, before)}

    # Fréchet distance: images of the network's size, every judged frame once.
    frechet = None
    if extractor:
        settings = {"extractor": extractor, "prepare": prepare, "cache": own.cache / "statistics"}
        frechet = frechet_of_run(learned.generate, learned.params, judged, **settings)
    return SensorScores(judged, predict, scores, frechet)


@dataclass(frozen=True)
class DetectorScores:
    """What the last checkpoints of a detector score on frames."""

    scenes: Sequence[Scene]
    steps: list[int]
    """The checkpoints."""
    per_step: list[list[Curve]]
    """KITTI's curves of each."""
    detections: Sequence[Found]
    """What the last of them finds in each scene."""


def score_checkpoints(
    run: Path, data: DataConfig, *, frames: str = "", validation: str = "", last: int = 5
) -> DetectorScores:
    """Scores the `last` kept checkpoints of a detector's run on frames of a data set, chosen by `frames_to_judge`.

    Raises ValueError where no checkpoint is kept, and for frames that are not there or have no labels.
    """
    experiment = replace(load_run(run, DetectorRun).experiment, data=data)
    steps = Checkpoints(run).steps[-last:]
    if not steps:
        raise ValueError(f"run: no checkpoint in {run}; the training has not saved one yet")
    dataset = open_dataset(data)
    scenes = experiment_scenes(dataset, frames_to_judge(frames, dataset, validation=validation), experiment)
    find = make_find(experiment)
    per_step: list[list[Curve]] = []
    detections: list[Found] = []
    for step in tqdm(steps, desc="checkpoints", unit="checkpoint"):
        curves, detections = score_detector(find, load_detector(run, step=step).network, scenes, experiment=experiment)
        per_step.append(curves)
    return DetectorScores(scenes, steps, per_step, detections)
