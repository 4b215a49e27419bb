"""The stages of Real2Sim2Real, one after the other; each leaves out what is done, so that a killed loop resumes."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from jaxsim.config import DetectorExperiment, Experiment, LoopConfig
from jaxsim.data import open_dataset, select
from jaxsim.detect.batches import in_range
from jaxsim.detect.scenes import Scene
from jaxsim.discover import discover_folders
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, score_detector
from jaxsim.export.plan import LabelRules, TreePlan, choose_frames
from jaxsim.export.trees import export_trees
from jaxsim.files import placed, replacing
from jaxsim.metrics.cloud_checks import CloudCounts, count_clouds
from jaxsim.progress import Progress
from jaxsim.report.discovery import write_answer
from jaxsim.report.pictures import Rgb
from jaxsim.report.scenes import TurnedScene
from jaxsim.report.words import verdict_sentence
from jaxsim.runs.frames import judges_of, read_frames
from jaxsim.runs.run import Checkpoints
from jaxsim.simulate.discover_sides import write_both_sides
from jaxsim.simulate.learned_sensor import load
from jaxsim.studies.real2sim2real import REAL, WITH_EFFECTS, Loop
from jaxsim.studies.real2sim2real.charts import check_text, checked_kinds, write_checks
from jaxsim.studies.real2sim2real.page import count_objects, draw_detections, draw_kinds, turned_clouds, write_loop
from jaxsim.studies.real2sim2real.scores import loop_tables, write_score
from jaxsim.train.loop import TRAINER, train_apart

_log = logging.getLogger(__name__)

EPOCHS = 5
"""Last checkpoints of a detector that a score is the average of, as in the paper."""


def check_sources(config: LoopConfig) -> None:
    """Opens all data sets, so that what is missing is told before days go into training.

    Raises ValueError naming the flag of the set that cannot be read, lacks frames, or lacks labels.
    """
    sources = {"intensity.data": config.intensity.data, "detector.data": config.detector.data}
    for flag, source in {**sources, "synthetic": config.synthetic}.items():
        with placed(f"real2sim2real: --{flag}", FileNotFoundError):
            dataset = open_dataset(source)
            places = [*select(source.train, dataset), *select(source.validation, dataset)]
            labelled = flag == "intensity.data" or dataset[places[0]].boxes is not None
        if not labelled:
            raise ValueError(
                f"real2sim2real: --{flag}: frames of {source.kind} have no labels, and detectors need them"
            )


def discover_lacking(loop: Loop) -> None:
    """Writes what `discover` finds the loop's sensor to lack, on frames that it did not learn from."""
    known_effects()
    learned, out = load(loop.intensity), loop.effects.parent
    data = learned.run.experiment.data
    dataset = open_dataset(data)
    judged = judges_of(read_frames(loop.intensity), dataset, frames="", validation=data.validation)
    simulated, measured = write_both_sides(learned, dataset, judged, out=out, log=_log.info)
    result = discover_folders(simulated=simulated, measured=measured, log=_log.info)
    page = write_answer(out, result)
    _log.info(f"{verdict_sentence(result.verdict)} {page}")


def export_kinds(loop: Loop) -> None:
    """Writes the trees of all kinds; the renderer's frames are read once for all."""
    source = loop.config.synthetic
    dataset = open_dataset(source)
    frames = f"{source.train},{source.validation}"
    positions, validation = choose_frames(dataset, frames=frames, validation=source.validation)
    labels = LabelRules(occlusion=loop.config.occlusion if source.kind == "vkitti2" else "levels")
    recipes = {kind: loop.recipe(kind) for kind in loop.config.kinds}
    needed = any(recipe.source == "simulated" for recipe in recipes.values())
    learned = load(loop.intensity) if needed else None
    rows = learned and learned.rows
    plans = [
        TreePlan(
            out=loop.tree(kind),
            source=source,
            positions=positions,
            validation=validation,
            recipe=recipe,
            labels=labels,
            learned=learned if recipe.source == "simulated" else None,
            effects_model=SensorModel.load(loop.effects, rows=rows) if kind in WITH_EFFECTS else None,
        )
        for kind, recipe in recipes.items()
    ]
    export_trees(plans, dataset)


def _classes(scene: Scene) -> list[str]:
    """The classes of the labelled objects. Raises ValueError where there are no labels."""
    if scene.labels is None:
        raise ValueError(f"real2sim2real: {scene.name} has no labels; choose labelled frames")
    return [kind for kind in scene.labels.kind if kind.lower() != "dontcare"]


