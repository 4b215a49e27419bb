"""Starting a run's folder, or coming back to it; reading what it holds, and its checkpoints.

Everything that is needed to use the trained network again lies in it, without the repository that made it.
"""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, partial
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar

import jax
import numpy as np
import orbax.checkpoint as ocp

from jaxsim.config import Experiment
from jaxsim.config.ranges import Role, settings_of
from jaxsim.files import check_size, claim, digest, first_line, lock, placed, read_json
from jaxsim.frame import Array, CameraFrame
from jaxsim.geometry import LidarSpec
from jaxsim.runs.frames import FRAMES, RunFrames, read_frames, write_frames
from jaxsim.runs.kinds import KINDS, AnyExperiment, AnyRun, DetectorRun, Kind, Matrix, Run, kind_in, kind_of

Loaded = TypeVar("Loaded", bound=AnyRun)
_LOOP_CLOSED = "Event loop is closed"
MOST_CHECKPOINT = 64 * 2**30
"""Bytes of one file of a checkpoint."""
SUMS = "sha256"
"""Item of a checkpoint that holds the SHA-256 of the others."""
RESUMED: tuple[Role, ...] = ("kept", "used", "lasts")
"""Roles of settings that a resumed run may change: none of them changes what was learned so far."""


def describe_run(experiment: Experiment, spec: LidarSpec, view: CameraFrame) -> Run:
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


def start_run(folder: Path, run: AnyRun, frames: RunFrames | None = None) -> None:
    """Makes the run's folder, or checks that the folder holds this very run; keeps it for this process.

    `frames` are kept beside it, where it begins; of a run that an earlier version began nobody knows which they were.
    Raises ValueError where it holds another run, naming the flags that differ, or another process trains in it.
    """
    lock(folder)
    _claim(folder, run.experiment)
    # Before config.json, by which a run has begun: killed in between, it would be taken for an earlier version's.
    if frames is not None and (not (folder / "config.json").is_file() or (folder / FRAMES).is_file()):
        write_frames(folder, frames)
    _claim(folder, run.experiment, text=kind_of(run).dump(run))


def check_folder(folder: Path, experiment: AnyExperiment) -> None:
    """Raises ValueError where the folder holds another run than this experiment's, and OSError where it cannot be
    written to: what `start_run` would say, before time goes into the frames. Leaves nothing there."""
    place = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    try:
        with TemporaryFile(dir=place):
            pass
    except OSError as error:
        error.filename = str(folder)
        raise
    _claim(folder, experiment)


def _claim(folder: Path, experiment: AnyExperiment, *, text: bytes | None = None) -> None:
    kind = kind_of(experiment)
    claim(
        folder / "config.json",
        kind.plain(experiment),
        by="run",
        text=text,
        # A run that has saved something began with settings, wherever their file has gone.
        filled=(folder / "config.json").is_file() or any((folder / "checkpoints").glob("*")),
        read=lambda _: kind.plain(load_run(folder, kind.run).experiment),
        free=[*settings_of(kind.experiment, *RESUMED), *_moved(folder, kind)],
        instead="another --run.name",
    )


def _moved(folder: Path, kind: Kind) -> list[str]:
    """Settings that say where data lie and are not true any more, of a run that knows its frames by name: these are
    looked for wherever the data are now."""
    with suppress(ValueError):  # what is damaged is told by who needs it
        if read_frames(folder):
            experiment = load_run(folder, kind.run).experiment
            places = {name: attrgetter(name)(experiment) for name in settings_of(kind.experiment, "file")}
            return [name for name, place in places.items() if isinstance(place, Path) and not place.exists()]
    return []


