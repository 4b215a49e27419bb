"""`jaxsim eval RUN`: a learned sensor's scores beside baselines, or a detector's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from jaxsim.cli.eval_detection import judge_run
from jaxsim.cli.flags import SAME, DataSource
from jaxsim.config.ranges import Checked, Count, Whole
from jaxsim.evaluate.intensity import frechet_line
from jaxsim.evaluate.runs import LearnedSensorScores, score_learned_sensor
from jaxsim.metrics.inception import open_extractor
from jaxsim.progress import counted
from jaxsim.report.pictures import Rgb, pair_picture, save_pictures
from jaxsim.report.results import write_frechet, write_scores
from jaxsim.runs.frames import read_frames
from jaxsim.runs.run import is_detector, load_run
from jaxsim.simulate.learned_sensor import LearnedSensor, load


@dataclass(frozen=True)
class Evaluation(Checked):
    """Paired scores on the cells that the camera saw, with baselines beside them, and pictures.

    The baselines are fitted to the run's own training frames; where two scenes or more are judged, every score has its
    interval over them. Writes scores.json, scores.md and pictures (input | predicted | measured | difference, and
    the spread where the network gives one) to RUN/evaluation, in the place of an earlier evaluation's. Of a detector's
    run: KITTI's average precision.

    Also: jaxsim eval generation (two folders of frames or clouds), jaxsim eval detection (KITTI result files),
    jaxsim eval ablation (networks of different inputs in one table); each has its own --help.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    data: DataSource = SAME
    """Data set to judge on; another than the run's own is an unseen drive."""
    frames: str = ""
    """Frames to judge: `0-2`, or a part by name: `evaluation`. Empty: the validation frames, or all of another set."""
    out: Path | None = None
    """Where to write instead of RUN/evaluation."""
    trees: bool = False
    """Also fit boosted trees to the training frames, the strongest baseline (minutes; needs scikit-learn, the extra
    `trees`)."""
    pictures: Whole = 4
    """Frames to draw."""
    fid: str = ""
    """Also the Fréchet Inception distance between predicted and measured intensity images: Inception weights from
    `jaxsim convert` (FILE.npz), or `random` for a network of random weights, whose score is called frechet_random."""
    fid_features: Count = 2048
    """Features of Inception: 2048, or 768, 192, 64 for small sets (another score, under another name)."""

    @property
    def writes_to(self) -> Path:
        """The folder that one process has while the command runs. Raises ValueError where the run is a file."""
        if self.run.is_file():  # that no folder can be made in it would say less
            load_run(self.run)
        return self.out or self.run / (f"evaluation_{self.data.kind}" if self.data.foreign else "evaluation")

    def __call__(self) -> None:
        out = self.writes_to
        if is_detector(self.run):
            if self.trees or self.fid:
                raise ValueError(f"eval: {self.run} is a detector's run, which --trees and --fid are not for")
            return judge_run(self.run, self.data, frames=self.frames, out=out, pictures=self.pictures)

        learned = load(self.run)
        of_run = learned.run.experiment.data
        data, validation = self.data.config(of_run), self.data.validation(of_run)
        extractor = open_extractor(self.fid, self.fid_features) if self.fid else None
        asked = {"frames": self.frames, "validation": validation, "recorded": read_frames(self.run)}
        judged = score_learned_sensor(learned, data, **asked, trees=self.trees, extractor=extractor)

        names = judged.pairs.names
        over_scenes = {"intervals": judged.intervals, "differences": judged.differences, "scenes": judged.scenes}
        tables = write_scores(out, judged.scores, frames=names, distribution=judged.distribution, **over_scenes)
        save_pictures(out, _drawn(judged, learned, self.pictures), by="eval")
        print(f"{counted(len(judged.pairs), 'frame')} of {data.kind}\n\n{tables}\n")
        if extractor and judged.frechet:
            write_frechet(out, judged.frechet, extractor=extractor.name)
            print(f"{frechet_line(judged.frechet)}\n")
        print(f"scores and pictures: {out}")


def _drawn(judged: LearnedSensorScores, learned: LearnedSensor, count: int) -> Iterator[tuple[str, Rgb]]:
    """The name and the picture of each of the first frames that were judged."""
    for name, pair in zip(judged.pairs.names[:count], judged.pairs, strict=False):
        says = judged.predict(learned.params, pair)
        spread = None if says.quantiles is None else np.asarray(says.quantiles[..., -1] - says.quantiles[..., 0])
        yield name, pair_picture(pair, np.asarray(says.reported), title=name, spread=spread)
