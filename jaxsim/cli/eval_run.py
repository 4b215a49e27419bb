"""`jaxsim eval RUN`: a learned sensor's scores beside baselines, or a detector's on its validation frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from jaxsim.cli.eval_detector import judge_run
from jaxsim.cli.source import SAME, Source
from jaxsim.data import open_dataset, select
from jaxsim.data.select import frames_to_judge
from jaxsim.evaluate.fid import frechet_line, frechet_of_run, require_images
from jaxsim.evaluate.paired import baseline_scores, score_pairs
from jaxsim.metrics import Score
from jaxsim.metrics.inception import open_extractor
from jaxsim.pairs.prepared import pairs_before, prepared
from jaxsim.report import pair_picture, save_picture, score_table, write_list, write_scores
from jaxsim.runs.run import is_detector
from jaxsim.simulate.predict import make_predict
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

        # Run: the learned sensor and the settings it was trained with.
        sensor = load(self.run)
        own, prepare = sensor.run.experiment.data, sensor.run.experiment.prepare
        predict = make_predict(sensor.generate, prepare)

        # Frames: those to judge, the one before each, and those that the baselines average.
        own_set, data = open_dataset(own), self.data.config(own)
        dataset = open_dataset(data) if data != own else own_set
        positions = frames_to_judge(self.frames, dataset, validation="" if self.data.foreign else own.validation)
        judged = prepared(dataset, positions, data, prepare)
        before = pairs_before(dataset, positions, data, prepare)
        train = prepared(own_set, select(own.train, own_set), own, prepare)
        extractor = open_extractor(self.fid, self.fid_features) if self.fid else None
        if extractor:
            require_images(len(judged), extractor)

        # Scores: the network and the baselines, on the same cells.
        scores = {"network": score_pairs(predict, sensor.params, judged), **baseline_scores(train, judged, before)}
        write_scores(out, scores, frames=judged.names)
        for name, pair in list(zip(judged.names, judged, strict=True))[: self.pictures]:
            predicted = np.asarray(predict(sensor.params, pair))
            save_picture(out / f"{name}.png", pair_picture(pair, predicted, title=name))
        print(f"{len(judged)} frames of {data.kind}\n\n{score_table(scores)}\n")

        # Fréchet distance: images of the network's size, every judged frame once.
        if extractor:
            cache = own.cache / "statistics"
            frechet = frechet_of_run(sensor.generate, sensor.params, judged, extractor, prepare=prepare, cache=cache)
            about = {"extractor": extractor.name, "images": frechet.counts, "from_half_the_images": frechet.half}
            write_list(out, "frechet", {frechet.name: Score(frechet.value, "1", frechet.counts[0])}, about=about)
            print(f"{frechet_line(frechet)}\n")
        print(f"scores and pictures: {out}")
