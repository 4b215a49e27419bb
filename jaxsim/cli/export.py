"""`jaxsim export`: a data set's frames as a tree of the KITTI object benchmark, which detectors train on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from tyro.conf import UseAppendAction

from jaxsim.cli.source import SYNTHETIC, Source
from jaxsim.cloud.kitti_tree import REACH_M
from jaxsim.cluster import spread, with_absolute_paths
from jaxsim.config import CloudRecipe, DataConfig
from jaxsim.config.ranges import Checked, Count, Positive, Share
from jaxsim.data import Dataset, open_dataset
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.simulate.sensor import LearnedSensor, load
from jaxsim.simulate.trees import (
    LabelRules,
    Made,
    Occlusion,
    Todo,
    TreeMaker,
    TreePlan,
    choose_frames,
    export_trees,
)


@dataclass(frozen=True)
class Export(Checked):
    """Writes frames as a KITTI tree: OUT/training/{velodyne, calib, label_2, image_2} and OUT/ImageSets.

    Objects farther than 80 m, and frames in which no object is left, are left out. A frame's number is its place in
    the data set. What is already there is not made again, so that a killed command resumes; export.json says what
    the tree was made with.
    """

    out: Path
    """Folder to write to."""
    data: Source = SYNTHETIC
    """Data set to export."""
    frames: str = ""
    """Frames to export: `0-99`. Empty: all (of the embedded world you must say which)."""
    validation: str = ""
    """Which of them go to ImageSets/val.txt; the others go to train.txt. Empty: all go to both."""
    recipe: CloudRecipe = field(default_factory=CloudRecipe)
    """How the clouds are made."""
    run: Path | None = None
    """Folder of the learned sensor's run, for `--recipe.source simulated`."""
    effects: Path | None = None
    """Effects (sensor.json) that the learned sensor lacks, for `--recipe.projection grid`; `jaxsim discover` writes
    one."""
    effects_from: UseAppendAction[tuple[Path, ...]] = ()
    """A Python file with an effect of your own that --effects names; may be given several times. Its code is run: give
    only files that you have read."""
    occlusion: Occlusion = "levels"
    """Column `occluded` of vkitti2: KITTI's 0, 1, 2 by how much of its box an object fills; the same one level up, so
    that nothing is easy; or the hidden share as a fraction, as the paper has it, which the official evaluation cannot
    read. Other sets have levels of their own."""
    filled: tuple[Share, Share] = (0.5, 0.25)
    """Share of the box that an object fills at least at level 0, and at level 1: an unhidden car fills 0.65 to 0.85."""
    reach_m: Positive = REACH_M
    """Objects farther away are left out."""
    keep_empty: bool = False
    """Write frames without objects too, with an empty label file. OpenPCDet cannot read such a frame for training."""
    workers: Count = 2
    """Frames at work at once."""
    cluster: str | None = None
    """Address of a Dask scheduler, tcp://HOST:8786: make the frames on its workers instead of here. They need jaxsim,
    the data set, the run and OUT under the same paths (docs/many-devices.md)."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        return self.out

    def __call__(self) -> None:
        dataset = self.dataset()
        elsewhere = partial(self.on_cluster, self.cluster) if self.cluster else None
        export_trees([self.plan(dataset)], dataset, workers=self.workers, spread=elsewhere)

    def on_cluster(self, address: str, todo: Sequence[Todo]) -> Iterator[Made]:
        """What became of each frame, made on the workers of a cluster."""
        job = with_absolute_paths(Elsewhere(self, Path.cwd()))
        return (done.result for done in spread(address, job, todo, by="export"))

    def dataset(self) -> Dataset:
        """The data set to export. Raises ValueError where the flags do not fit it."""
        source = self.source
        if source.kind == "synthetic" and not self.frames:
            raise ValueError("export: the embedded world has no end; say which frames: --frames 0-199")
        return open_dataset(source)

    def plan(self, dataset: Dataset) -> TreePlan:
        """The tree to make of the data set's frames. Raises ValueError for flags that name what is not there."""
        known_effects(self.effects_from)
        learned = load(self.run) if self.run else None
        rows = len(learned.window[0].elevation_rad) if learned else None
        positions, validation = choose_frames(dataset, frames=self.frames, validation=self.validation)
        return TreePlan(
            out=self.out,
            source=self.source,
            positions=positions,
            validation=validation,
            recipe=self.recipe,
            labels=LabelRules(self.occlusion, self.filled, self.reach_m, keep_empty=self.keep_empty),
            learned=learned,
            effects_model=SensorModel.load(self.effects, rows=rows) if self.effects else None,
        )

    @property
    def source(self) -> DataConfig:
        """Where the frames come from."""
        if not self.data.foreign:
            raise ValueError("export: no data set was named; give its kind: --data.kind vkitti2")
        return self.data.config()


@dataclass(frozen=True)
class Elsewhere:
    """The command on a worker of a cluster."""

    command: Export
    folder: Path
    """The current one of who gave the command, from which its run may name files."""

    def open(self) -> TreeMaker:
        dataset = self.command.dataset()
        plan = self.command.plan(dataset)
        if plan.learned:
            run = with_absolute_paths(plan.learned.run, self.folder)
            plan = replace(plan, learned=LearnedSensor(run, plan.learned.params))
        return TreeMaker([plan], dataset)
