"""Scoring a run whole: a learned sensor beside its baselines, or the last checkpoints of a detector."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from jaxsim.config import DataConfig, RunConfig
from jaxsim.data import Dataset, open_dataset
from jaxsim.data.records import PreparedPairs
from jaxsim.data.seen import SplitSide, warn_of_seen, warn_of_seen_pairs
from jaxsim.detect.results import Detected
from jaxsim.detect.scenes import Scene
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, score_detector
from jaxsim.evaluate.intensity import PairedSums, Predict, baseline_sums, coverage, frechet_of_run, network_sums
from jaxsim.metrics import Score
from jaxsim.metrics.detection import Curve
from jaxsim.metrics.frechet import FrechetScore, require_images
from jaxsim.metrics.inception import Extractor
from jaxsim.metrics.paired import difference_of, scene_intervals, total_scores
from jaxsim.pairs.prepared import pairs_before, prepared
from jaxsim.progress import Progress
from jaxsim.runs.frames import RunFrames, judges_of, positions_of, read_frames
from jaxsim.runs.kinds import DetectorRun
from jaxsim.runs.run import Checkpoints, load_run
from jaxsim.simulate.learned_sensor import LearnedSensor
from jaxsim.simulate.predict import make_predict

_log = logging.getLogger(__name__)
MEAN_OF = 5
"""Checkpoints that a run's mean is over. The paper averages five epochs; a checkpoint is an epoch where the run saved
with `save_every` 0."""


@dataclass(frozen=True)
class LearnedSensorScores:
    """What a learned sensor scores on frames, and what pictures of it need."""

    pairs: PreparedPairs
    """The judged frames."""
    predict: Predict
    scores: dict[str, dict[str, Score]]
    """Paired scores of `network` and of each baseline, on the same cells."""
    intervals: dict[str, dict[str, tuple[float, float]]]
    """Of each score, over scenes; none where there are fewer than two."""
    differences: dict[str, tuple[float, float, float]]
    """Mean absolute error of the network minus that of each baseline, and its interval over scenes."""
    scenes: dict[str, dict[str, dict[str, Score]]]
    """Scene -> predictor -> scores."""
    distribution: dict[str, Score]
    """Coverage of the network's quantiles, and the Brier score of its drops; empty where it gives none."""
    frechet: FrechetScore | None
    """Between predicted and measured intensity images; None where no extractor was given."""


def score_learned_sensor(
    learned: LearnedSensor,
    data: DataConfig,
    *,
    frames: str = "",
    validation: str = "",
    recorded: RunFrames | None = None,
    trees: bool = False,
    extractor: Extractor | None = None,
) -> LearnedSensorScores:
    """Scores a learned sensor on frames of a data set, chosen by `judges_of`.

    The baselines are fitted to the training frames of the run's own data set, with `trees` boosted trees too; where
    that is not to be had there are none. The run's frames are those that are `recorded`, whatever joined the data set
    since, and wherever it was moved. Raises ValueError for frames that are not there, and where there are too few for
    the extractor's features.
    """
    # Frames: those to judge, the one before each, and those that the baselines average.
    of_run = learned.run.experiment.data
    prepare = learned.run.experiment.prepare
    dataset = open_dataset(data)
    own = _own_set(of_run, data, dataset, recorded=recorded)
    of_set = recorded if own and _same(data, own) else None
    positions = judges_of(of_set, dataset, frames=frames, validation=validation)
    judged = prepared(dataset, positions, data, prepare=prepare)
    # What `previous frame` copies; it need not be among the judged.
    before = pairs_before(dataset, positions, data, prepare=prepare)
    train = None
    if own:
        own_dataset = dataset if data == own else open_dataset(own)
        learned_from = positions_of(recorded and recorded.train, own_dataset, text=own.train, part="training")
        train = prepared(own_dataset, learned_from, own, prepare=prepare)
        warn_of_seen_pairs(train, judged)
    if extractor:
        require_images(len(judged), extractor.width, name=extractor.score)

    # Scores: the network and the baselines, on the same cells.
    predict = make_predict(learned.generate, prepare)
    networks = network_sums(predict, learned.params, judged)
    sums = {"network": networks, **(baseline_sums(train, judged, before, trees=trees) if train else {})}
    # The previous frame is there of some frames alone: it has scores, and no interval beside the others'.
    whole = {name: frames for name, frames in sums.items() if len(frames) == len(judged)}
    scenes = list(judged.scenes)
    intervals = {name: scene_intervals(frames, scenes) for name, frames in whole.items()}
    others = {name: frames for name, frames in whole.items() if name != "network"}

    # Fréchet distance: images of the network's size, every judged frame once.
    frechet = None
    if extractor:
        settings = {"extractor": extractor, "prepare": prepare, "cache": of_run.cache / "statistics"}
        frechet = frechet_of_run(learned.generate, learned.params, judged, **settings)
    return LearnedSensorScores(
        judged,
        predict,
        scores={name: total_scores(frames) for name, frames in sums.items()},
        intervals=intervals,
        differences={name: difference_of(networks, frames, scenes) for name, frames in others.items()},
        scenes=scores_by_scene(whole, scenes),
        distribution=coverage(predict, learned.params, judged),
        frechet=frechet,
    )