def _read(folder: Path | str) -> tuple[Kind, Any]:
    """The kind of the run in a folder, and what its config.json holds. Raises ValueError where there is none, naming
    those below or beside it."""
    path = Path(folder) / "config.json"
    if not path.is_file():
        # A folder of runs was given, or a run's name mistyped.
        near = sorted(Path(folder).glob("*/config.json")) or sorted(Path(folder).parent.glob("*/config.json"))
        there = (
            f"there are runs at {', '.join(str(one.parent) for one in near)}" if near else "`jaxsim train` makes one"
        )
        raise ValueError(f"run: no config.json in {folder}; {there}; `embedded` names the packaged sensor")
    content = read_json(path, by="run")
    with placed(f"run: {path} is no run's config.json"):
        return kind_in(content), content


def is_detector(folder: Path | str) -> bool:
    """Whether a folder holds a detector's run."""
    return (Path(folder) / "config.json").is_file() and _read(folder)[0].run is DetectorRun


def load_run(folder: Path | str, wanted: type[Loaded] = Run) -> Loaded:
    """Reads `config.json`.

    Raises ValueError where the folder is no run, is one of another kind, or holds settings unknown here.
    """
    kind, content = _read(folder)
    if kind.run is not wanted:
        asked = next(kind.name for kind in KINDS if kind.run is wanted)
        raise ValueError(
            f"run: {folder} is the run of {kind.name}, not of {asked}; name another (its card.md has scores)"
        )
    with placed(f"run: {Path(folder) / 'config.json'} does not fit this version ({version('jaxsim-lidar')})"):
        return kind.parse(content)


class Checkpoints:
    """The training state, and the network that is used, by step (orbax).

    Plain arrays are written, whole: a checkpoint says nothing of the devices that made it, and fits any others. Of
    several processes one alone uses it. Beside them it keeps the SHA-256 of each item's arrays, with which `restore`
    compares what it reads: the format's own sums cover little of it.
    """

    def __init__(self, folder: Path, *, keep: int = 2):
        self.folder, self.keep = (folder / "checkpoints").resolve(), keep

    @cached_property
    def manager(self) -> ocp.CheckpointManager:
        """Orbax's, opened where it is first needed: looking for checkpoints makes no folder.

        Raises ValueError where a file is none (a pipe, at which reading would wait for ever), or orbax's own are
        damaged.
        """
        me = jax.process_index()
        self.folder.mkdir(parents=True, exist_ok=True)
        for path in self.folder.rglob("*"):
            if not path.is_dir():
                check_size(path, by="run", most=MOST_CHECKPOINT)
        options = ocp.CheckpointManagerOptions(
            max_to_keep=self.keep,
            create=False,  # orbax would wait for the other processes there
            enable_async_checkpointing=False,  # written before the call returns: what is announced exists
            multiprocessing_options=ocp.options.MultiprocessingOptions(primary_host=me, active_processes={me}),
        )
        try:
            return ocp.CheckpointManager(self.folder, options=options)
        except Exception as error:  # of orbax's own and those of its JSON
            raise ValueError(
                f"run: {self.folder} holds a damaged checkpoint ({first_line(error)}); remove its folder"
            ) from error

    @property
    def latest(self) -> int | None:
        """The last step that is kept; None where there is none."""
        return max(self.steps, default=None)

    @property
    def steps(self) -> list[int]:
        """Steps that are kept, rising."""
        return sorted(self.manager.all_steps()) if self.folder.is_dir() else []

    def save(self, step: int, **items: Any) -> None:
        """Keeps trees of arrays by name; one of them is `state`. Raises OSError where the disk does not take them."""
        plain = {name: jax.tree.map(np.asarray, tree) for name, tree in items.items()}
        saved: dict[str, Any] = {name: ocp.args.StandardSave(tree) for name, tree in plain.items()}
        saved[SUMS] = ocp.args.JsonSave({name: _digest(tree) for name, tree in plain.items()})
        try:
            with _told_once():
                self.manager.save(step, args=ocp.args.Composite(**saved), force=True)
        except (OSError, ValueError, RuntimeError) as error:
            # What the system says ends tensorstore's long words.
            why = str(error).strip().rpartition(": ")[2]
            raise OSError(
                f"run: step {step} cannot be saved in {self.folder} ({why}); make room, or mend what is said; the same "
                "command then goes on from the step before"
            ) from error

    def restore(self, item: str, like: Any, *, step: int | None = None) -> Any:
        """An item of a step (by default the latest), in the structure of `like` (arrays or their shapes).

        Raises ValueError where there is none, where it is damaged, differs from its SHA-256, or is of another network
        than `like`; warns where an earlier version kept none.
        """
        step = self.latest if step is None else step
        if step is None:
            raise ValueError(f"run: no checkpoint in {self.folder}; the training has not saved one yet")
        wanted = jax.tree.map(lambda x: np.broadcast_to(np.zeros((), x.dtype), x.shape), like)
        wanted_items: dict[str, Any] = {item: ocp.args.StandardRestore(wanted)}
        if summed := (self.folder / str(step) / SUMS).exists():
            wanted_items[SUMS] = ocp.args.JsonRestore()
        try:
            with _told_once():
                restored = self.manager.restore(step, args=ocp.args.Composite(**wanted_items))
            if summed and restored[SUMS][item] != _digest(restored[item]):
                raise ValueError("its arrays differ from the SHA-256 that they were saved with")
        except Exception as error:
            # Orbax, tensorstore and their codecs each have errors of their own for bytes that are not theirs.
            others = ", ".join(str(other) for other in self.steps if other != step)
            way_out = (
                f"remove {self.folder / str(step)}, and the latest of the other steps ({others}) is used"
                if others
                else "no other step is kept: bring that folder back from a copy, or train again in another folder"
            )
            raise ValueError(
                f"run: step {step} in {self.folder} is damaged, or of another network ({first_line(error)}); {way_out}"
            ) from error
        # Orbax gives arrays in the shapes that they were saved in, whatever was wanted.
        if other := _other_shape(restored[item], wanted):
            raise ValueError(
                f"run: step {step} in {self.folder} is of another network than config.json beside it: {other}; put "
                "back the settings that the run was trained with"
            )
        if not summed:
            warnings.warn(
                f"run: step {step} in {self.folder} was saved without a SHA-256 by an earlier version; it "
                "is not verified",
                stacklevel=2,
            )
        return jax.device_put(restored[item])


