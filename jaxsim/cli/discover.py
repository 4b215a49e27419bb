"""`jaxsim discover`: which effect a simulation lacks, from its frames and a sensor's."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxsim.cli.naming import Naming, check_unpaired

if TYPE_CHECKING:
    from jaxsim.cli.gates import Compared
else:
    Compared = Any  # a name that annotations can be looked up by


@dataclass(frozen=True)
class Discover(Naming):
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
        from jaxsim.discover.distances import quick_distances

        check_unpaired(vars(self))
        return quick_distances(*self.folders()) if self.fast else self.answer()
