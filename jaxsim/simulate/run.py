"""A run's folder: config.json, checkpoints/, metrics.jsonl, figures/, card.md; .lock while it is trained.

Everything that is needed to use the trained sensor again lies in it, without the repository that made it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from pydantic import TypeAdapter, ValidationError

from jaxsim.atomic import replacing
from jaxsim.config import Experiment
from jaxsim.frame import Camera, CameraFrame
from jaxsim.geometry import LidarSpec
from jaxsim.simulate.lock import hold

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


RUN = TypeAdapter(Run)


def _differences(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Flags in which two experiments differ."""
    if isinstance(old, dict):
        for key in old:
            yield from _differences(old[key], new[key], f"{name}.{key}" if name else key)
    elif old != new:
        yield f"--{name} was {old}, now {new}"


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


def start_run(folder: Path, run: Run) -> None:
    """Makes the run's folder, or checks that the folder holds this very run; keeps it for this process.

    Raises ValueError where it holds another run, naming the flags that differ, or another process trains in it.
    """
    hold(folder)
    if (folder / "config.json").is_file():
        was, now = (TypeAdapter(Experiment).dump_python(r.experiment, mode="json") for r in (load_run(folder), run))
        other = [d for d in _differences(was, now) if d.split()[0][2:] not in FREE]
        if other:
            raise ValueError(
                f"run: {folder} holds a run with other settings ({'; '.join(other)}); "
                "give this one another --run.name, or delete the folder"
            )
    with replacing(folder / "config.json") as path:
        path.write_bytes(RUN.dump_json(run, indent=2))


def load_run(folder: Path | str) -> Run:
    """Reads `config.json`. Raises ValueError where the folder is no run, or holds settings unknown here."""
    path = Path(folder) / "config.json"
    if not path.is_file():
        near = sorted(str(p.parent) for p in Path(folder).glob("*/config.json"))
        hint = f"; there are runs at {', '.join(near)}" if near else "; `python train.py` makes one"
        raise ValueError(f"run: no config.json in {folder}{hint}")
    try:
        return RUN.validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"run: {path} does not fit this version ({version('jaxsim-lidar')}):\n{error}") from error


class Checkpoints:
    """The training state and the averaged generator, by step (orbax).

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

    def save(self, step: int, *, state: Any, generator: Any) -> None:
        state, generator = (jax.tree.map(np.asarray, tree) for tree in (state, generator))
        items = ocp.args.Composite(state=ocp.args.StandardSave(state), generator=ocp.args.StandardSave(generator))
        self.manager.save(step, args=items, force=True)

    def restore(self, item: str, like: Any) -> Any:
        """`state` or `generator` of the latest step, in the structure of `like` (arrays or their shapes)."""
        if self.latest is None:
            raise ValueError(f"run: no checkpoint in {self.manager.directory}; the training has not saved one yet")
        wanted = jax.tree.map(lambda x: np.broadcast_to(np.zeros((), x.dtype), x.shape), like)
        items = ocp.args.Composite(**{item: ocp.args.StandardRestore(wanted)})
        return jax.tree.map(jnp.asarray, self.manager.restore(self.latest, args=items)[item])
