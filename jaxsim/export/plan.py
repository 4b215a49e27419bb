"""What a tree of KITTI's layout is to hold: its frames, its labels, and how its clouds are made."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from jaxsim.cloud.kitti_tree import REACH_M
from jaxsim.config import CloudRecipe, DataConfig
from jaxsim.data import Dataset, select
from jaxsim.data.select import select_or_all
from jaxsim.effects.chain import SensorModel
from jaxsim.export.clouds import grid_file
from jaxsim.files import sha256_of
from jaxsim.simulate.learned_sensor import LearnedSensor

UNSAID = ("levels", "own")
"""Settings of a model of effects that records of earlier versions leave out, whatever they were."""

Occlusion = Literal["levels", "never_visible", "paper"]


@dataclass(frozen=True)
class LabelRules:
    """Which objects a tree labels, and what its column `occluded` says of those of vkitti2."""

    occlusion: Occlusion = "levels"
    """KITTI's 0, 1, 2; the same one level up; or the hidden share as a fraction, as the paper has it."""
    filled: tuple[float, float] = (0.5, 0.25)
    """Share of its box that an object fills at least at level 0, and at level 1."""
    reach_m: float = REACH_M
    """Objects farther away are left out."""
    keep_empty: bool = False
    """Whether frames without objects are written."""


@dataclass(frozen=True)
class TreePlan:
    """One tree: its frames, and how their clouds and labels are made."""

    out: Path
    source: DataConfig
    """The data set that the frames are of."""
    positions: list[int]
    """The frames, by their places in the data set; a place is the frame's number in the tree."""
    validation: set[int]
    """Those that go to ImageSets/val.txt, the others to train.txt; none named: all go to both."""
    recipe: CloudRecipe
    labels: LabelRules = LabelRules()
    learned: LearnedSensor | None = None
    effects_model: SensorModel | None = None
    """Effects that the learned sensor lacks."""

    def settings(self) -> dict[str, Any]:
        """All that decides what a frame's files hold, as plain values for export.json."""
        data = self.source
        source = {"data": data.kind} | data.of_frames
        recipe = {f"recipe.{key}": value for key, value in asdict(self.recipe).items()}
        if (grid := grid_file(self.recipe)) is not None:
            recipe["recipe.lines"] = f"grid of SHA-256 {sha256_of(grid)}"
        # A path is no proof that files are the same, but another path is a question; the embedded world has no files.
        root = str(data.root.resolve()) if data.root else None
        files = {} if data.kind == "synthetic" else {"root": root, "rows": data.rows}
        made = {
            "sensor": self.learned and self.learned.fingerprint,
            "effects": self.effects_model and self.effects_model.effects,
        }
        # Keys only where they say something: a tree that was begun without them goes on. Those of UNSAID always, for
        # a record without them is an earlier version's.
        made |= {key: {} for key in UNSAID} | self.effects_model.optional() if self.effects_model else {}
        # As the file gives it back: what is compared with it must have lists for tuples.
        return json.loads(json.dumps(source | files | asdict(self.labels) | recipe | made))


def choose_frames(dataset: Dataset, *, frames: str, validation: str) -> tuple[list[int], set[int]]:
    """The frames to export, all where none are named, and which of them validate.

    Raises ValueError as `select` does, and where those that validate are not among them.
    """
    positions = select_or_all(frames, dataset)
    judged = set(select(validation, dataset)) if validation else set()
    if not judged <= set(positions):
        raise ValueError(f"export: --validation {validation} names frames that --frames does not")
    return positions, judged
