"""`jaxsim real2sim2real`: the paper's loop, from real drives to detectors of simulated clouds, stage by stage."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from pydantic import TypeAdapter
from tqdm import tqdm

from jaxsim.cli.discover import Discover
from jaxsim.cli.export import Export, export_trees
from jaxsim.cli.source import Source
from jaxsim.config import DetectorExperiment, Experiment, LoopConfig
from jaxsim.data import open_dataset, select
from jaxsim.detect.batches import in_range
from jaxsim.detect.scenes import Scene, Scenes
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, score_detector
from jaxsim.files import hold, replacing
from jaxsim.metrics.cloud_checks import CloudCounts, count_clouds
from jaxsim.runs.checkpoints import Checkpoints
from jaxsim.studies.clouds import check_text, checked_kinds, write_checks
from jaxsim.studies.loop import REAL, WITH_EFFECTS, Loop, settle_loop, write_score
from jaxsim.studies.loop_page import draw_kinds, draw_loop, loop_tables, write_loop
from jaxsim.train.experiments import load_loop

EPOCHS = 5
"""Last checkpoints of a detector that a score is the average of, as in the paper."""


@dataclass(frozen=True)
class Real2Sim2Real:
    """The paper's loop: learn the sensor from real drives, simulate with it, train detectors, score on real clouds.

    Trains the intensity network on real pairs; asks `discover` what it lacks; makes clouds of the renderer's frames in
    several kinds (without intensity, 32 lines, simulated intensity with lost rays, the same with the effects found);
    trains a detector on each and one on real clouds; scores all on real, and the real one on all. Tables beside the
    paper's, pictures and one page go to OUT. Any setting is a flag: `--config NAME --help` lists them.
    The same command resumes a killed one.
    """

    config: str = "real2sim2real"
    """One of configs/: real2sim2real (the embedded world), real2sim2real_kitti; or the loop.json of an earlier one."""

    def __call__(self) -> None:
        run([f"--config={self.config}"])


def run(argv: Sequence[str]) -> None:
    """Runs the command on its own flags, those of LoopConfig among them."""
    name, flags = _config_of(argv)
    config, words = load_loop(name)
    intro = f"    jaxsim real2sim2real --config {name}\n\n{Real2Sim2Real.__doc__}\n\n{name}: {words}"
    asked = tyro.cli(
        LoopConfig, args=flags, default=config, description=intro, prog=f"jaxsim real2sim2real --config {name}"
    )
    check_sources(asked)
    hold(asked.out, doing="at work in", instead="another --out")
    Stages(settle_loop(asked), [sys.executable, "-m", "jaxsim.cli", "train"]).all()


def check_sources(config: LoopConfig) -> None:
    """Opens all data sets, so that what is missing is told before days go into training.

    Raises ValueError naming the flag of the set that cannot be read, lacks frames, or lacks labels.
    """
    sources = {"intensity.data": config.intensity.data, "detector.data": config.detector.data}
    for flag, source in {**sources, "synthetic": config.synthetic}.items():
        try:
            dataset = open_dataset(source)
            places = [*select(source.train, dataset), *select(source.validation, dataset)]
            labelled = flag == "intensity.data" or dataset[places[0]].boxes is not None
        except (ValueError, FileNotFoundError) as error:
            raise ValueError(f"real2sim2real: --{flag}: {error}") from error
        if not labelled:
            raise ValueError(
                f"real2sim2real: --{flag}: frames of {source.kind} have no labels, and detectors need them"
            )


def _config_of(argv: Sequence[str]) -> tuple[str, list[str]]:
    """The name after --config, and the other flags."""
    flags = [part for word in argv for part in (word.split("=", 1) if word.startswith("--config=") else [word])]
    if "--config" not in flags:
        return Real2Sim2Real.config, flags
    at = flags.index("--config")
    if at + 1 == len(flags):
        raise ValueError("real2sim2real: --config wants a name: real2sim2real, real2sim2real_kitti, or a loop.json")
    return flags[at + 1], flags[:at] + flags[at + 2 :]


def kinds_of(scene: Scene) -> tuple[str, ...]:
    """Classes of the labels; raises ValueError where there are none."""
    if scene.labels is None:
        raise ValueError(f"real2sim2real: {scene.name} has no labels; choose labelled frames")
    return scene.labels.kind


class Stages:
    """The stages of one loop, in their order; each leaves out what is done."""

    def __init__(self, loop: Loop, trainer: Sequence[str]):
        self.loop, self.trainer = loop, trainer
        self.scenes_of: dict[tuple[str, str], Scenes] = {}
        self.counts_of: dict[str, CloudCounts] = {}

    def all(self) -> None:
        """Runs all that is missing, and writes tables and page after each seed."""
        loop = self.loop
        self.say("the sensor: an intensity network on real pairs")
        self.train(loop.sensor, loop.intensity_experiment())
        if {*WITH_EFFECTS} & {*loop.config.kinds}:
            self.say("what the sensor lacks: discover on real frames that it did not learn from")
            self.discover()
        self.say(f"clouds of the renderer's frames: {', '.join(loop.config.kinds)}")
        self.export()
        self.say("the clouds themselves: points on objects, histograms, directions without a return")
        self.checks()
        for seed in loop.config.seeds:
            for kind in loop.trained:
                self.say(f"seed {seed}: a detector of {kind} clouds")
                self.train(loop.detector(kind, seed), loop.detector_experiment(kind, seed))
            self.say(f"seed {seed}: scores")
            for trained, judged in loop.judgements:
                self.judge(trained, judged, seed)
            self.say(f"seed {seed}: tables, checks of the clouds, pictures")
            self.report()

    def say(self, words: str) -> None:
        print(f"real2sim2real: {words}", flush=True)

    def train(self, run: Path, experiment: Experiment | DetectorExperiment) -> None:
        """Trains with train.py, unless the run is finished. Ends the program with its status where it fails."""
        if (run / "card.md").is_file():
            return
        settings = self.loop.out / "settings" / f"{'_'.join(run.relative_to(self.loop.out).parts)}.json"
        with replacing(settings) as path:
            path.write_bytes(b'{"experiment": ' + TypeAdapter(type(experiment)).dump_json(experiment, indent=1) + b"}")
        status = subprocess.run([*self.trainer, str(settings)]).returncode
        if status:
            sys.exit(f"error: real2sim2real: training {run} ended with status {status}; the same command resumes")

    def discover(self) -> None:
        """Holds the sensor against real frames, unless that is done."""
        if not (self.loop.effects.parent / "verdict.json").is_file():
            Discover(out=self.loop.effects.parent, run=self.loop.sensor)()

    def export(self) -> None:
        """Writes the trees of all kinds; the renderer's frames are read once for all."""
        loop, source = self.loop, self.loop.config.synthetic
        exports = [
            Export(
                out=loop.tree(kind),
                data=Source.of(source),
                frames=f"{source.train},{source.validation}",
                validation=source.validation,
                recipe=loop.recipe(kind),
                run=loop.sensor if loop.recipe(kind).source == "simulated" else None,
                effects=loop.effects if kind in WITH_EFFECTS else None,
                occlusion=loop.config.occlusion if source.kind == "vkitti2" else "levels",
            )
            for kind in loop.config.kinds
        ]
        export_trees(exports, exports[0].dataset())

    def scenes(self, kind: str, part: str) -> Scenes:
        """Scenes of a kind of cloud: of `train` or of `validation`."""
        if (kind, part) not in self.scenes_of:
            data = self.loop.data_of(kind)
            dataset = open_dataset(data)
            seen = replace(self.loop.config.detector, data=data)
            self.scenes_of[kind, part] = experiment_scenes(dataset, select(getattr(data, part), dataset), seen)
        return self.scenes_of[kind, part]

    def judge(self, trained: str, judged: str, seed: int) -> None:
        """Scores the last checkpoints of a detector, unless that is done."""
        loop, experiment = self.loop, self.loop.config.detector
        path, run = loop.score(trained, judged, seed), loop.detector(trained, seed)
        if path.is_file():
            return
        scenes, steps = self.scenes(judged, "validation"), Checkpoints(run).steps[-EPOCHS:]
        find, per_epoch = make_find(experiment), []
        for step in tqdm(steps, desc=f"{trained} on {judged}", unit="checkpoint"):
            per_epoch.append(score_detector(find, load_detector(run, step=step).network, scenes, experiment)[0])
        write_score(path, per_epoch, steps=steps, frames=len(scenes))

    def counted(self, kind: str) -> CloudCounts:
        """What the training clouds of a kind hold, inside the detector's range."""
        if kind not in self.counts_of:
            voxels, scenes = self.loop.config.detector.voxels, self.scenes(kind, "train")
            named = (
                (s.points[in_range(s.points, voxels)], s.boxes, [k for k in kinds_of(s) if k.lower() != "dontcare"])
                for s in tqdm(scenes, desc=f"counting {kind}", unit="frame", leave=False)
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
        write_checks(loop.out, counts, loop.target, drawn)
        print(f"\n{check_text(counts, loop.target)}\n\ntables: {loop.out / 'clouds.md'}; pictures beside it")

    def report(self) -> None:
        """Writes and prints all that was scored."""
        loop = self.loop
        counts = {kind: self.counted(kind) for kind in (REAL, *loop.config.kinds)}
        pictures = draw_loop(loop, {kind: self.scenes(kind, "validation") for kind in (REAL, *loop.config.kinds)})
        page = write_loop(loop, counts, pictures)
        print(f"\n{loop_tables(loop, counts)}\n\ntables, pictures and page: {page}")
