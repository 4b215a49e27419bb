"""Real2Sim2Real: which clouds and trainings it consists of, where they lie, and what was scored so far.

OUT/loop.json         settings; a folder of other settings is refused
OUT/intensity/        the run of the sensor
OUT/discovered/       what `discover` says that it lacks: sensor.json
OUT/trees/KIND/       KITTI trees of the renderer's frames
OUT/detectors/seed0/  a run for each kind, and `real`
OUT/scores/seed0/     TRAINED_on_JUDGED.json
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from jaxsim.config import CloudRecipe, DataConfig, DetectorExperiment, Experiment, LoopConfig
from jaxsim.data.pair_settings import differences
from jaxsim.files import replacing
from jaxsim.metrics.detection import Curve

REAL = "real"
KINDS: dict[str, tuple[CloudRecipe, str]] = {
    "raw_64": (CloudRecipe(source="depth", lines="64"), "depth alone, intensity 0, 64 lines"),
    "raw_32": (CloudRecipe(source="depth", lines="32_of_64"), "depth alone, intensity 0, 32 lines"),
    "simulated_64": (CloudRecipe(source="simulated", lines="64"), "intensity and lost rays of the network, 64 lines"),
    "simulated_grid": (
        CloudRecipe(source="simulated", projection="grid"),
        "intensity and lost rays of the network, on the sensor's own grid",
    ),
    "discovered_grid": (
        CloudRecipe(source="simulated", projection="grid"),
        "the same, with the effects that discover found it to lack",
    ),
}
"""How each kind of cloud is made, and in words. The paper's are the first three: VKITTI 64, VKITTI 32, IntensitySim."""
WITH_EFFECTS = ("discovered_grid",)

PAPER_ON_REAL: dict[str, dict[str, tuple[float, ...]]] = {
    "raw_64": {
        "easy": (63.78, 75.32, 79.93, 80.24, 79.24, 78.58),
        "moderate": (50.50, 62.43, 68.54, 68.91, 66.59, 65.05),
        "hard": (48.70, 62.07, 69.01, 70.02, 66.84, 65.05),
    },
    "raw_32": {
        "easy": (61.40, 73.61, 78.28, 78.62, 77.30, 76.62),
        "moderate": (47.56, 59.57, 65.16, 65.51, 63.73, 61.81),
        "hard": (45.20, 58.15, 64.04, 65.42, 62.90, 60.93),
    },
    "simulated_64": {
        "easy": (63.22, 80.33, 85.69, 86.15, 83.83, 82.10),
        "moderate": (51.74, 70.77, 75.51, 79.71, 72.78, 70.54),
        "hard": (50.27, 69.74, 74.76, 79.07, 71.95, 69.42),
    },
    REAL: {
        "easy": (91.94, 95.36, 98.51, 98.55, 98.46, 98.43),
        "moderate": (82.90, 91.19, 94.78, 95.46, 94.65, 94.52),
        "hard": (80.45, 88.94, 94.49, 94.59, 92.34, 92.14),
    },
}
"""The paper's second table: trained on a kind, scored on KITTI; AP of Car in the order of COLUMNS."""
PAPER_OF_REAL: dict[str, dict[str, tuple[float, ...]]] = {
    "raw_64": {
        "moderate": (88.78, 95.79, 98.94, 99.25, 98.59, 97.89),
        "hard": (77.18, 87.84, 92.47, 93.94, 90.59, 89.51),
    },
    "raw_32": {
        "moderate": (72.93, 90.74, 94.30, 97.54, 89.78, 88.48),
        "hard": (61.20, 80.42, 85.12, 89.96, 79.68, 77.85),
    },
    "simulated_64": {
        "moderate": (86.33, 99.11, 99.89, 99.92, 99.78, 98.35),
        "hard": (81.19, 95.02, 96.89, 96.97, 95.97, 94.37),
    },
}
"""Its third table: trained on KITTI, scored on a kind; nothing is easy there."""


