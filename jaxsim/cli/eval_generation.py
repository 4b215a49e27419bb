"""`jaxsim eval generation`: LiDAR generation metrics between two folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jaxsim.evaluate.generation import generation_scores, open_folder
from jaxsim.metrics.rangenet import load_rangenet
from jaxsim.report import list_scores, write_list


@dataclass(frozen=True)
class Generation:
    """LiDAR generation metrics between two folders of polar frames, or of clouds (docs/metrics.md).

    Frames need no common names; those that have them are also compared as pairs (Chamfer distances).
    """

    simulated: Path
    """Folder of polar frames (grid.json and NAME.npz), or of clouds (.bin, or .npz with xyz)."""
    measured: Path
    """Folder of the sensor's."""
    rangenet: Path | None = None
    """Converted RangeNet++ (`jaxsim convert rangenet53`): also the Fréchet distance over its features."""
    out: Path | None = None
    """Folder for generation.json and generation.md."""

    def __call__(self) -> None:
        simulated, measured = open_folder(self.simulated), open_folder(self.measured)
        rangenet = load_rangenet(self.rangenet) if self.rangenet else None
        scores = generation_scores(simulated, measured, rangenet=rangenet)
        frames = [len(simulated.names), len(measured.names)]
        print(f"{frames[0]} simulated and {frames[1]} measured frames\n\n{list_scores(scores)}")
        if self.out:
            about = {"simulated": str(self.simulated), "measured": str(self.measured), "frames": frames}
            write_list(self.out, "generation", scores, about=about)