class Stages:
    """The stages of one loop, in their order; each leaves out what is done."""

    def __init__(
        self,
        loop: Loop,
        *,
        discover: Callable[[Loop], None] = discover_lacking,
        export: Callable[[Loop], None] = export_kinds,
        trainer: Sequence[str] = TRAINER,
    ):
        """`discover` writes what the loop's sensor lacks and `export` the trees of all its kinds. `trainer` is the
        program that trains the experiment of a file."""
        self.loop, self.trainer = loop, trainer
        self.discover_lacking, self.export = discover, export
        self.scenes_of: dict[tuple[str, str], Sequence[Scene]] = {}
        self.counts_of: dict[str, CloudCounts] = {}

    def all(self) -> None:
        """Runs all that is missing, and writes tables and page after each seed."""
        loop = self.loop
        self.log("the sensor: an intensity network on real pairs")
        self.train(loop.intensity, loop.intensity_experiment())
        if {*WITH_EFFECTS} & {*loop.config.kinds}:
            self.log("what the sensor lacks: discover on real frames that it did not learn from")
            self.discover()
        self.log(f"clouds of the renderer's frames: {', '.join(loop.config.kinds)}")
        self.export(loop)
        self.log("the clouds themselves: points on objects, histograms, directions without a return")
        self.checks()
        for seed in loop.config.seeds:
            for kind in loop.trained:
                self.log(f"seed {seed}: a detector of {kind} clouds")
                self.train(loop.detector(kind, seed), loop.detector_experiment(kind, seed))
            self.log(f"seed {seed}: scores")
            for trained, judged in loop.judgements:
                self.score(trained, judged, seed)
            self.log(f"seed {seed}: tables, checks of the clouds, pictures")
            self.report()

    def log(self, words: str) -> None:
        """Logs a line on the progress."""
        _log.info(f"real2sim2real: {words}")

    def train(self, run: Path, experiment: Experiment | DetectorExperiment) -> None:
        """Trains in a process of its own, unless that is done. Ends the program with its status where it fails."""
        if (run / "card.md").is_file():
            return
        settings = self.loop.out / "settings" / f"{'_'.join(run.relative_to(self.loop.out).parts)}.json"
        with replacing(settings) as path:
            path.write_bytes(b'{"experiment": ' + TypeAdapter(type(experiment)).dump_json(experiment, indent=1) + b"}")
        status = train_apart(settings, trainer=self.trainer)
        if status:
            sys.exit(f"error: real2sim2real: training {run} ended with status {status}; the same command resumes")

    def discover(self) -> None:
        """Holds the sensor against real frames, unless that is done."""
        if not (self.loop.effects.parent / "verdict.json").is_file():
            self.discover_lacking(self.loop)

    def scenes(self, kind: str, part: str) -> Sequence[Scene]:
        """Scenes of a kind of cloud: of `train` or of `validation`."""
        if (kind, part) not in self.scenes_of:
            data = self.loop.data_of(kind)
            dataset = open_dataset(data)
            seen = replace(self.loop.config.detector, data=data)
            self.scenes_of[kind, part] = experiment_scenes(dataset, select(getattr(data, part), dataset), seen)
        return self.scenes_of[kind, part]

    def score(self, trained: str, judged: str, seed: int) -> None:
        """Scores the last checkpoints of a detector, unless that is done."""
        loop, experiment = self.loop, self.loop.config.detector
        path, run = loop.score(trained, judged, seed), loop.detector(trained, seed)
        if path.is_file():
            return
        scenes, steps = self.scenes(judged, "validation"), Checkpoints(run).steps[-EPOCHS:]
        find, per_epoch = make_find(experiment), []
        for step in Progress(steps, desc=f"{trained} on {judged}", unit="checkpoint"):
            network = load_detector(run, step=step).network
            per_epoch.append(score_detector(find, network, scenes, experiment=experiment)[0])
        write_score(path, per_epoch, steps=steps, frames=len(scenes))

    def counted(self, kind: str) -> CloudCounts:
        """What the training clouds of a kind hold, inside the detector's range."""
        if kind not in self.counts_of:
            voxels, scenes = self.loop.config.detector.voxels, self.scenes(kind, "train")
            named = (
                (s.points[in_range(s.points, voxels)], s.boxes, _classes(s))
                for s in Progress(scenes, desc=f"counting {kind}", unit="frame", leave=False)
            )
            self.counts_of[kind] = count_clouds(named, range_m=np.array(voxels.range_m, float))
        return self.counts_of[kind]

    def checks(self) -> None:
        """Writes and prints what tells the kinds of clouds apart short of a detector, unless that is done."""
        loop, kinds = self.loop, (REAL, *self.loop.config.kinds)
        if checked_kinds(loop.out) == kinds:
            return
        counts = {kind: self.counted(kind) for kind in kinds}
        drawn = draw_kinds(loop, {kind: self.scenes(kind, "validation") for kind in loop.config.kinds})
        write_checks(loop.out, counts, loop.target, pictures=drawn)
        _log.info(f"\n{check_text(counts, loop.target)}\n\ntables: {loop.out / 'clouds.md'}; pictures beside it")

    def report(self) -> None:
        """Writes and prints all that was scored."""
        loop = self.loop
        counts = {kind: self.counted(kind) for kind in (REAL, *loop.config.kinds)}
        pictures, clouds = self.shown()
        page = write_loop(loop, counts, pictures, clouds=clouds)
        _log.info(f"\n{loop_tables(loop, counts)}\n\ntables, pictures and page: {page}")

    def shown(self) -> tuple[dict[str, Rgb], list[TurnedScene]]:
        """A frame as each kind of cloud, and what each detector of the first seed finds in the fullest real one: as
        pictures, and the latter as clouds that turn."""
        loop = self.loop
        real, seed = max(self.scenes(REAL, "validation"), key=count_objects), loop.config.seeds[0]
        find, boxes = make_find(loop.config.detector), {}
        for kind in loop.trained:
            boxes[kind], _ = find(load_detector(loop.detector(kind, seed)).network, real.points)
        drawn = draw_kinds(loop, {kind: self.scenes(kind, "validation") for kind in loop.config.kinds})
        return drawn | draw_detections(loop, real, boxes), turned_clouds(loop, real, boxes)