@contextmanager
def _told_once() -> Iterator[None]:
    """Keeps Orbax and tensorstore from printing tracebacks where saving or reading fails: the error comes anyway.

    In the block Orbax logs one of each of its threads, and asyncio one of each that nobody asks for. Tensorstore tells
    the loop, which is closed by then, of each array that it had still in hand, also after the block: where the block
    fails these words of a closed loop, and no others, stay unheard.
    """
    loggers, heard = [logging.getLogger(name) for name in ("absl", "asyncio")], sys.unraisablehook
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    # Once: where an earlier block has failed it is there.
    if not (isinstance(heard, partial) and heard.func is _unless_loop_closed):
        sys.unraisablehook = partial(_unless_loop_closed, heard)
    try:
        yield
        sys.unraisablehook = heard
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _unless_loop_closed(heard: Callable[[Any], object], lost: Any) -> None:
    """Hands what nobody can catch to `heard`, but for tensorstore's words to a closed loop."""
    if str(lost.exc_value) != _LOOP_CLOSED:
        heard(lost)


def _digest(tree: Any) -> str:
    """SHA-256 of a tree's arrays and of their places in it."""
    leaves, _ = jax.tree.flatten_with_path(tree)
    return digest({jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves})


def _other_shape(tree: Any, wanted: Any) -> str:
    """The first array whose shape differs from the wanted one's, in words; empty where none does."""
    there, _ = jax.tree.flatten_with_path(tree)
    for (path, leaf), like in zip(there, jax.tree.leaves(wanted), strict=True):
        if leaf.shape != like.shape:
            name = jax.tree_util.keystr(path, simple=True, separator="/")
            return f"{name} has the shape {leaf.shape} there, and {like.shape} by the settings"
    return ""
