"""What a training run writes down: metrics.jsonl, TensorBoard if it is installed, and the batch that broke it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from jaxsim.files import replacing


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
        if not writes:
            return
        if self.path.is_file():
            kept = [line for line in self.path.read_text().splitlines() if json.loads(line)["step"] <= start]
            with replacing(self.path) as temporary:
                temporary.write_text("".join(line + "\n" for line in kept))
        if importlib.util.find_spec("tensorboardX"):
            from tensorboardX import SummaryWriter

            self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=start + 1)

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Adds a line to metrics.jsonl, and points to TensorBoard."""
        if not self.writes:
            return
        with self.path.open("a") as file:
            file.write(json.dumps({"step": step, **values}) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)

    def judged(self, step: int) -> bool:
        """Whether the validation scores of a step are written down; their line holds nothing else."""
        lines = self.path.read_text().splitlines() if self.path.is_file() else []
        names = [{*line} - {"step"} for line in map(json.loads, lines) if line["step"] == step]
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
