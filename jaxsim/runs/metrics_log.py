"""What a training run writes down: metrics.jsonl, TensorBoard if it is installed, and the batch that broke it; and
where metrics go besides: trackers, by entry points of the group `jaxsim.metrics_log`.

JAXSIM_METRICS_LOG names the trackers of a run (`wandb`, `mlflow`, or those of installed packages), separated by commas.
Nothing is sent anywhere unless it is set. An entry point is a function of a run's folder and of the step that the run
begins after; it returns a function of a step and its values, which is called with every line of metrics.jsonl. If that
has a `close` (as a `Tracker` has), it is called once the training ends: `close(failed=...)`, true where an error or an
interrupt ended it.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import os
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from uuid import uuid4

import numpy as np

from jaxsim.files import parse_json, read_text, real, replacing, write_text

LARGEST = float(np.finfo(np.float32).max)
"""What a training computes with holds no larger one. Gradients that are clipped may be of any norm before."""
GROUP = "jaxsim.metrics_log"
ASKED = "JAXSIM_METRICS_LOG"
Track = Callable[[int, Mapping[str, float]], None]
"""Takes a step and its values."""


class Tracker(NamedTuple):
    """A function of a step and its values that has an end."""

    track: Track
    close: Callable[..., object]
    """Of `failed`, by name."""

    def __call__(self, step: int, values: Mapping[str, float]) -> None:
        self.track(step, values)


_log = logging.getLogger(__name__)


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """The lines of a metrics.jsonl, each with its `step`; none where there is no such file.

    A last line without its end is what a killed run was writing: it is left out, and the run writes it again. Raises
    ValueError for any other line that is none.
    """
    if not path.is_file():
        return []
    *whole, _ = read_text(path, by="run", grows=True).split("\n")
    lines = []
    for number, line in enumerate(whole, 1):
        try:
            content = parse_json(line, finite=False)  # a score may have no value
            if not isinstance(content, dict) or type(content.get("step")) is not int:
                raise ValueError("it has no step")
            for name, value in content.items():
                _check_number(name, value)
        except ValueError as error:
            raise ValueError(
                f"run: {path}, line {number} is not what a training writes there ({error}); remove that line, and the "
                "same command resumes"
            ) from error
        lines.append(content)
    return lines


def _check_number(name: str, value: Any) -> None:
    """Raises ValueError where it is none that a training writes; of scores alone some may have no value."""
    if name.startswith("validation/") and isinstance(value, float) and not np.isfinite(value):
        return
    if not abs(real(value)) <= LARGEST:
        raise ValueError(f"{name} is {value}")


class TrainingDiverged(ValueError):
    """A loss or gradient is no longer finite."""


class MetricsLog:
    """Writes the metrics of one run; lines after `start` are taken out first, for a resumed run writes them again.

    With `writes=False` it touches no file: of several processes only the first does. As a context it ends what it has
    begun, TensorBoard's file and the trackers' runs.
    """

    def __init__(self, folder: Path, start: int, *, writes: bool = True):
        self.folder = folder
        self.path = folder / "metrics.jsonl"
        self.writes = writes
        self._board: Any = None
        self._trackers: dict[str, Track] = {}
        self._ends: dict[str, Callable[..., object]] = {}
        if not writes:
            return
        lines = [line for line in read_metrics(self.path) if line["step"] <= start]
        if self.path.is_file():
            write_text(self.path, "".join(json.dumps(line) + "\n" for line in lines))
        if importlib.util.find_spec("tensorboardX"):
            from tensorboardX import SummaryWriter

            self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=start + 1)
        self._trackers = trackers(folder, start)
        # Also of those that fail meanwhile and get no more.
        self._ends = {name: track.close for name, track in self._trackers.items() if hasattr(track, "close")}

    def __enter__(self) -> MetricsLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._board is not None:
            self._board.close()
        for name, close in self._ends.items():
            try:
                close(failed=kind is not None)
            except Exception as error:  # nor must it hide the error that ended a training
                _log.warning(
                    "run: the tracker %s did not end its run (%s: %s); metrics.jsonl has all of it",
                    *(name, type(error).__name__, error),
                )

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Adds a line to metrics.jsonl, and points to TensorBoard and trackers (`jaxsim.runs.metrics_log`)."""
        if not self.writes:
            return
        with self.path.open("a") as file:
            file.write(json.dumps({"step": step, **values}) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)
        for name, track in [*self._trackers.items()]:
            try:
                track(step, values)
            except Exception as error:  # a tracker must not end a training
                del self._trackers[name]
                _log.warning(
                    "run: the tracker %s failed at step %d (%s: %s) and gets no more; metrics.jsonl goes on",
                    *(name, step, type(error).__name__, error),
                )

    def validated(self, step: int) -> bool:
        """Whether the validation scores of a step are written down; their line holds nothing else."""
        names = [{*line} - {"step"} for line in read_metrics(self.path) if line["step"] == step]
        return any(all(name.startswith("validation/") for name in line) for line in names)

    def stop_on_nan(self, step: int, batch: Mapping[str, Any], metrics: Mapping[str, Any]) -> NoReturn:
        """Saves the batch and raises TrainingDiverged."""
        path = self.folder / f"diverged_{step:06d}.npz"
        if self.writes:
            with replacing(path) as temporary:
                arrays: dict[str, Any] = {key: np.asarray(value) for key, value in batch.items()}
                np.savez_compressed(temporary, **arrays)
        bad = [name for name, value in metrics.items() if name != "finite" and not np.isfinite(value)]
        unclean = [key for key, value in batch.items() if not np.isfinite(np.asarray(value)).all()]
        cause = (
            f"the batch itself holds NaN or infinity in {', '.join(unclean)}: look at the frames"
            if unclean
            else "the batch is finite, so that the network's own steps were too large: lower --optim.lr (of depth "
            "completion that of its stages) and give another --run.name, for a run keeps the rate that it was begun "
            "with; the checkpoints of this one are from before, and can be used"
        )
        raise TrainingDiverged(f"training: {', '.join(bad)} not finite at step {step}; batch saved to {path}; {cause}")


