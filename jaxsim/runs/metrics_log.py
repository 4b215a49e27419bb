"""What a training run writes down: metrics.jsonl, TensorBoard if it is installed, and the batch that broke it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from jaxsim.files import parse_json, read_text, real, replacing, write_text
from jaxsim.runs.trackers import Track, trackers

LONGEST_S = 1e9
"""Thirty years: no training takes them."""
LARGEST = 1e9
"""No loss, gradient or score is beyond it: a training that goes there has left the numbers that mean something."""


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """The lines of a metrics.jsonl, each with its `step`; none where there is no such file.

    A last line without its end is what a killed run was writing: it is left out, and the run writes it again. Raises
    ValueError for any other line that is none.
    """
    if not path.is_file():
        return []
    *whole, _ = read_text(path, by="run").split("\n")
    lines = []
    for number, line in enumerate(whole, 1):
        try:
            content = parse_json(line, finite=False)  # a score may have no value
            if not isinstance(content, dict) or type(content.get("step")) is not int:
                raise ValueError("it has no step")
            if not 0 <= real(content.get("seconds", 0)) < LONGEST_S:
                raise ValueError("its seconds cannot be")
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

    With `writes=False` it touches no file: of several processes only the first does.
    """

    def __init__(self, folder: Path, start: int, *, writes: bool = True):
        self.folder = folder
        self.path = folder / "metrics.jsonl"
        self.writes = writes
        self._board: Any = None
        self._trackers: list[Track] = []
        if not writes:
            return
        kept = [line for line in read_metrics(self.path) if line["step"] <= start]
        if self.path.is_file():
            write_text(self.path, "".join(json.dumps(line) + "\n" for line in kept))
        if importlib.util.find_spec("tensorboardX"):
            from tensorboardX import SummaryWriter

            self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=start + 1)
        self._trackers = trackers(folder, start)

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Adds a line to metrics.jsonl, and points to TensorBoard and trackers (`jaxsim.runs.trackers`)."""
        if not self.writes:
            return
        with self.path.open("a") as file:
            file.write(json.dumps({"step": step, **values}) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)
        for track in self._trackers:
            track(step, values)

    def judged(self, step: int) -> bool:
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
            else "the batch is finite: lower --optim.lr, and resume from the last checkpoint with the same command"
        )
        raise TrainingDiverged(f"training: {', '.join(bad)} not finite at step {step}; batch saved to {path}; {cause}")
