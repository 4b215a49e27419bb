"""The two sides that `jaxsim discover` compares: two folders, those made of a run, or one and Lambert's law; and which
flags go together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from jaxsim.cli.source import SAME, Source
from jaxsim.simulate.frames import write_pairs
from jaxsim.simulate.lambert import write_lambert
from jaxsim.simulate.sensor import load

NOT_UNPAIRED = {
    "run": "but a run's frames are simulated on the measured streets; give --measured and --simulated instead of it",
    "lambert": "which has the measured streets; leave it out",
    "every_frame": "which judges what was named frame by frame; leave it out",
    "nulls": "which exchanges scenes between the sides to see what chance does; leave one of them out",
    "effects_from": "which tells effects of the catalogue alone; leave it out",
    "effects": "which compares the frames as they are; leave it out, or simulate the frames with them "
    "(`jaxsim simulate --effects`)",
}
"""Flags that do not go with --unpaired, and why."""


def refuse_with_unpaired(flags: Mapping[str, Any]) -> None:
    """Raises ValueError for the first flag of NOT_UNPAIRED that is given."""
    for flag, why in NOT_UNPAIRED.items():
        if flags[flag]:
            name = "a run" if flag == "run" else f"--{flag.replace('_', '-')}"
            raise ValueError(f"discover: {name} came with --unpaired, {why}")


def sides(
    run: Path | None,
    data: Source = SAME,
    *,
    out: Path,
    frames: str = "",
    simulated: Path | None = None,
    measured: Path | None = None,
    lambert: bool = False,
    log: Callable[[str], None] = print,
) -> tuple[Path, Path]:
    """The simulated and the measured folder: those that were given; those of a run, made in `out`; or, with `lambert`,
    the measured one and Lambert's law on its ranges, made in `out` too.

    Raises ValueError where one is missing, and for flags that do not go together.
    """
    if lambert and (run or simulated):
        raise ValueError("discover: --lambert stands for a simulator, and one was given; leave one of them out")
    if run:
        if measured or simulated:
            raise ValueError(
                "discover: a run and --measured or --simulated were given; a run is held against the scans of its "
                "data set (--data.kind, --data.root): give one or the other"
            )
        sensor = load(run)
        dataset, positions = data.open(sensor.run.experiment.data, frames=frames)
        return write_pairs(sensor, dataset, positions, out=out, log=log)
    of_runs = [f"data.{field.name}" for field in fields(Source) if getattr(data, field.name) != field.default]
    for flag in [*of_runs, *["frames"] * bool(frames)]:
        raise ValueError(f"discover: --{flag} is for a trained run: jaxsim discover RUN --{flag} ...")
    sensed = _folder("--measured", measured)
    if not lambert:
        return _folder("--simulated", simulated), sensed
    written = write_lambert(sensed, out)
    log(f"{written}: Lambert's law on the measured ranges; of ranges and losses nothing can be asked")
    return written, sensed


def _folder(flag: str, folder: Path | None) -> Path:
    if folder is None:
        raise ValueError(
            f"discover: {flag} is missing; give --measured and --simulated (or --lambert), or a trained run"
        )
    if not folder.is_dir():
        raise ValueError(
            f"discover: {flag} {folder} is no folder; give one that holds grid.json and a NAME.npz a frame "
            "(jaxsim discover --help); `jaxsim frames` makes one of a log"
        )
    return folder
