"""The control: what a simulator lacks of the sensor that it was made after, as an earlier answer says.

A simulator that learned from a sensor lacks what it did not learn, and so does one that was made by hand. Frames of the
same simulator beside drives on which that sensor was as it should be show it, as a control experiment does: an answer
of theirs, put in place first, leaves of other drives what is new on these.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from jaxsim.data.polar_frames import frame_names, read_frame, read_grid
from jaxsim.discover.read.checks import readings_of
from jaxsim.discover.read.registration import MOTION_PARTS
from jaxsim.discover.verdict import VERDICT
from jaxsim.effects.chain import SensorModel
from jaxsim.files import placed, read_entry, read_json, write_text
from jaxsim.geometry.sensor import grid_difference

LOOKED_AT = 16
"""Frames of one name that are looked at for copies of the control's."""
SIDES = "sides.json"
"""The file beside an answer that says where the two folders are that it compared."""


@dataclass(frozen=True)
class Control:
    """What an earlier answer found on frames of the same simulator."""

    model: SensorModel = field(default_factory=SensorModel)
    """Its effects and learned laws, as fitted there."""
    contrast_off: bool = False
    """Whether the sensor did not follow the simulator's contrast there."""
    folders: tuple[Path, Path] | None = None
    """Its simulated and its measured frames; None where they are not to be had any more."""

    @property
    def mounting(self) -> SensorModel:
        """Its effects that are of the mounting, which are put in place by casting the simulated frames again."""
        pairs = [pair for pair in self.model.effects if pair[0] in MOTION_PARTS and pair[0] not in self.model.regions]
        return SensorModel(tuple(pairs))

    @property
    def of_rays(self) -> SensorModel:
        """What of it acts on rays as they were cast: all but the mounting."""
        return self.model.without(self.mounting)

    def check_new(self, simulated: Path, measured: Path) -> None:
        """Raises ValueError where these are the control's own frames, or of another grid than these."""
        if self.folders is None:
            return
        if measured.resolve() == self.folders[1].resolve():
            raise ValueError(
                f"discover: {measured} are the frames of the control, beside which nothing of them can be new; give an "
                "answer of other drives as --control"
            )
        if found := _same_frame(self.folders[1], measured):
            raise ValueError(
                f"discover: {found} of {measured} holds the readings of the control's {found}, beside which nothing of "
                "it can be new; give an answer of other drives as --control, or leave such frames out"
            )
        grid, _ = read_grid(simulated)
        of_control, _ = read_grid(self.folders[0])
        if difference := grid_difference(of_control, grid):
            raise ValueError(
                f"discover: the grids of the control's frames, {self.folders[0]}, and of {simulated} differ in "
                f"{difference}; a control is of the same simulated sensor"
            )

    @classmethod
    def load(cls, folder: Path | str, rows: int | None = None) -> Control:
        """Reads the control of the folder that `jaxsim discover --out` wrote, for a sensor of so many beams, if these
        are known.

        Raises ValueError where it holds no paired answer, one beside a control, or one of a sensor of another number of
        beams.
        """
        folder = Path(folder)
        file = folder / VERDICT
        if not file.is_file():
            raise ValueError(
                f"discover: no file {file}; a control is the folder of an earlier answer (`jaxsim discover ... --out "
                "CONTROL`) on frames of the same simulator where the sensor was as it should be"
            )
        content = read_json(file, by="discover")
        with placed(f"discover: {file} is no verdict of `jaxsim discover`", KeyError, TypeError, AttributeError):
            paired, contrast = content["levels"], content.get("contrast")
            beside = content.get("control")
        if not paired:
            raise ValueError(
                f"discover: {file} is an answer of --unpaired frames, which are not compared ray by ray; give one of "
                "frames of the same names as the control"
            )
        if beside:
            raise ValueError(
                f"discover: {file} is itself an answer beside a control, and says only what came on top of that; give "
                "that control, or an answer without one"
            )
        model = SensorModel.load(folder / "sensor.json", rows=rows)
        # Levels are no effects: both sides of the new frames tell theirs.
        return cls(replace(model, levels={}), contrast is not None, read_sides(folder))


def _same_frame(first: Path, second: Path) -> str:
    """Gives the name of a frame that two folders hold with the same readings; empty where none is found."""
    common = sorted({*frame_names(first)} & {*frame_names(second)})
    # Evenly spread: a folder that was copied, or a part of one, shows it wherever it is looked at.
    for name in common[:: max(1, len(common) // LOOKED_AT)]:
        with suppress(ValueError):  # what cannot be read is told where it is compared
            if readings_of(read_frame(first, name)[0]) == readings_of(read_frame(second, name)[0]):
                return name
    return ""


def write_sides(folder: Path, simulated: Path, measured: Path) -> None:
    """Writes which folders an answer compares that is to be written beside it, those within its own folder as seen from
    there. An older answer ends with it: one of two answers' files would be what a kill leaves."""
    (folder / VERDICT).unlink(missing_ok=True)
    own = folder.resolve()
    paths = {"simulated": simulated.resolve(), "measured": measured.resolve()}
    within = {name: path.relative_to(own) if path.is_relative_to(own) else path for name, path in paths.items()}
    write_text(folder / SIDES, json.dumps({name: path.as_posix() for name, path in within.items()}, indent=1) + "\n")


def read_sides(folder: Path) -> tuple[Path, Path] | None:
    """Reads which simulated and measured folder an answer compared; gives None where they are not known or not there.

    Raises ValueError for a file that does not say it.
    """
    path = folder / SIDES
    if not path.is_file():
        return None
    simulated = folder / read_entry(path, "simulated", str, by="discover")
    measured = folder / read_entry(path, "measured", str, by="discover")
    return (simulated, measured) if simulated.is_dir() and measured.is_dir() else None


NO_CONTROL = Control()
"""The control where none is given: the simulator is taken at its word."""
