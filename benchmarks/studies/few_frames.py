"""A sensor learned from four frames of one drive: how often is it worse than the row's median on another drive?

    python benchmarks/studies/few_frames.py KITTI_RAW OUT [-- --flags of train.py]

Each drive of four frames and more trains `configs/kitti_few` on its first four (a dozen seconds on one core), and is
judged on every other drive, beside the median of each row of the same four frames. Prints a table of the pairs in which
the network is worse, and writes all of them to OUT/pairs.json. What is done is kept in OUT: the same command goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import jaxsim
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import DataConfig
from jaxsim.data import open_dataset
from jaxsim.evaluate.baselines import fit_baselines
from jaxsim.evaluate.intensity import baseline_frames, network_sums
from jaxsim.files import write_text
from jaxsim.metrics.paired import total_scores
from jaxsim.pairs.prepared import prepared
from jaxsim.report.results import markdown_table
from jaxsim.simulate.predict import make_predict
from jaxsim.train.experiments import load_experiment
from jaxsim.train.loop import train_apart

CONFIG, BAR, FRAMES = "kitti_few", "per-row median", 4


class Judged(NamedTuple):
    """Mean absolute errors of the intensity on one drive, of what learned from another's frames."""

    learned: str
    judged: str
    network: float
    median: float


def frames_of(scenes: Sequence[str]) -> dict[str, list[int]]:
    """Positions of each drive's frames."""
    found: dict[str, list[int]] = defaultdict(list)
    for k, scene in enumerate(scenes):
        found[scene].append(k)
    return dict(found)


def summary(pairs: Sequence[Judged]) -> str:
    """How often, where and by how much the network is worse."""
    worse = sorted((p for p in pairs if p.network > p.median), key=lambda p: p.median - p.network)
    network, median = np.mean([(p.network, p.median) for p in pairs], axis=0)
    told = f"{len(pairs)} pairs of drives: network {network:.4f}, {BAR} {median:.4f}; worse in {len(worse)}"
    rows = [[p.learned, p.judged, f"{p.network:.4f}", f"{p.median:.4f}"] for p in worse]
    return f"{told}\n\n{markdown_table(['learned from', 'judged on', 'network', BAR], rows)}"


def main(root: Path, out: Path, flags: Sequence[str]) -> None:
    data = DataConfig(kind="kitti_raw", root=root, cache=out / "cache")
    experiment, dataset = load_experiment(CONFIG)[0], open_dataset(data)
    pairs = prepared(dataset, list(range(len(dataset))), data, prepare=experiment.prepare)
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
        median = fit_baselines([pairs[k] for k in frames])[BAR]
        for other, positions in drives.items():
            if other != drive:
                judged = [pairs[k] for k in positions]
                sums = network_sums(predict, sensor.params, judged), baseline_frames(median, judged)
                found.append(Judged(drive, other, *(total_scores(one)["mae"].value for one in sums)))
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
