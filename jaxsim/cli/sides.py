"""The two sides that `jaxsim discover` compares: two folders, those made of a run, or one and Lambert's law."""

from __future__ import annotations

import logging
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from jaxsim.cli.flags import SAME, DataSource, IntoFolder

_log = logging.getLogger(__name__).info


@dataclass(frozen=True)
class Sides(IntoFolder):
    """Flags that name the two sides."""

    out: Path
    """Folder to write to."""
    run: Annotated[Path | None, tyro.conf.Positional] = None
    """Folder of a trained run, instead of the two folders."""
    measured: Path | None = None
    """Folder of polar frames of the sensor."""
    simulated: Path | None = None
    """Folder of polar frames of the simulator: same names, same grid. With semantic, instance, rgb and incidence
    arrays more effects can be told apart."""
    lambert: bool = False
    """Instead of --simulated, until you have a simulator: Lambert's law on the measured ranges, an albedo of 0.3
    everywhere, written to OUT/simulated. Tells what of the sensor's intensity that law lacks; ranges and losses are the
    measured ones."""
    data: DataSource = SAME
    """Data set to hold a run against."""
    frames: str = ""
    """Frames to hold a run against: `0-99`. Empty: the run's validation frames, or all of another data set."""

    def folders(self) -> tuple[Path, Path]:
        """The simulated and the measured folder: those that were given; those of a run, made in `out`; or, with
        `lambert`, the measured one and Lambert's law on its ranges, made in `out` too.

        Raises ValueError where one is missing, and for flags that do not go together.
        """
        if self.lambert and (self.run or self.simulated):
            raise ValueError("discover: --lambert stands for a simulator, and one was given; leave one of them out")
        if self.run:
            if self.measured or self.simulated:
                raise ValueError("discover: a run is held against its own data set; give it or two folders, not both")
            # Networks and their checkpoints, which two folders need not wait for.
            from jaxsim.simulate.discover_sides import write_both_sides
            from jaxsim.simulate.learned_sensor import load

            learned = load(self.run)
            of_run = learned.run.experiment.data
            dataset, positions = self.data.open(of_run, frames=self.frames, run=self.run)
            return write_both_sides(learned, dataset, positions, out=self.out, log=_log)
        given = [field.name for field in fields(DataSource) if getattr(self.data, field.name) != field.default]
        for flag in [*(f"data.{name}" for name in given), *["frames"] * bool(self.frames)]:
            raise ValueError(f"discover: --{flag} is for a trained run: jaxsim discover RUN --{flag} ...")
        sensed = _folder("--measured", self.measured)
        if not self.lambert:
            return _folder("--simulated", self.simulated), sensed
        from jaxsim.simulate.discover_sides import write_lambert

        written = write_lambert(sensed, self.out)
        _log(f"{written}: Lambert's law on the measured ranges; of ranges and losses nothing can be asked")
        return written, sensed


def _folder(flag: str, folder: Path | None) -> Path:
    if folder is None:
        raise ValueError(f"discover: {flag} is missing; give --measured and --simulated or --lambert, or a trained run")
    if not folder.is_dir():
        raise ValueError(
            f"discover: {flag} {folder} is no folder; give one that holds grid.json and a NAME.npz a frame "
            "(jaxsim discover --help); `jaxsim frames` makes one of a log"
        )
    return folder
