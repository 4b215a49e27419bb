"""`jaxsim eval RUN`: a learned sensor's scores beside baselines, or a detector's; and `jaxsim eval generation`."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from jaxsim.cli.eval_detection import judge_run
from jaxsim.cli.source import SAME, Source
from jaxsim.evaluate.generation import generation_scores, open_folder
from jaxsim.evaluate.intensity import frechet_line
from jaxsim.evaluate.runs import score_sensor
from jaxsim.metrics.inception import open_extractor
from jaxsim.metrics.rangenet import load_rangenet
from jaxsim.report import list_scores, pair_picture, save_picture, score_table, write_frechet, write_list, write_scores
from jaxsim.runs.run import is_detector
from jaxsim.simulate.sensor import load


@dataclass(frozen=True)
class Evaluation:
    """Paired scores on the cells that the camera saw, with baselines beside them, and pictures.

    The baselines average the run's own training frames. Writes scores.json, scores.md and pictures (input |
    predicted | measured | difference) to RUN/evaluation. Of a detector's run: KITTI's average precision.

    Also: jaxsim eval generation (two folders of frames or clouds), jaxsim eval detection (KITTI result files),
    jaxsim eval ablation (networks of different inputs in one table); each has its own --help.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    data: Source = SAME
    """Data set to judge on; another than the run's own is an unseen drive."""
    frames: str = ""
    """Frames to judge: `0-2`, or a part by name: `evaluation`. Empty: the validation frames, or all of another set."""
    out: Path | None = None
    """Where to write instead of RUN/evaluation."""
    pictures: int = 4
    """Frames to draw."""
    fid: str = ""
    """Also the Fréchet Inception distance between predicted and measured intensity images: Inception weights from
    `jaxsim convert` (FILE.npz), or `random` for a network of random weights, whose score is called frechet_random."""
    fid_features: int = 2048
    """Features of Inception: 2048, or 768, 192, 64 for small sets (another score, under another name)."""

    def __call__(self) -> None:
        out = self.out or self.run / (f"evaluation_{self.data.kind}" if self.data.foreign else "evaluation")
        if is_detector(self.run):
            return judge_run(self.run, self.data, frames=self.frames, out=out)

        # Scores: the network and the baselines on the same cells, and the Fréchet distance.
        sensor = load(self.run)
        own = sensor.run.experiment.data
        data, validation = self.data.config(own), self.data.validation(own)
        extractor = open_extractor(self.fid, self.fid_features) if self.fid else None
        judged = score_sensor(sensor, data, frames=self.frames, validation=validation, extractor=extractor)

        # Tables and pictures.
        pairs = judged.pairs
        write_scores(out, judged.scores, frames=pairs.names)
        for name, pair in islice(zip(pairs.names, pairs, strict=True), self.pictures):
            predicted = np.asarray(judged.predict(sensor.params, pair))
            save_picture(out / f"{name}.png", pair_picture(pair, predicted, title=name))
        print(f"{len(pairs)} frames of {data.kind}\n\n{score_table(judged.scores)}\n")
        if extractor and judged.frechet:
            write_frechet(out, judged.frechet, extractor=extractor.name)
            print(f"{frechet_line(judged.frechet)}\n")
        print(f"scores and pictures: {out}")


@dataclass(frozen=True)
class Generation:
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
    out: Path | None = None
    """Folder for generation.json and generation.md."""

    def __call__(self) -> None:
        simulated, measured = open_folder(self.simulated), open_folder(self.measured)
        scores = generation_scores(simulated, measured, rangenet=self.rangenet and load_rangenet(self.rangenet))
        frames = [len(simulated.names), len(measured.names)]
        print(f"{frames[0]} simulated and {frames[1]} measured frames\n\n{list_scores(scores)}")
        if self.out:
            about = {"simulated": str(self.simulated), "measured": str(self.measured), "frames": frames}
            write_list(self.out, "generation", scores, about=about)
