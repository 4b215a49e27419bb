"""Flags that several commands share, and those of earlier versions under their names of today.

The frames that a command reads are one group of flags for every command, `--data.kind`, `--data.root` ...
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

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


def in_new_spelling(words: Sequence[str], flags: Any) -> list[str]:
    """The words of a command line, with flags that were called otherwise in earlier versions under their names of
    today; a first word that is no flag, where `flags` has no place for it, is the kind of data set."""
    today = _old_spellings(flags)
    result = []
    for word in words:
        flag, equals, value = word.partition("=")
        result.append(today.get(flag.replace("_", "-"), flag) + equals + value)
    takes_a_word = any("Positional" in str(field.type) for field in fields(flags))
    if words and not words[0].startswith("-") and _groups(flags) == ["data"] and not takes_a_word:
        result.insert(0, "--data.kind")
    return result


def _old_spellings(flags: Any) -> dict[str, str]:
    """Earlier spelling of a flag -> its name: `--root` -> `--data.root`, `--data` -> `--data.kind`, `--sensor` ->
    `--effects`. A flag that the command itself has is never an earlier spelling."""
    names = {field.name for field in fields(flags)}
    table = {"--sensor": "--effects"} if "effects" in names else {}
    for group in _groups(flags):
        before = "" if group == "data" else f"{group}-"
        table |= {f"--{before}{field.name}": f"--{group}.{field.name}" for field in fields(DataSource)}
        table[f"--{group}"] = f"--{group}.kind"
    return {old: new for old, new in table.items() if old[2:] not in names or old[2:] in _groups(flags)}


def _groups(flags: Any) -> list[str]:
    """Names of the fields that are a Source."""
    return [field.name for field in fields(flags) if isinstance(field.default, DataSource)]
