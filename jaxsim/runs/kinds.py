"""Kinds of networks that are trained: one table, which everything reads that must tell one from another.

A kind is known by the part of its experiment that no other has, so that a config.json says by itself what it is of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from jaxsim.config import DepthExperiment, DetectorExperiment, Experiment
from jaxsim.data.calibration import check_rigid
from jaxsim.files import parse_settings
from jaxsim.frame import Camera
from jaxsim.geometry import LidarSpec

MOST_PX = 1e5
"""No camera has a focal length or an optical axis beyond it."""
Matrix = tuple[tuple[float, ...], ...]
AnyExperiment = Experiment | DetectorExperiment | DepthExperiment


@dataclass(frozen=True)
class Run:
    """What a run was: its settings and the sensor it learned."""

    experiment: Experiment
    spec: LidarSpec
    """The sensor's beams, as fitted to its scans."""
    intrinsics: Matrix
    """Intrinsics of the camera it was trained with, and that camera's place on the LiDAR."""
    cam_from_velo: Matrix
    image_size: tuple[int, int]
    """Rows and columns of its images."""
    version: str = field(default_factory=lambda: version("jaxsim-lidar"))

    def __post_init__(self) -> None:
        shapes = {"intrinsics": (3, 3), "cam_from_velo": (4, 4)}
        wrong = [name for name, shape in shapes.items() if _shape(getattr(self, name)) != shape]
        if wrong:
            raise ValueError(f"{wrong[0]} must be a matrix of {shapes[wrong[0]][0]} rows and columns")
        check_rigid(np.asarray(self.cam_from_velo, float), "cam_from_velo")
        k = np.asarray(self.intrinsics, float)
        if not (np.abs(k) < MOST_PX).all() or not (k[0, 0] > 0 and k[1, 1] > 0) or k[2].tolist() != [0, 0, 1]:
            raise ValueError(f"intrinsics are {k.tolist()}; they must be [fx 0 cx; 0 fy cy; 0 0 1] in pixels")

    @property
    def camera(self) -> Camera:
        """The camera that the run was trained with."""
        return Camera(np.asarray(self.intrinsics, np.float32), np.asarray(self.cam_from_velo, np.float32))


@dataclass(frozen=True)
class DetectorRun:
    """What a detector's run was."""

    experiment: DetectorExperiment
    steps: int
    """Updates of the whole training, which its cycle of rates depends on."""
    scenes: int
    """Training scenes."""
    version: str = field(default_factory=lambda: version("jaxsim-lidar"))


@dataclass(frozen=True)
class DepthRun:
    """What a depth completion's run was."""

    experiment: DepthExperiment
    version: str = field(default_factory=lambda: version("jaxsim-lidar"))


def _shape(matrix: Matrix) -> tuple[int, ...]:
    return len(matrix), *{len(row) for row in matrix}


AnyRun = Run | DetectorRun | DepthRun


@dataclass(frozen=True)
class Kind:
    """One kind of network, and how its runs are made, written and read."""

    name: str
    """The kind in words, with its article."""
    key: str
    """The part of its experiment that no other kind has."""
    experiment: type[Any]
    run: type[Any]
    builder: str
    """`module:function` that makes a `Training` of an experiment; a name, as runs are also loaded below training."""
    bare: bool = False
    """Whether config.json holds the experiment alone."""

    def plain(self, experiment: Any) -> dict[str, Any]:
        """The settings of an experiment as JSON has them."""
        return TypeAdapter[Any](self.experiment).dump_python(experiment, mode="json")

    def dump(self, run: AnyRun) -> bytes:
        """The config.json of a run."""
        if self.bare:
            return TypeAdapter[Any](self.experiment).dump_json(run.experiment, indent=2)
        return TypeAdapter[Any](self.run).dump_json(run, indent=2)

    def parse(self, content: Any) -> Any:
        """The run of a config.json's plain values. Raises ValueError where a setting is unknown here, or out of its
        range."""
        return self.run(parse_settings(self.experiment, content)) if self.bare else parse_settings(self.run, content)


KINDS = (
    Kind("an intensity network", "generator", Experiment, Run, "jaxsim.train.intensity:intensity_training"),
    Kind("a detector", "detector", DetectorExperiment, DetectorRun, "jaxsim.train.detector:detector_training"),
    Kind(
        "a depth completion network", "penet", DepthExperiment, DepthRun, "jaxsim.train.depth:depth_training", bare=True
    ),
)


def kind_of(value: AnyRun | AnyExperiment) -> Kind:
    """The kind of a run or of an experiment."""
    return next(kind for kind in KINDS if isinstance(value, kind.run | kind.experiment))


def kind_in(content: Mapping[str, Any]) -> Kind:
    """The kind of the run whose config.json has this content. Raises ValueError where it is no experiment's."""
    settings = content.get("experiment", content) if isinstance(content, Mapping) else ()
    for kind in KINDS:
        if isinstance(settings, Mapping) and kind.key in settings:
            return kind
    raise ValueError(f"it has none of {', '.join(kind.key for kind in KINDS)}, by which experiments are known")
