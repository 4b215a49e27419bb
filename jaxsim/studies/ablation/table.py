"""The paper's first table: networks that differ in their inputs alone, on the same frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from jaxsim.config import Experiment, InputName, PrepareConfig
from jaxsim.evaluate.fid import frechet_of_run
from jaxsim.evaluate.paired import Predict, score_pairs
from jaxsim.metrics import Score
from jaxsim.metrics.frechet import FrechetScore
from jaxsim.metrics.inception import Extractor
from jaxsim.pairs.prepared import PreparedPairs
from jaxsim.simulate.sensor import LearnedSensor

MODALITIES: dict[str, tuple[InputName, ...]] = {
    "rgb": ("rgb",),
    "semantic": ("semantic",),
    "edges": ("edges",),
    "depth": ("depth",),
    "combined": ("rgb", "depth", "semantic", "edges"),
}
"""The five networks of the paper, by the names of its table."""

PAPER_FID = {"rgb": 89.44, "semantic": 77.01, "edges": 102.61, "depth": 81.43, "combined": 73.81}
"""FID that the paper's first table gives, after 20 epochs on KITTI-STEP."""


@dataclass(frozen=True)
class AblationRow:
    """One network of the table."""

    name: str
    inputs: tuple[str, ...]
    scores: dict[str, Score]
    """Of each cell: `mae`, `rmse`, `psnr`, `ssim`, `drop_iou`, `drop_f1`."""
    frechet: FrechetScore | None
    """Between predicted and measured images; None where none was asked for."""


def besides(inputs: Sequence[InputName]) -> tuple[InputName, ...]:
    """Those that the paper has not, as the laser line: every network of a table has the same of them."""
    return tuple(name for name in inputs if name not in MODALITIES["combined"])


def modality(inputs: Sequence[InputName]) -> str:
    """The name of a network by the paper's inputs that it has: the paper's name, or the inputs themselves."""
    own = [name for name in inputs if name in MODALITIES["combined"]]
    return next((name for name, paper in MODALITIES.items() if set(own) == set(paper)), "+".join(own) or "none")


def named_sensors(sensors: Mapping[str, LearnedSensor]) -> dict[str, LearnedSensor]:
    """Sensors by the name of their inputs, those of the paper in its order, then others as they were given.

    `sensors` are by the name of their run. Raises ValueError for two networks of the same inputs, and for runs that
    learned from other frames, targets or windows, naming the settings that differ.
    """
    first = next(iter(sensors))
    reference = _compared(sensors[first].run.experiment)
    named: dict[str, LearnedSensor] = {}
    for run, sensor in sensors.items():
        settings = _compared(sensor.run.experiment)
        if other := [key for key in settings if settings[key] != reference[key]]:
            told = ", ".join(f"{key} is {settings[key]!r} and {reference[key]!r}" for key in other)
            raise ValueError(f"ablation: {run} and {first} differ in more than their inputs: {told}; train them alike")
        name = modality(sensor.run.experiment.prepare.inputs)
        if name in named:
            raise ValueError(f"ablation: two runs have the inputs {name}, one of them is {run}; leave one out")
        named[name] = sensor
    order = [*MODALITIES, *named]
    return dict(sorted(named.items(), key=lambda item: order.index(item[0])))


def _compared(experiment: Experiment) -> dict[str, Any]:
    """Settings in which runs of one table must agree: all that decides what is learned, but for the inputs."""
    data = replace(experiment.data, cache=Path(), root=experiment.data.root and experiment.data.root.resolve())
    parts = {
        "data": data,
        "prepare": replace(experiment.prepare, inputs=besides(experiment.prepare.inputs)),
        **{name: getattr(experiment, name) for name in ("generator", "discriminator", "loss", "optim")},
    }
    return {f"{part}.{key}": value for part, config in parts.items() for key, value in vars(config).items()}


def labelled_prepare(sensors: Mapping[str, LearnedSensor]) -> PrepareConfig:
    """How to prepare the frames that all networks are judged on: with labels where any of them sees them."""
    settings = [sensor.run.experiment.prepare for sensor in sensors.values()]
    return next((s for s in settings if {"semantic", "edges"} & {*s.inputs}), settings[0])


def ablation_row(
    name: str,
    sensor: LearnedSensor,
    predict: Predict,
    *,
    judged: PreparedPairs,
    extractor: Extractor | None,
    cache: Path,
) -> AblationRow:
    """Scores of one network. Raises ValueError where there are too few frames for the Fréchet distance."""
    prepare, frechet = sensor.run.experiment.prepare, None
    scores = score_pairs(predict, sensor.params, judged)
    if extractor:
        frechet = frechet_of_run(
            sensor.generate, sensor.params, judged, extractor=extractor, prepare=prepare, cache=cache
        )
    return AblationRow(name, tuple(prepare.inputs), scores, frechet)
