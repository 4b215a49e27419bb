"""`jaxsim join`: one run of several that were trained apart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.config.ranges import Checked
from jaxsim.files import as_argument
from jaxsim.train.join import join_runs


@dataclass(frozen=True)
class Join(Checked):
    """Makes one run of several that differ only in their seed: its network is their mean, which errs less than any.

    Each is a U-Net's run of the same settings (`jaxsim train NAME --run.seed 3 --run.name third`), on any machine. The
    joined run is one like any other: eval, simulate, convert and train take it.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of the runs: two or more."""
    out: Path
    """The joined run's folder."""

    def __call__(self) -> None:
        run = join_runs(self.runs, self.out)
        members = run.experiment.generator.members
        use = f"jaxsim eval {as_argument(self.out)}"
        print(f"{self.out}: the mean of {members} networks. Scores beside baselines: {use}")
