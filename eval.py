"""Scores a trained run beside baselines: `python eval.py runs/NAME [--flags]`."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from jaxsim.cli import enable_compilation_cache, stop_on_error
from jaxsim.data import open_dataset, select
from jaxsim.report import pair_picture, save_picture, score_table, write_scores
from jaxsim.simulate import baseline_scores, load, make_predict, prepared, score_pairs


@dataclass(frozen=True)
class Evaluation:
    """Paired scores on the cells that the camera saw, with baselines beside them, and pictures.

    The baselines average the run's own training frames. Writes scores.json, scores.md and pictures (input |
    predicted | measured | difference) to RUN/evaluation.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    data: Literal["same", "synthetic", "kitti_raw", "kitti_object"] = "same"
    """Judge on another data set than the run's own: an unseen drive."""
    root: Path | None = None
    """Folder of the data set, where it is not the run's."""
    frames: str = ""
    """Frames to judge: `0-2`. Empty: the run's validation frames, or all frames of another data set."""
    out: Path | None = None
    """Where to write instead of RUN/evaluation."""
    pictures: int = 4
    """Frames to draw."""


def main(args: Evaluation) -> None:
    # Run: the learned sensor and the settings it was trained with.
    sensor = load(args.run)
    data, prepare = sensor.run.experiment.data, sensor.run.experiment.prepare
    predict = make_predict(sensor.generate, prepare)

    # Frames: those to judge, the one before each, and those that the baselines average.
    own = open_dataset(data)
    foreign = args.data != "same"
    judged_data = dataclasses.replace(
        data, kind=args.data if foreign else data.kind, root=args.root or (None if foreign else data.root)
    )
    dataset = open_dataset(judged_data) if foreign or args.root else own
    positions = select(args.frames or (f"0-{len(dataset) - 1}" if foreign else data.validation), len(dataset))
    judged = prepared(dataset, positions, judged_data, prepare)
    earlier = prepared(dataset, [max(p - 1, 0) for p in positions], judged_data, prepare)
    before = [earlier[k] if p > 0 and earlier.scenes[k] == judged.scenes[k] else None for k, p in enumerate(positions)]
    train = prepared(own, select(data.train, len(own)), data, prepare)

    # Scores: the network and the baselines, on the same cells.
    scores = {
        "network": score_pairs(predict, sensor.params, judged),
        **baseline_scores(train, judged, before),
    }
    out = args.out or args.run / ("evaluation" if not foreign else f"evaluation_{args.data}")
    write_scores(out, scores, frames=judged.names)
    for name, pair in list(zip(judged.names, judged, strict=True))[: args.pictures]:
        predicted = np.asarray(predict(sensor.params, pair))
        save_picture(out / f"{name}.png", pair_picture(pair, predicted, title=name))
    print(f"{len(judged)} frames of {judged_data.kind}\n\n{score_table(scores)}\n\nscores and pictures: {out}")


if __name__ == "__main__":
    enable_compilation_cache()
    with stop_on_error():
        main(tyro.cli(Evaluation))
