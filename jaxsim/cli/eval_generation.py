"""`jaxsim eval generation`: two folders of frames or clouds held against each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jaxsim.config.ranges import Checked, Count
from jaxsim.evaluate.generation import COMPARED, generation_scores, open_folder
from jaxsim.files import check_apart
from jaxsim.metrics.rangenet import load_rangenet
from jaxsim.progress import counted
from jaxsim.report.results import list_scores, write_list


@dataclass(frozen=True)
class Generation(Checked):
    """LiDAR generation metrics between two folders of polar frames, or of clouds; lower is nearer in all of them.

    Jensen-Shannon divergence and MMD of counts seen from above, each as its publisher's program defines it (lidargen_,
    r2dm_, lidm_); of polar frames also sliced Wasserstein distances (swd_) and histograms of intensity. Frames need no
    common names; those that have them are also compared as pairs (Chamfer distances).
    """

    simulated: Path
    """Folder of polar frames (grid.json and NAME.npz), or of clouds (.bin, or .npz with xyz)."""
    measured: Path
    """Folder of the sensor's."""
    rangenet: Path | None = None
    """Converted RangeNet++ (`jaxsim convert rangenet53`): also the Fréchet distance over its features."""
    compared: Count = COMPARED
    """Frames of each folder, evenly spaced, that MMD, sliced Wasserstein and Fréchet distances are taken of: their time
    and memory grow faster than the folder. All else is taken of all frames."""
    out: Path | None = None
    """Folder for generation.json and generation.md."""

    @property
    def writes_to(self) -> Path | None:
        """The folder that one process has while the command runs."""
        return self.out

    def __call__(self) -> None:
        if self.out:
            check_apart(self.out, self.simulated, self.measured, by="generation")
        simulated, measured = open_folder(self.simulated), open_folder(self.measured)
        rangenet = self.rangenet and load_rangenet(self.rangenet)
        scores = generation_scores(simulated, measured, rangenet=rangenet, compared=self.compared)
        frames = [len(simulated.names), len(measured.names)]
        print(f"{frames[0]} simulated and {counted(frames[1], 'measured frame')}\n\n{list_scores(scores)}")
        if self.out:
            about = {"simulated": str(self.simulated), "measured": str(self.measured), "frames": frames}
            about |= {"compared": min(self.compared, *frames)}
            write_list(self.out, "generation", scores, about=about)