@dataclass(frozen=True)
class Loop:
    """One loop's folder."""

    config: LoopConfig

    @property
    def out(self) -> Path:
        return self.config.out

    @property
    def sensor(self) -> Path:
        """The run of the intensity network."""
        return self.out / "intensity"

    @property
    def effects(self) -> Path:
        """The effects that it lacks."""
        return self.out / "discovered" / "sensor.json"

    @property
    def target(self) -> str:
        """The class that the detectors find."""
        return self.config.detector.detector.anchors.kind

    def tree(self, kind: str) -> Path:
        return self.out / "trees" / kind

    def detector(self, trained: str, seed: int) -> Path:
        return self.out / "detectors" / f"seed{seed}" / trained

    def score(self, trained: str, judged: str, seed: int) -> Path:
        return self.out / "scores" / f"seed{seed}" / f"{trained}_on_{judged}.json"

    @property
    def trained(self) -> tuple[str, ...]:
        """What detectors are trained on, in the order of the table."""
        return (*self.config.kinds, REAL)

    @property
    def judgements(self) -> list[tuple[str, str]]:
        """(trained on, judged on): all on real, and the real one on all."""
        return [(kind, REAL) for kind in self.trained] + [(REAL, kind) for kind in self.config.kinds]

    def recipe(self, kind: str) -> CloudRecipe:
        recipe = KINDS[kind][0]
        return replace(recipe, lines=self.config.lines_32) if kind == "raw_32" else recipe

    def intensity_experiment(self) -> Experiment:
        """The sensor's training, in this folder."""
        own = self.config.intensity
        return replace(own, run=replace(own.run, name="intensity", out=self.out))

    def data_of(self, kind: str) -> DataConfig:
        """Labelled frames of a kind of cloud."""
        if kind == REAL:
            return self.config.detector.data
        cache = self.out / "cache"  # a tree that is deleted and made anew holds other clouds
        return DataConfig(
            kind="kitti_object", root=self.tree(kind), train="train", validation="val", rows="elevation", cache=cache
        )

    def detector_experiment(self, trained: str, seed: int) -> DetectorExperiment:
        """A detector's training, in this folder."""
        own, path = self.config.detector, self.detector(trained, seed)
        run = replace(own.run, name=path.name, out=path.parent, seed=seed)
        return replace(own, data=self.data_of(trained), run=run)


def settle_loop(config: LoopConfig) -> Loop:
    """The loop of these settings; keeps them in its folder. More kinds and more seeds may be asked for later, and all
    else as long as nothing was made.

    Raises ValueError where the folder holds a loop of other settings, naming them, and for settings that cannot be.
    """
    for flag, values in (("kinds", config.kinds), ("seeds", config.seeds)):
        if not values or len({*values}) < len(values):
            raise ValueError(f"real2sim2real: --{flag} are {values}; give some, and each once")
    path, adapter = config.out / "loop.json", TypeAdapter(LoopConfig)
    begun = any((config.out / name).exists() for name in ("intensity", "trees", "detectors"))
    if path.is_file() and begun:
        was = adapter.dump_python(adapter.validate_json(path.read_bytes()), mode="json")
        now = adapter.dump_python(config, mode="json")
        free = ("--kinds", "--seeds", "--out")
        if other := [line for line in differences(was, now) if not line.startswith(free)]:
            raise ValueError(
                f"real2sim2real: {config.out} holds a loop with other settings ({'; '.join(other)}); give another "
                "--out, or delete the folder"
            )
    with replacing(path) as temporary:
        temporary.write_bytes(adapter.dump_json(config, indent=1))
    return Loop(config)


def write_score(path: Path, per_epoch: Sequence[Sequence[Curve]], *, steps: Sequence[int], frames: int) -> None:
    """Keeps AP R40 of every checkpoint."""
    curves = [
        {
            "step": step,
            "ap_r40": {f"{c.metric} {c.overlap_set} {c.difficulty}": c.ap_r40 if c.truths else None for c in curves},
            "labels": {c.difficulty: c.truths for c in curves if (c.metric, c.overlap_set) == ("3d", "0.7")},
        }
        for step, curves in zip(steps, per_epoch, strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"unit": "%", "frames": frames, "checkpoints": curves}, indent=1))


@dataclass(frozen=True)
class Average:
    """AP R40 over the last checkpoints and the seeds, percent."""

    mean: float
    spread: float | None
    """Standard deviation over seeds of the mean over checkpoints; None for one seed."""
    seeds: int
    labels: int


def read_checkpoints(loop: Loop, trained: str, judged: str, seed: int) -> list[dict[str, Any]]:
    """What `write_score` kept of one detector, a dict a checkpoint; none where it is not scored."""
    path = loop.score(trained, judged, seed)
    return json.loads(path.read_text())["checkpoints"] if path.is_file() else []


def read_average(loop: Loop, trained: str, judged: str, column: tuple[str, str], difficulty: str) -> Average | None:
    """A cell of the tables, over the seeds that were scored; None where none was, or no label counts."""
    key, values, labels = f"{column[0]} {column[1]} {difficulty}", [], 0
    for seed in loop.config.seeds:
        checkpoints = read_checkpoints(loop, trained, judged, seed)
        found = [c["ap_r40"][key] for c in checkpoints if c["ap_r40"].get(key) is not None]
        if found:
            values.append(float(np.mean(found)))
            labels = checkpoints[-1]["labels"][difficulty]
    if not values:
        return None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Average(float(np.mean(values)), spread, len(values), labels)
