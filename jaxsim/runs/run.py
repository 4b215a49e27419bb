"""Starting a run's folder, or coming back to it, and reading what it holds.

Everything that is needed to use the trained network again lies in it, without the repository that made it.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from jaxsim.config import Experiment
from jaxsim.files import claim, lock
from jaxsim.frame import Array, CameraFrame
from jaxsim.geometry import LidarSpec
from jaxsim.runs.kinds import KINDS, AnyRun, DetectorRun, Kind, Matrix, Run, kind_in, kind_of

Loaded = TypeVar("Loaded", bound=AnyRun)
FREE = (
    "data.cache",
    "optim.steps",
    "optim.epochs",
    "run.log_every",
    "run.save_every",
    "run.picture_every",
    "run.keep",
    "run.distributed",
)
"""Settings that a resumed run may change: none of them changes what was learned so far."""


def describe(experiment: Experiment, spec: LidarSpec, view: CameraFrame) -> Run:
    """The run of an experiment with this sensor and the camera of this view."""
    camera = view.camera
    return Run(
        experiment,
        spec,
        intrinsics=_rounded(camera.intrinsics),
        cam_from_velo=_rounded(camera.cam_from_velo),
        image_size=view.rgb.shape[-3:-1],
    )


def _rounded(matrix: np.ndarray | Array) -> Matrix:
    """Nine decimals: what JSON keeps is what the run holds."""
    return tuple(tuple(round(float(value), 9) for value in row) for row in np.asarray(matrix))


def start_run(folder: Path, run: AnyRun) -> None:
    """Makes the run's folder, or checks that the folder holds this very run; keeps it for this process.

    Raises ValueError where it holds another run, naming the flags that differ, or another process trains in it.
    """
    lock(folder)
    kind = kind_of(run)
    claim(
        folder / "config.json",
        _settings(run),
        by="run",
        text=kind.dump(run),
        read=lambda _: _settings(load_run(folder, type(run))),
        free=[name for name in FREE if name not in kind.fixed],
        instead="another --run.name",
    )


def _settings(run: AnyRun) -> dict[str, Any]:
    """The settings of a run's experiment as plain values."""
    return TypeAdapter(type(run.experiment)).dump_python(run.experiment, mode="json")


def run_kind(folder: Path | str) -> Kind:
    """The kind of the run in a folder. Raises ValueError where there is none, naming the runs below it."""
    path = Path(folder) / "config.json"
    if not path.is_file():
        near = sorted(str(p.parent) for p in Path(folder).glob("*/config.json"))
        hint = f"; there are runs at {', '.join(near)}" if near else "; `python train.py` makes one"
        raise ValueError(f"run: no config.json in {folder}{hint}")
    try:
        return kind_in(json.loads(path.read_bytes()))
    except ValueError as error:
        raise ValueError(f"run: {path} is no run's config.json: {error}") from error


def is_detector(folder: Path | str) -> bool:
    """Whether a folder holds a detector's run."""
    return (Path(folder) / "config.json").is_file() and run_kind(folder).run is DetectorRun


def load_run(folder: Path | str, wanted: type[Loaded] = Run) -> Loaded:
    """Reads `config.json`.

    Raises ValueError where the folder is no run, is one of another kind, or holds settings unknown here.
    """
    kind, path = run_kind(folder), Path(folder) / "config.json"
    if kind.run is not wanted:
        asked = next(kind.name for kind in KINDS if kind.run is wanted)
        raise ValueError(
            f"run: {folder} is the run of {kind.name}, not of {asked}; name another (its card.md has scores)"
        )
    try:
        return kind.parse(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"run: {path} does not fit this version ({version('jaxsim-lidar')}):\n{error}") from error
