"""A sensor learned from four frames of one drive: how often is it worse than the row's median on another drive?

    python benchmarks/studies/few_frames.py KITTI_RAW OUT [-- --flags of train.py]

Each drive of four frames and more trains `configs/kitti_few` on its first four (some twenty seconds on one core), and
is judged on every other drive, beside tables of the same four frames: the median of each row, and of each row, range
and angle of incidence; fitted to what the camera saw, and to the other sides of the scans too, as the network is.
Prints means over the pairs and a table of those in which the network is worse than the row's median, and writes all of
them to OUT/pairs.json. What is done is kept in OUT: the same command goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import jaxsim
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import DataConfig
from jaxsim.data import open_dataset
from jaxsim.data.turned import Turned
from jaxsim.evaluate.baselines import fit_baselines
from jaxsim.evaluate.intensity import baseline_frames, network_sums
from jaxsim.files import write_text
from jaxsim.metrics.paired import total_scores
from jaxsim.pairs.prepared import prepared
from jaxsim.report.results import markdown_table
from jaxsim.simulate.predict import make_predict
from jaxsim.train.experiments import load_experiment
from jaxsim.train.loop import train_apart

CONFIG, FRAMES = "kitti_few", 4
NETWORK, BAR, TABLE = "network", "per-row median", "range, incidence, row"
ALL_SIDES = ", all sides"


class Judged(NamedTuple):
    """Mean absolute errors of the intensity on one drive, of what learned from another's frames."""

    learned: str
    judged: str
    errors: dict[str, float]


def frames_of(scenes: Sequence[str]) -> dict[str, list[int]]:
    """Positions of each drive's frames."""
    found: dict[str, list[int]] = defaultdict(list)
    for k, scene in enumerate(scenes):
        found[scene].append(k)
    return dict(found)


def summary(pairs: Sequence[Judged]) -> str:
    """The mean of each; how often, where and by how much the network is worse than the row's median."""
    names = list(pairs[0].errors)
    means = [[name, f"{np.mean([p.errors[name] for p in pairs]):.4f}"] for name in names]
    above = lambda p: p.errors[NETWORK] - p.errors[BAR]  # noqa: E731
    worse = sorted((p for p in pairs if above(p) > 0), key=above, reverse=True)
    rows = [[p.learned, p.judged, f"{p.errors[NETWORK]:.4f}", f"{p.errors[BAR]:.4f}"] for p in worse]
    return "\n\n".join(
        (
            f"{len(pairs)} pairs of drives, MAE in the mean",
            markdown_table(["fitted to four frames", "MAE"], means),
            f"The network is worse than the {BAR} in {len(worse)}",
            markdown_table(["learned from", "judged on", NETWORK, BAR], rows),
        )
    )


def main(root: Path, out: Path, flags: Sequence[str]) -> None:
    data = DataConfig(kind="kitti_raw", root=root, cache=out / "cache")
    experiment, dataset = load_experiment(CONFIG)[0], open_dataset(data)
    pairs = prepared(dataset, list(range(len(dataset))), data, prepare=experiment.prepare)
    turned, prepare = Turned(dataset), replace(experiment.prepare, inputs=())
    drives = frames_of(pairs.scenes)
    found: list[Judged] = []
    for drive, frames in tqdm([(d, f[:FRAMES]) for d, f in drives.items() if len(f) >= FRAMES], unit="drive"):
        run, first, last = out / "runs" / drive, frames[0], frames[-1]
        if not (run / "card.md").is_file():
            of_data = ["--data.root", root, "--data.cache", data.cache, "--data.train", f"{first}-{last}"]
            of_run = ["--data.validation", f"{first}-{first}", "--run.out", run.parent, "--run.name", drive]
            if status := train_apart(CONFIG, *map(str, [*of_data, *of_run]), *flags):
                sys.exit(f"error: training {run} ended with status {status}; the same command resumes")
        sensor = jaxsim.load(run)
        predict = make_predict(sensor.generate, sensor.run.experiment.prepare)
        own, sides = [pairs[k] for k in frames], prepared(turned, turned.sides(frames), data, prepare=prepare)
        fitted = {"": fit_baselines(own), ALL_SIDES: fit_baselines([*own, *sides])}
        bars = {f"{name}{of}": tables[name] for of, tables in fitted.items() for name in (BAR, TABLE)}
        for other, positions in drives.items():
            if other != drive:
                judged = [pairs[k] for k in positions]
                sums = {NETWORK: network_sums(predict, sensor.params, judged), **baseline_frames(bars, judged)}
                errors = {name: total_scores(of_frames)["mae"].value for name, of_frames in sums.items()}
                found.append(Judged(drive, other, errors))
    write_text(out / "pairs.json", json.dumps([p._asdict() for p in found], indent=1) + "\n")
    print(summary(found))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("out", type=Path)
    given = sys.argv[1:]
    stop = given.index("--") if "--" in given else len(given)
    enable_compilation_cache()
    main(**vars(parser.parse_args(given[:stop])), flags=given[stop + 1 :])
