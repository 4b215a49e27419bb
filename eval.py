"""Scores a trained run beside baselines: `python eval.py runs/NAME [--flags]`.

`python eval.py generation --simulated DIR --measured DIR` compares two folders of frames or clouds.
`python eval.py ablation --runs RUN ...` puts networks of different inputs into one table.
`python eval.py detection --detections DIR --labels DIR` scores a detector's KITTI result files.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from jaxsim.cli import enable_compilation_cache, stop_on_error
from jaxsim.cli.ablation import Ablation, ablation
from jaxsim.cli.detection import Detection, judge
from jaxsim.cli.detector_run import judge_run
from jaxsim.config import DataKind
from jaxsim.data import open_dataset, select, source_of
from jaxsim.evaluate.fid import frechet_line, frechet_of_run, require_images
from jaxsim.evaluate.generation import generation_scores, open_folder
from jaxsim.evaluate.paired import baseline_scores, score_pairs
from jaxsim.metrics import Score
from jaxsim.metrics.generation.rangenet import load_rangenet
from jaxsim.metrics.inception import open_extractor
from jaxsim.pairs.prepared import pairs_before, prepared
from jaxsim.report import list_scores, pair_picture, save_picture, score_table, write_list, write_scores
from jaxsim.runs.run import is_detector
from jaxsim.simulate.predict import make_predict
from jaxsim.simulate.sensor import load


@dataclass(frozen=True)
class Evaluation:
    """Paired scores on the cells that the camera saw, with baselines beside them, and pictures.

    The baselines average the run's own training frames. Writes scores.json, scores.md and pictures (input |
    predicted | measured | difference) to RUN/evaluation.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    data: Literal["same", DataKind] = "same"
    """Judge on another data set than the run's own: an unseen drive."""
    root: Path | None = None
    """Folder of the data set, where it is not the run's."""
    scenes: tuple[str, ...] = ()
    """Sequences of the data set to use, where it is not the run's: `0001 0018`."""
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


def main(args: Evaluation) -> None:
    if is_detector(args.run):
        return judge_run(args.run, data=args.data, root=args.root, scenes=args.scenes, frames=args.frames, out=args.out)

    # Run: the learned sensor and the settings it was trained with.
    sensor = load(args.run)
    data, prepare = sensor.run.experiment.data, sensor.run.experiment.prepare
    predict = make_predict(sensor.generate, prepare)

    # Frames: those to judge, the one before each, and those that the baselines average.
    own = open_dataset(data)
    foreign = args.data != "same"
    judged_data = source_of(data, args.data, root=args.root, scenes=args.scenes)
    dataset = open_dataset(judged_data) if judged_data != data else own
    positions = select(args.frames or (f"0-{len(dataset) - 1}" if foreign else data.validation), dataset)
    judged = prepared(dataset, positions, judged_data, prepare)
    before = pairs_before(dataset, positions, judged_data, prepare)
    train = prepared(own, select(data.train, own), data, prepare)
    extractor = None
    if args.fid:
        extractor = open_extractor(args.fid, args.fid_features)
        require_images(len(judged), extractor)

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
    print(f"{len(judged)} frames of {judged_data.kind}\n\n{score_table(scores)}\n")

    # Fréchet distance: images of the network's size, every judged frame once.
    if extractor:
        cache = data.cache / "statistics"
        frechet = frechet_of_run(sensor.generate, sensor.params, judged, extractor, prepare=prepare, cache=cache)
        about = {"extractor": extractor.name, "images": frechet.counts, "from_half_the_images": frechet.half}
        write_list(out, "frechet", {frechet.name: Score(frechet.value, "1", frechet.counts[0])}, about=about)
        print(f"{frechet_line(frechet)}\n")
    print(f"scores and pictures: {out}")


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


def compare(args: Generation) -> None:
    folders = open_folder(args.simulated), open_folder(args.measured)
    scores = generation_scores(*folders, rangenet=load_rangenet(args.rangenet) if args.rangenet else None)
    frames = [len(folder.names) for folder in folders]
    print(f"{frames[0]} simulated and {frames[1]} measured frames\n\n{list_scores(scores)}")
    if args.out:
        about = {"simulated": str(args.simulated), "measured": str(args.measured), "frames": frames}
        write_list(args.out, "generation", scores, about=about)


if __name__ == "__main__":
    enable_compilation_cache()
    with stop_on_error():
        if sys.argv[1:2] == ["generation"]:
            compare(tyro.cli(Generation, args=sys.argv[2:], prog="eval.py generation"))
        elif sys.argv[1:2] == ["detection"]:
            judge(tyro.cli(Detection, args=sys.argv[2:], prog="eval.py detection"))
        elif sys.argv[1:2] == ["ablation"]:
            end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
            asked = tyro.cli(Ablation, args=sys.argv[2:end], prog="eval.py ablation")
            ablation(asked, flags=sys.argv[end + 1 :])
        else:
            main(tyro.cli(Evaluation))
