"""`jaxsim discover`: which effect a simulation lacks, from its frames and a sensor's."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxsim.cli.flags import EffectFiles
from jaxsim.cli.sides import Sides, check_unpaired
from jaxsim.config.ranges import Whole
from jaxsim.files import check_apart

if TYPE_CHECKING:
    from jaxsim.cli.gates import Compared
    from jaxsim.discover.verdict import Verdict
else:
    Compared = Verdict = Any  # names that annotations can be looked up by

_log = logging.getLogger(__name__).info


@dataclass(frozen=True)
class Discover(Sides):
    """Finds where simulated and measured frames disagree, names the effect that the simulation lacks, and shows
    the gap with the effect added.

        jaxsim discover runs/NAME --data.kind kitti_raw --data.root DIR --out OUT

    Two folders of polar frames, as `jaxsim simulate` writes one (OUT/polar): grid.json (`azimuth` of the columns and
    `elevation` of the rows, rad, falling), and one NAME.npz a frame with range (m, 0 = no return) and intensity (0..1),
    rows x columns; frames of the same name are compared. grid.json may also say of frames, by name, their scene (the
    drive), time (s), speed (m/s) and heading (rad). Or the learned sensor of a run against the drive that it
    should imitate: its frames are simulated on the run's polar window, with the ranges of the camera's dense depth, and
    compared with their own scans; they go to OUT/simulated and OUT/measured.

    The answer is one of three: effects of the catalogue (`jaxsim effects`), none, or something that it does not hold.
    Writes verdict.json, sensor.json (for `jaxsim simulate --effects`), sides.json (which folders were compared, for
    --control), report.html and figures/ to OUT.
    """

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
    gate: Path | None = None
    """A gate.json with thresholds a channel, effects that may be missing, a verdict of before: the command ends with 0
    where the answer passes, 1 where there is a gap, 2 where it cannot be judged; junit.xml and gate.md say it."""
    write_gate: Path | None = None
    """Writes that gate.json from these frames, which you hold to be right, instead of asking one: with --fast
    thresholds a tenth above what they show; without it the whole answer as the baseline, whose effects may be missing
    and whose distances may grow by a tenth."""
    fast: bool = False
    """With --gate or --write-gate: compare distances alone, in seconds, and name nothing."""

    @property
    def failure(self) -> int:
        """The exit status where it fails: with a gate 1 is a gap, and 2 what could not be judged (`gates.EXIT`)."""
        return 2 if self.gate else 1

    def __call__(self) -> None:
        # All that computes waits until the flags are known: a command line that is refused need not.
        from jaxsim.cli.gates import ask_gate, check_flags, make_gate

        check_flags(vars(self))
        if self.gate:
            sys.exit(ask_gate(self.gate, self.out, self.compare))
        shown = self.compare()
        if self.write_gate:
            make_gate(self.write_gate, self.out, shown)

    def compare(self) -> Compared:
        from jaxsim.discover.gate import quick_distances

        check_unpaired(vars(self))
        return quick_distances(*self.folders()) if self.fast else self.answer()

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
        print(f"\n{verdict_sentence(result.verdict)}\n\n{report}; beside it verdict.json, sensor.json, figures/")
        return result.verdict

    def in_place(self, rows: int | None = None) -> dict[str, Any]:
        """What is in place before anything is asked, for a sensor of so many beams, if these are known."""
        from jaxsim.discover import NO_CONTROL, Control
        from jaxsim.effects.chain import SensorModel

        check_apart(self.out, self.control, by="discover")
        known = SensorModel.load(self.effects, rows=rows) if self.effects else SensorModel()
        return {"known": known, "control": Control.load(self.control, rows=rows) if self.control else NO_CONTROL}
