"""A run's folder: config.json, checkpoints/, metrics.jsonl, figures/, card.md; .lock while it is trained.

Everything that is needed to use the trained sensor again lies in it, without the repository that made it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from pydantic import TypeAdapter, ValidationError

from jaxsim.config import DetectorExperiment, Experiment
from jaxsim.files import claim, lock
from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import LidarSpec

Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Run:
    """What a run was: its settings and the sensor it learned."""

    experiment: Experiment
    spec: LidarSpec
    """The sensor's beams, as fitted to its scans."""
    intrinsics: Matrix
    """Of the camera it was trained with, and that camera's place on the LiDAR."""
    cam_from_velo: Matrix
    image_size: tuple[int, int]
    """Rows and columns of its images."""
    version: str = field(default_factory=lambda: version("jaxsim-lidar"))

    @property
    def camera(self) -> Camera:
        return Camera(np.asarray(self.intrinsics, np.float32), np.asarray(self.cam_from_velo, np.float32))


def describe(experiment: Experiment, spec: LidarSpec, view: CameraFrame) -> Run:
    """The run of an experiment with this sensor and the camera of this view."""
    camera = view.camera
    intrinsics, cam_from_velo = (
        tuple(tuple(round(float(value), 9) for value in row) for row in np.asarray(matrix))
        for matrix in (camera.intrinsics, camera.cam_from_velo)
    )
    return Run(experiment, spec, intrinsics, cam_from_velo, view.rgb.shape[-3:-1])


@dataclass(frozen=True)
class DetectorRun:
    """What a detector's run was."""

    experiment: DetectorExperiment
    steps: int
    """Updates of the whole training, which its cycle of rates depends on."""
    scenes: int
    """Training scenes."""
    version: str = field(default_factory=lambda: version("jaxsim-lidar"))


AnyRun = TypeVar("AnyRun", Run, DetectorRun)
RUNS: dict[type, TypeAdapter] = {Run: TypeAdapter(Run), DetectorRun: TypeAdapter(DetectorRun)}
"""Kinds of runs, and how their config.json is read and written."""


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


def start_run(folder: Path, run: Run | DetectorRun) -> None:
    """Makes the run's folder, or checks that the folder holds this very run; keeps it for this process.

    Raises ValueError where it holds another run, naming the flags that differ, or another process trains in it.
    """
    lock(folder)
    kind = type(run)
    # A detector's rates depend on how long it is to learn.
    free = [name for name in FREE if kind is Run or name != "optim.epochs"]
    claim(
        folder / "config.json",
        _settings(run),
        by="run",
        text=RUNS[kind].dump_json(run, indent=2),
        read=lambda _: _settings(load_run(folder, kind)),
        free=free,
        instead="another --run.name",
    )


def _settings(run: Run | DetectorRun) -> dict[str, Any]:
    """The settings of a run's experiment as plain values."""
    return TypeAdapter(type(run.experiment)).dump_python(run.experiment, mode="json")


def is_detector(folder: Path | str) -> bool:
    """Whether a folder holds a detector's run."""
    return (Path(folder) / "config.json").is_file() and _whose(folder) == "a detector"


def _whose(folder: Path | str) -> str:
    """What the run of a folder trains, in words."""
    content = json.loads((Path(folder) / "config.json").read_bytes())
    if "penet" in content:
        return "a depth completion network"
    return "a detector" if "detector" in content.get("experiment", {}) else "an intensity network"


def load_run(folder: Path | str, kind: type[AnyRun] = Run) -> AnyRun:
    """Reads `config.json`.

    Raises ValueError where the folder is no run, is one of another kind, or holds settings unknown here.
    """
    path = Path(folder) / "config.json"
    if not path.is_file():
        near = sorted(str(p.parent) for p in Path(folder).glob("*/config.json"))
        hint = f"; there are runs at {', '.join(near)}" if near else "; `python train.py` makes one"
        raise ValueError(f"run: no config.json in {folder}{hint}")
    wanted = "a detector" if kind is DetectorRun else "an intensity network"
    if (found := _whose(folder)) != wanted:
        raise ValueError(f"run: {folder} is the run of {found}, not of {wanted}; name another (its card.md has scores)")
    try:
        return RUNS[kind].validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"run: {path} does not fit this version ({version('jaxsim-lidar')}):\n{error}") from error


class Checkpoints:
    """The training state, and the network that is used, by step (orbax).

    Plain arrays are written, whole: a checkpoint says nothing of the devices that made it, and fits any others. Of
    several processes one alone uses it.
    """

    def __init__(self, folder: Path, *, keep: int = 2):
        path, me = (folder / "checkpoints").resolve(), jax.process_index()
        path.mkdir(parents=True, exist_ok=True)
        options = ocp.CheckpointManagerOptions(
            max_to_keep=keep,
            create=False,  # orbax would wait for the other processes there
            enable_async_checkpointing=False,  # written before the call returns: what is announced exists
            multiprocessing_options=ocp.options.MultiprocessingOptions(primary_host=me, active_processes={me}),
        )
        self.manager = ocp.CheckpointManager(path, options=options)

    @property
    def latest(self) -> int | None:
        return self.manager.latest_step()

    @property
    def steps(self) -> list[int]:
        """Steps that are kept, rising."""
        return sorted(self.manager.all_steps())

    def save(self, step: int, **items: Any) -> None:
        """Keeps trees of arrays by name; one of them is `state`."""
        saved = {name: ocp.args.StandardSave(jax.tree.map(np.asarray, tree)) for name, tree in items.items()}
        self.manager.save(step, args=ocp.args.Composite(**saved), force=True)

    def restore(self, item: str, like: Any, *, step: int | None = None) -> Any:
        """An item of a step (by default the latest), in the structure of `like` (arrays or their shapes)."""
        step = self.latest if step is None else step
        if step is None:
            raise ValueError(f"run: no checkpoint in {self.manager.directory}; the training has not saved one yet")
        wanted = jax.tree.map(lambda x: np.broadcast_to(np.zeros((), x.dtype), x.shape), like)
        items = ocp.args.Composite(**{item: ocp.args.StandardRestore(wanted)})
        return jax.tree.map(jnp.asarray, self.manager.restore(step, args=items)[item])
