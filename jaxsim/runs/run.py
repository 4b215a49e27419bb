"""Starting a run's folder, or coming back to it; reading what it holds, and its checkpoints.

Everything that is needed to use the trained network again lies in it, without the repository that made it.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from pydantic import ValidationError

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
        kind.plain(run.experiment),
        by="run",
        text=kind.dump(run),
        read=lambda _: kind.plain(load_run(folder, type(run)).experiment),
        free=[name for name in FREE if name not in kind.fixed],
        instead="another --run.name",
    )


def run_kind(folder: Path | str) -> Kind:
    """The kind of the run in a folder. Raises ValueError where there is none, naming the runs below it."""
    path = Path(folder) / "config.json"
    if not path.is_file():
        near = sorted(str(p.parent) for p in Path(folder).glob("*/config.json"))
        hint = f"; there are runs at {', '.join(near)}" if near else "; `jaxsim train` makes one"
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


class Checkpoints:
    """The training state, and the network that is used, by step (orbax).

    Plain arrays are written, whole: a checkpoint says nothing of the devices that made it, and fits any others. Of
    several processes one alone uses it.
    """

    def __init__(self, folder: Path, *, keep: int = 2):
        path = (folder / "checkpoints").resolve()
        me = jax.process_index()
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