def _own_set(
    of_run: DataConfig, data: DataConfig, dataset: Dataset, *, recorded: RunFrames | None
) -> DataConfig | None:
    """The data set that a run learned from, where it lies now: where the run says, or, if nothing is there any more, in
    the `dataset` of `data` that holds frames which are `recorded`. None, with a warning, where it is not to be had."""
    if of_run.root is None or of_run.root.exists():
        return of_run
    moved = replace(of_run, root=data.root)
    known = {*recorded.train} if recorded else set()
    if _same(data, moved) and (not known or any(dataset.name_of(i) in known for i in range(len(dataset)))):
        return moved
    _log.warning(
        f"{of_run.root}, from which the run learned, is not there: the network is judged without baselines, which are "
        "fitted to those frames"
    )
    return None


def _same(data: DataConfig, of_run: DataConfig) -> bool:
    """Whether frames of the one are called as those of the other: it is the same data set."""
    return data.bare == of_run.bare


def scores_by_scene(sums: Mapping[str, PairedSums], scenes: Sequence[str]) -> dict[str, dict[str, dict[str, Score]]]:
    """Scene -> predictor -> scores; a scene without a cell to score is left out."""
    by_scene: dict[str, dict[str, dict[str, Score]]] = {}
    for scene in dict.fromkeys(scenes):
        positions = [i for i, name in enumerate(scenes) if name == scene]
        parts = {name: [frames[i] for i in positions] for name, frames in sums.items()}
        if sum(frame["cells"] for frame in parts["network"]):
            by_scene[scene] = {name: total_scores(frames) for name, frames in parts.items()}
    return by_scene


@dataclass(frozen=True)
class DetectorScores:
    """What the last checkpoints of a detector score on frames."""

    scenes: Sequence[Scene]
    steps: list[int]
    """The checkpoints."""
    per_step: list[list[Curve]]
    """KITTI's curves of each."""
    detections: Sequence[Detected]
    """What the last of them finds in each scene."""


def score_checkpoints(run: Path, data: DataConfig, *, frames: str = "", validation: str = "") -> DetectorScores:
    """Scores the last MEAN_OF kept checkpoints of a detector's run on frames of a data set (`judges_of`).

    Raises ValueError where no checkpoint is kept, and for frames that are not there or have no labels.
    """
    # As it was trained, but for where the scenes come from.
    trained = load_run(run, DetectorRun).experiment
    experiment = replace(trained, data=data)
    steps = Checkpoints(run).steps[-MEAN_OF:]
    if not steps:
        raise ValueError(f"run: no checkpoint in {run}; the training has not saved one yet")
    dataset = open_dataset(data)
    own = _same(data, trained.data)
    recorded = read_frames(run) if own else None
    positions = judges_of(recorded, dataset, frames=frames, validation=validation)
    if own:
        # Frames of the training that are no longer there cannot be among those that judge.
        learned: list[int] = []
        with suppress(ValueError):
            learned = positions_of(recorded and recorded.train, dataset, text=trained.data.train, part="training")
        names = [dataset.name_of(i) for i in positions]
        warn_of_seen(SplitSide(learned), SplitSide(positions), names=names)
    scenes = experiment_scenes(dataset, positions, experiment)
    find = make_find(experiment)
    per_step: list[list[Curve]] = []
    detections: list[Detected] = []
    for step in Progress(steps, desc="checkpoints", unit="checkpoint"):
        curves, detections = score_detector(find, load_detector(run, step=step).network, scenes, experiment=experiment)
        per_step.append(curves)
    return DetectorScores(scenes, steps, per_step, detections)


def mean_words(steps: Sequence[int], settings: RunConfig) -> str:
    """What a mean is over, and why of fewer checkpoints than the paper's."""
    name = "epochs" if settings.save_every == 0 else f"checkpoints, one every {settings.save_every} steps"
    said = f"AP R40, mean (standard deviation) of the last {len(steps)} {name} (steps {', '.join(map(str, steps))})"
    if len(steps) >= MEAN_OF:
        return said
    why = f"the run keeps {settings.keep}: --run.keep {MEAN_OF}" if settings.keep < MEAN_OF else "no more are there"
    return f"{said}; the paper's is of {MEAN_OF} ({why})"