def trackers(folder: Path, start: int) -> dict[str, Track]:
    """JAXSIM_METRICS_LOG's trackers by name. Raises ValueError for one that is not installed or does not start."""
    names = [name.strip() for name in os.environ.get(ASKED, "").split(",") if name.strip()]
    known = {point.name: point for point in entry_points(group=GROUP)}
    made: dict[str, Track] = {}
    for name in names:
        if name not in known:
            raise ValueError(
                f"run: {ASKED} names {name!r}, which is no tracker; known ones are "
                f"{', '.join(sorted(known)) or 'none'} (entry points of the group {GROUP})"
            )
        try:
            made[name] = known[name].load()(folder, start)
        except Exception as error:
            raise ValueError(
                f"run: the tracker {name} does not start ({type(error).__name__}: {error}); mend it, or leave it out "
                f"of {ASKED}"
            ) from error
    return made


def wandb(folder: Path, start: int) -> Tracker:
    """Weights & Biases: one run a folder, resumed with it; WANDB_PROJECT and the like set the rest."""
    client, kept = _client("wandb"), folder / "wandb.id"
    # Not the folder's name, which others of the project may have, and one before that was deleted.
    if not kept.is_file():
        write_text(kept, uuid4().hex)
    run = client.init(dir=str(folder), id=read_text(kept, by="run"), name=folder.name, resume="allow")
    return Tracker(
        lambda step, values: run.log(dict(values), step=step), lambda failed: run.finish(exit_code=int(failed))
    )


def mlflow(folder: Path, start: int) -> Tracker:
    """MLflow: one run a folder, resumed with it; MLFLOW_TRACKING_URI and the like set the rest."""
    client, kept = _client("mlflow"), folder / "mlflow.id"
    if kept.is_file():
        client.start_run(run_id=read_text(kept, by="run"))
    else:
        write_text(kept, client.start_run(run_name=folder.name).info.run_id)
    # MLflow's names hold letters, digits, _ - . / and spaces alone.
    return Tracker(
        lambda step, values: client.log_metrics({name.replace("@", "_at_"): v for name, v in values.items()}, step),
        lambda failed: client.end_run("FAILED" if failed else "FINISHED"),
    )


def _client(name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{name} is not installed: pip install {name}") from error
