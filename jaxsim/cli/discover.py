"""`jaxsim discover`: which effect a simulation lacks, from its frames and a sensor's."""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import UseAppendAction

from jaxsim.cli.sides import NOT_UNPAIRED, refuse_with_unpaired, sides
from jaxsim.cli.source import SAME, Source
from jaxsim.config.ranges import Checked, Whole
from jaxsim.data.polar_frames import read_grid
from jaxsim.discover import discover_folders, discover_unpaired
from jaxsim.discover.gate import (
    Check,
    Colour,
    Gate,
    check_distances,
    check_verdict,
    colour_of,
    quick_distances,
    read_gate,
    save_gate,
    thresholds_of,
)
from jaxsim.discover.verdict import Interval, Verdict
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.files import write_text
from jaxsim.report import verdict_sentence, write_answer
from jaxsim.report.gate import markdown, write_gate

log = logging.getLogger(__name__).info
EXIT: dict[Colour, int] = {"pass": 0, "gap": 1, "unsure": 2}
"""How the command ends where it asks a gate."""
TITLES: dict[Colour, str] = {
    "pass": "The simulation passes",
    "gap": "The simulation lacks something",
    "unsure": "The frames cannot be judged",
}


@dataclass(frozen=True)
class Discover(Checked):
    """Finds where simulated and measured frames disagree, names the effect that the simulation lacks, and shows
    the gap with the effect added.

        jaxsim discover runs/NAME --data.kind kitti_raw --data.root DIR --out OUT

    Two folders of polar frames, as `jaxsim simulate` writes one (OUT/polar): grid.json (`azimuth` of the columns and
    `elevation` of the rows, rad, falling), and one NAME.npz a frame with range (m, 0 = no return) and intensity (0..1),
    rows x columns; frames of the same name are compared. grid.json may also say of frames, by name, their scene (the
    drive), time (s), speed (m/s) and heading (rad). Or the learned sensor of a run against the drive that it
    should imitate: its frames are simulated on the run's polar window, with the ranges of the camera's dense depth, and
    compared with their own scans; they go to OUT/simulated and OUT/measured.

    The answer is one of three: effects of the catalogue (`jaxsim effects` lists it), none, or something that the
    catalogue does not hold. Writes verdict.json, sensor.json (for `jaxsim simulate --effects`), report.html and
    figures/ to OUT.
    """

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
    data: Source = SAME
    """Data set to hold a run against."""
    frames: str = ""
    """Frames to hold a run against: `0-99`. Empty: the run's validation frames, or all of another data set."""
    effects: Path | None = None
    """Effects (sensor.json) that the simulation already has and its frames do not show, as an earlier answer's: what
    does it lack beside these? Feed an answer back, and "none" or the next effect comes out."""
    effects_from: UseAppendAction[tuple[Path, ...]] = ()
    """A Python file with an effect of your own (`jaxsim effects new NAME` writes one), to be a candidate beside the
    catalogue; may be given several times. Its code is run: give only files that you have read. Effects of installed
    packages (entry points of the group jaxsim.effects) join by themselves."""
    nulls: Whole = 0
    """Sets the bar for these very data: draws so many measurements in which nothing is missing (the simulation with
    what is left of these data, its sign changed scene by scene), names in each as in the measured one, and asks of an
    effect to gain more than anything did on any of them. 20 hold false names to about one in 21; each takes about a
    fifth of the time of an answer. 0: the bar that was set on development cases."""
    every_frame: bool = False
    """Of folders that do not fit into memory (more than 72 frames of 64 x 1024), also judges what was named on all the
    frames that were not read, block by block, and lists those that it serves worst. Time grows with their number."""
    unpaired: bool = False
    """The two folders show different streets (another drive, another town): names need not agree, and fewer effects
    can be told; the answer lists the others. Needs eight drives on each side."""

    gate: Path | None = None
    """A gate.json with thresholds a channel, effects that may be missing, and a verdict of before: the command ends
    with 0 where the answer passes, 1 where there is a gap, 2 where it cannot be judged; junit.xml and gate.md say
    it."""
    write_gate: Path | None = None
    """Writes that gate.json from these frames, which you hold to be right, instead of asking one: with --fast
    thresholds a tenth above what they show; without it the whole answer as the baseline, whose effects may be missing
    and whose distances may grow by a tenth."""
    fast: bool = False
    """With --gate or --write-gate: compare distances alone, in seconds, and name nothing."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs."""
        return self.out

    def __call__(self) -> None:
        if self.fast and not (self.gate or self.write_gate):
            raise ValueError("discover: --fast is for a gate; give --gate gate.json, or --write-gate gate.json first")
        if self.gate and self.write_gate:
            raise ValueError("discover: --write-gate makes a gate, --gate asks it; give one of them")
        if self.gate:
            sys.exit(self.exit_code(read_gate(self.gate)))
        if self.write_gate:
            self.make_gate(self.write_gate)
            return
        self.answer()

    def make_gate(self, path: Path) -> None:
        """Writes a gate of these frames."""
        if self.fast:
            shown = self.distances()
            save_gate(path, thresholds=thresholds_of(shown))
            words = [(name, f"{d.value:.4g} ({d.low:.4g} .. {d.high:.4g}) {d.unit}") for name, d in shown.items()]
            checks = tuple(Check(name, "pass", told) for name, told in words)
            write_text(self.out / "gate.md", markdown(checks, title="What the gate was written from"))
        else:
            self.answer()
            save_gate(path, baseline=self.out / "verdict.json")
        print(f"{path}: {' '.join(path.read_text().split())}")

    def exit_code(self, gate: Gate) -> int:
        """The exit code of a gate, whose checks are written; where frames cannot be compared, that of "unsure"."""
        begun = time.monotonic()
        try:
            checks = check_distances(gate, self.distances()) if self.fast else check_verdict(gate, self.answer())
        except ValueError as error:
            checks = (Check("comparison", "unsure", str(error)),)
        colour = colour_of(checks)
        title = TITLES[colour]
        write_gate(self.out, checks, title=title, seconds=time.monotonic() - begun)
        print(markdown(checks, title=title))
        return EXIT[colour]

    def distances(self) -> dict[str, Interval]:
        """Distances of the two sides, frame by frame."""
        simulated, measured = self.both_sides()
        return quick_distances(simulated, measured)

    def both_sides(self) -> tuple[Path, Path]:
        """The simulated and the measured folder."""
        given = {"simulated": self.simulated, "measured": self.measured, "lambert": self.lambert}
        return sides(self.run, self.data, frames=self.frames, out=self.out, log=log, **given)

    def answer(self) -> Verdict:
        """The whole answer, written to `out`."""
        if self.unpaired:
            refuse_with_unpaired({name: getattr(self, name) for name in NOT_UNPAIRED})
        known_effects(self.effects_from)
        simulated, measured = self.both_sides()
        log(f"reading {simulated} and {measured}")
        if self.unpaired:
            result = discover_unpaired(simulated=simulated, measured=measured, log=log)
        else:
            rows = len(read_grid(simulated)[0].elevation_rad) if self.effects else None
            known = SensorModel.load(self.effects, rows=rows) if self.effects else SensorModel()
            result = discover_folders(
                simulated=simulated,
                measured=measured,
                known=known,
                nulls=self.nulls,
                every_frame=self.every_frame,
                log=log,
            )
        report = write_answer(self.out, result)
        print(f"\n{verdict_sentence(result.verdict)}\n")
        print(f"{report}; beside it verdict.json, sensor.json, figures/")
        return result.verdict
