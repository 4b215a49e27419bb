"""`jaxsim discover`: which effect a simulation lacks, from its frames and a sensor's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jaxsim.discover import discover_folders
from jaxsim.report import verdict_sentence, write_report


@dataclass(frozen=True)
class Discover:
    """Finds where simulated and measured frames disagree, names the effect that the simulation lacks, and shows
    the gap with the effect added.

    Both folders hold polar frames: grid.json, and one NAME.npz a frame with range (m, 0 = no return) and intensity,
    which lies in 0..1; both are rows x columns. Frames of the same name are compared. The format is
    docs/polar-frames.md; `jaxsim simulate` writes such a folder as OUT/polar.

    The answer is one of three: effects of the catalogue (`jaxsim effects` lists it), none, or something that the
    catalogue does not hold.

    Writes verdict.json, sensor.json (for `jaxsim simulate --sensor`), report.html and figures/ to OUT.
    """

    measured: Path
    """Folder of polar frames of the sensor."""
    simulated: Path
    """Folder of polar frames of the simulator: same names, same grid. With semantic, instance, rgb and incidence
    arrays more effects can be told apart."""
    out: Path
    """Folder to write to."""

    def __call__(self) -> None:
        for flag, folder in (("--measured", self.measured), ("--simulated", self.simulated)):
            if not folder.is_dir():
                raise ValueError(
                    f"discover: {flag} {folder} is no folder; give one that holds grid.json and a NAME.npz a frame "
                    "(docs/polar-frames.md)"
                )
        print(f"reading {self.simulated} and {self.measured}", flush=True)
        result = discover_folders(self.simulated, self.measured, say=lambda line: print(line, flush=True))
        result.sensor.save(self.out / "sensor.json")
        report = write_report(self.out, result)
        result.verdict.save(self.out)
        print(f"\n{verdict_sentence(result.verdict)}\n")
        print(f"{report}; beside it verdict.json, sensor.json, figures/")
