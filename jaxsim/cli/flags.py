"""Flags that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.config.ranges import Checked


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
