"""`jaxsim export`: a data set's frames as a tree of the KITTI object benchmark, which detectors train on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from jaxsim.cli.elsewhere import OnWorkers, on_cluster
from jaxsim.cli.flags import SYNTHETIC, DataSource, EffectFiles, IntoFolder, Scheduler
from jaxsim.config import CloudRecipe
from jaxsim.config.ranges import Count, Positive, Share
from jaxsim.data import open_dataset
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.export.plan import LabelRules, Occlusion, TreePlan, choose_frames
from jaxsim.export.trees import TreeMaker, export_trees
from jaxsim.simulate.learned_sensor import LearnedSensor, load


@dataclass(frozen=True)
class Export(OnWorkers, IntoFolder):
    """Writes frames as a KITTI tree: OUT/training/{velodyne, calib, label_2, image_2} and OUT/ImageSets.

    Objects farther than 80 m, and frames in which no object is left, are left out. A frame's number is its place in
    the data set. What is already there is not made again, so that a killed command resumes; export.json says what
    the tree was made with.
    """

    out: Path
    """Folder to write to."""
    data: DataSource = SYNTHETIC
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
    effects_from: EffectFiles = ()
    occlusion: Occlusion = LabelRules.occlusion
    """Column `occluded` of vkitti2: KITTI's 0, 1, 2 by how much of its box an object fills; the same one level up, so
    that nothing is easy; or the hidden share as a fraction, as the paper has it, which the official evaluation cannot
    read. Other sets have levels of their own."""
    filled: tuple[Share, Share] = LabelRules.filled
    """Share of the box that an object fills at least at level 0, and at level 1: an unhidden car fills 0.65 to 0.85."""
    reach_m: Positive = LabelRules.reach_m
    """Objects farther away are left out."""
    keep_empty: bool = LabelRules.keep_empty
    """Write frames without objects too, with an empty label file. OpenPCDet cannot read such a frame for training."""
    workers: Count = 2
    """Frames at work at once."""
    cluster: Scheduler = None

    def __call__(self) -> None:
        maker = self.maker(load)
        export_trees(maker.plans, maker.dataset, workers=self.workers, spread=on_cluster(self, by="export"))

    def maker(self, load_run: Callable[[Path], LearnedSensor]) -> TreeMaker:
        """What makes the tree. Raises ValueError for flags that name what is not there, or do not fit the data set."""
        if self.filled[0] < self.filled[1]:
            raise ValueError(
                f"export: --filled is {self.filled[0]:g} {self.filled[1]:g}; an object at level 0 fills more of its "
                "box than one at level 1: give the larger share first"
            )
        source = self.data.named("export", "--data.kind vkitti2")
        if source.kind == "synthetic" and not self.frames:
            raise ValueError("export: the embedded world has no end; say which frames: --frames 0-199")
        dataset = open_dataset(source)
        known_effects(self.effects_from)
        learned = load_run(self.run) if self.run else None
        positions, validation = choose_frames(dataset, frames=self.frames, validation=self.validation)
        plan = TreePlan(
            out=self.out,
            source=source,
            positions=positions,
            validation=validation,
            recipe=self.recipe,
            labels=LabelRules(self.occlusion, self.filled, self.reach_m, keep_empty=self.keep_empty),
            learned=learned,
            effects_model=SensorModel.load(self.effects, rows=learned and learned.rows) if self.effects else None,
        )
        return TreeMaker([plan], dataset)
