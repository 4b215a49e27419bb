"""Flags that several commands share.

The frames that a command reads are one group of flags for every command, `--data.kind`, `--data.root` ...
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.config import DataConfig, FrameSource
from jaxsim.config.ranges import Checked
from jaxsim.data import Dataset, open_dataset, source_of
from jaxsim.runs.frames import judges_of, read_frames


class IntoFolder(Checked):
    """Flags of a command that writes to a folder."""

    out: Path

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        return self.out


EffectFiles = Annotated[
    tyro.conf.UseAppendAction[tuple[Path, ...]],
    tyro.conf.arg(
        help="A Python file with an effect of your own (`jaxsim effects new NAME` writes one), to be known beside the "
        "catalogue; may be given several times. Its code is run: give only files that you have read."
    ),
]
"""The flag `--effects-from` of every command that has it."""
Scheduler = Annotated[
    str | None,
    tyro.conf.arg(
        help="Address of a Dask scheduler, tcp://HOST:8786: do the work on its workers instead of here. They need "
        "jaxsim, the data set, the run and OUT under the same paths (docs/many-devices.md)."
    ),
]
"""The flag `--cluster`."""


@dataclass(frozen=True)
class DataSource(FrameSource):
    """A data set. What is not given is as the run has it, or, in commands without a run, as in training."""

    @property
    def foreign(self) -> bool:
        """Whether another data set than a run's own is named."""
        return self.kind != "same"

    @classmethod
    def of(cls, config: DataConfig) -> DataSource:
        """The flags that name the data set of a config."""
        return cls(**{field.name: getattr(config, field.name) for field in fields(cls)})

    def config(self, of_run: DataConfig | None = None) -> DataConfig:
        """The data set's settings; `of_run` are those of the command's run."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return source_of(of_run or DataConfig(), **given)

    def named(self, by: str, example: str) -> DataConfig:
        """The data set's settings, for a command without a run. Raises ValueError where no data set was named."""
        if not self.foreign:
            raise ValueError(f"{by}: no data set was named; give its kind: {example}")
        return self.config()

    def validation(self, of_run: DataConfig) -> str:
        """The frames that a run judges by where it is asked for no others: of another data set all, which is ""."""
        return "" if self.foreign else of_run.validation

    def open(self, of_run: DataConfig, *, frames: str, run: Path) -> tuple[Dataset, list[int]]:
        """The data set, and the positions in it that `frames` names, as `choose` has them."""
        dataset = open_dataset(self.config(of_run))
        return dataset, self.choose(dataset, of_run, frames=frames, run=run)

    def choose(self, dataset: Dataset, of_run: DataConfig, *, frames: str, run: Path) -> list[int]:
        """The positions in the data set that `frames` names; where it is empty, those of the validation frames of the
        run in a folder, by name: their text may name others once drives have joined, which the run learned from.

        Raises ValueError where there are none.
        """
        recorded = None if self.foreign else read_frames(run)
        return judges_of(recorded, dataset, frames=frames, validation=self.validation(of_run))


SAME = DataSource()
SYNTHETIC = DataSource("synthetic")
"""Defaults: the run's own data set, and the embedded world."""
