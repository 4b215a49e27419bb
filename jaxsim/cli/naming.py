"""Flags of `jaxsim discover` that say how it names, and the whole answer; which of them do not go with sides that show
different streets (--unpaired)."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxsim.cli.flags import EffectFiles
from jaxsim.cli.sides import Sides
from jaxsim.config.ranges import Whole
from jaxsim.files import check_apart

if TYPE_CHECKING:
    from jaxsim.discover.verdict import Verdict
else:
    Verdict = Any  # a name that annotations can be looked up by

_log = logging.getLogger(__name__).info
NOT_UNPAIRED = {
    "run": "but a run's frames are simulated on the measured streets; give --measured and --simulated instead of it",
    "lambert": "which has the measured streets; leave it out",
    "fast": "which compares frames of one name; leave it out and ask the whole answer",
    "every_frame": "which judges what was named frame by frame; leave it out",
    "nulls": "which exchanges scenes between the sides to see what chance does; leave one of them out",
    "control": "which holds frames ray by ray; leave it out",
    "effects_from": "which tells effects of the catalogue alone; leave it out",
    "effects": "which compares the frames as they are; leave it out, or simulate the frames with them "
    "(`jaxsim simulate --effects`)",
}
"""Flags that do not go with --unpaired, and why."""


@dataclass(frozen=True)
class Naming(Sides):
    """Flags of naming."""

    effects: Path | None = None
    """Effects (sensor.json) that the simulation already has and its frames do not show, as an earlier answer's: what
    does it lack beside these? Feed an answer back, and "none" or the next effect comes out."""
    control: Path | None = None
    """Folder of an earlier answer (its --out) on frames of the same simulator where the sensor was as it should be,
    such as drives that a network did not learn from: what the simulator lacks there it lacks by itself. It is put in
    place first, and what is named is new on these frames."""
    effects_from: EffectFiles = ()
    nulls: Whole = 0
    """Sets the bar for these very data: draws so many measurements in which nothing is missing (the simulation with
    what is left of these data, its sign changed scene by scene), and asks of an effect to gain more than any did there.
    20 hold false names to about one in 21; each takes a fifth of an answer's time. 0: that of development cases."""
    every_frame: bool = False
    """Of folders that do not fit into memory (more than 72 frames of 64 x 1024), also judges what was named on all the
    frames that were not read, block by block, and lists those that it serves worst. Time grows with their number."""
    unpaired: bool = False
    """The two folders show different streets (another drive, another town): names need not agree, and fewer effects
    can be told; the answer lists the others. Needs eight drives on each side."""

    def answer(self) -> Verdict:
        """The whole answer, written to `out`."""
        from jaxsim.data.polar_frames import read_grid
        from jaxsim.discover import discover_folders, discover_unpaired
        from jaxsim.discover.read.control import write_sides
        from jaxsim.effects.own import known_effects
        from jaxsim.report.discovery import write_answer
        from jaxsim.report.words import verdict_sentence

        known_effects(self.effects_from)
        self.in_place()  # what cannot be read is refused before a run simulates anything
        simulated, measured = self.folders()
        _log(f"reading {simulated} and {measured}")
        both: dict[str, Any] = {"simulated": simulated, "measured": measured, "log": _log}
        rows = len(read_grid(simulated)[0].elevation_rad)
        if self.unpaired:
            result = discover_unpaired(**both)
        else:
            given = self.in_place(rows)
            result = discover_folders(**both, **given, nulls=self.nulls, every_frame=self.every_frame)
        write_sides(self.out, simulated, measured)
        report = write_answer(self.out, result)
        print(f"\n{verdict_sentence(result.verdict)}\n\n{report}; its data in verdict.json, sensor.json, sides.json")
        return result.verdict

    def in_place(self, rows: int | None = None) -> dict[str, Any]:
        """What is in place before anything is asked, for a sensor of so many beams, if these are known."""
        from jaxsim.discover import NO_CONTROL, Control
        from jaxsim.effects.chain import SensorModel

        check_apart(self.out, self.control, by="discover")
        known = SensorModel.load(self.effects, rows=rows) if self.effects else SensorModel()
        return {"known": known, "control": Control.load(self.control, rows=rows) if self.control else NO_CONTROL}


def check_unpaired(flags: Mapping[str, Any]) -> None:
    """Raises ValueError for the first flag of NOT_UNPAIRED that came with --unpaired."""
    for flag, why in NOT_UNPAIRED.items():
        if flags["unpaired"] and flags[flag]:
            name = "a run" if flag == "run" else f"--{flag.replace('_', '-')}"
            raise ValueError(f"discover: {name} came with --unpaired, {why}")
