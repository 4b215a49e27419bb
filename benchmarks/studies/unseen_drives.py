"""Real drives that were never seen: `configs/kitti_drives` trained without each fold of drives, beside its baselines.

    python benchmarks/studies/unseen_drives.py ROOT OUT [--folds 0 1 2 3 4] [--seeds 2] [--config kitti_drives]
        [--frames]
        [-- FLAGS OF jaxsim train]

ROOT holds `2011_09_26/`. For each fold of `configs.kitti_drives.FOLDS` a network learns from the other drives,
baselines are fitted to the same frames, and all are scored on the cells of the fold's drives: every drive is judged
once, by what has not seen it. Of several seeds their mean is judged (`jaxsim join`), and each of them. What is there,
trainings and scores, is not made again.

Writes OUT/unseen_drives.md and .json (scores with intervals over drives, errors by drive), .svg (each drive's error
beside that of boosted trees), and pictures of a frame of each drive: OUT/pictures. With --frames also the frames of
all folds as polar folders, OUT/frames/simulated and OUT/frames/measured, which `jaxsim discover` compares.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import jaxsim
from configs.kitti_drives import FOLDS
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import QUANTILES, DataConfig, Experiment
from jaxsim.data import open_dataset, select
from jaxsim.data.polar_frames import frame_names, read_grid, write_grid
from jaxsim.evaluate.baselines import fit_baselines, fit_trees
from jaxsim.evaluate.intensity import TREES, PairedSums, baseline_frames, network_sums
from jaxsim.files import replacing
from jaxsim.frame import INTENSITY_STEP
from jaxsim.metrics.intervals import ratio_interval
from jaxsim.metrics.paired import difference_of, scene_intervals, total_scores
from jaxsim.pairs.prepared import prepared
from jaxsim.report.canvas import AFTER, FAINT, RULE, Canvas, save_figure
from jaxsim.report.charts import label, ticks
from jaxsim.report.pictures import pair_picture, save_picture
from jaxsim.report.results import difference_table, markdown_table, score_table
from jaxsim.simulate.discover_sides import write_both_sides
from jaxsim.simulate.predict import make_predict
from jaxsim.train.experiments import load_experiment
from jaxsim.train.join import join_runs
from jaxsim.train.loop import train_apart

BAR = "trees, context"
FACTORS = np.arange(0.5, 2.51, 0.05)
"""By which quantiles may lie farther from the median than they do (`--generator.widen` times them)."""


def baselines_of(fold: int, data: DataConfig, experiment: Experiment, out: Path) -> dict[str, PairedSums]:
    """Sums of each baseline on each frame of the fold; a kind of baseline is fitted once, and kept in OUT/sums."""
    dataset = open_dataset(data)
    judged = prepared(dataset, select(FOLDS[fold], dataset), data, prepare=experiment.prepare)
    train = prepared(dataset, select(f"all but {FOLDS[fold]}", dataset), data, prepare=experiment.prepare)
    kinds = {"tables": lambda: fit_baselines(train)}
    for name, context in TREES.items():
        kinds[name] = lambda name=name, context=context: {name: fit_trees(train, context=context)}
    found: dict[str, PairedSums] = {}
    for kind, fit in kinds.items():
        path = out / "sums" / f"{kind.replace(', ', '_').replace(' ', '_')}_{fold}.json"
        if not path.is_file():
            sums = baseline_frames(fit(), judged)
            with replacing(path) as temporary:
                temporary.write_text(json.dumps(sums))
        found |= json.loads(path.read_text())
    return found


def network_of(fold: int, seed: int, data: DataConfig, *, config: str, out: Path, flags: Sequence[str]) -> Path:
    """The run that learned from the other folds; trains it where it is not done."""
    run = out / "runs" / f"fold{fold}_seed{seed}"
    if not (run / "card.md").is_file():
        arguments = ["--data.root", data.root, "--data.cache", data.cache, "--data.train", f"all but {FOLDS[fold]}"]
        arguments += ["--data.validation", FOLDS[fold], "--run.out", run.parent, "--run.name", run.name]
        status = train_apart(config, *map(str, arguments), "--run.seed", str(seed), *flags)
        if status:
            sys.exit(f"error: training {run} ended with status {status}; the same command resumes")
    return run


def joined(runs: Sequence[Path], fold: int, out: Path) -> Path:
    """The one run, or the mean of several."""
    if len(runs) == 1:
        return runs[0]
    run = out / "runs" / f"fold{fold}_of_{'_'.join(path.name.rpartition('seed')[2] for path in runs)}"
    join_runs(runs, run)
    return run


def score_run(run: Path, fold: int, data: DataConfig, out: Path) -> dict[str, Any]:
    """Of each frame of the fold the network's sums, and how many measurements its outer quantiles cover at each of
    FACTORS; once, kept in OUT/sums. Draws a frame of each drive."""
    path = out / "sums" / f"{run.name}.json"
    if path.is_file():
        return json.loads(path.read_text())
    sensor, dataset = jaxsim.load(run), open_dataset(data)
    prepare = sensor.run.experiment.prepare
    pairs = prepared(dataset, select(FOLDS[fold], dataset), data, prepare=prepare)
    predict = make_predict(sensor.generate, prepare)
    covered: list[list[int]] = []
    counts: list[int] = []
    widths: list[float] = []
    drawn: set[str] = set()
    for name, scene, pair in zip(pairs.names, pairs.scenes, pairs, strict=True):
        says = predict(sensor.params, pair)
        assert says.quantiles is not None
        quantiles, value = np.asarray(says.quantiles), np.asarray(pair.measured.intensity)
        seen = np.asarray(pair.painted.valid & pair.measured.valid)
        below, above = quantiles[..., 0][seen], quantiles[..., -1][seen]
        middle = quantiles[..., QUANTILES.index(0.5)][seen]
        value = value[seen]
        covered.append(
            [
                int(
                    (
                        (value >= middle + f * (below - middle) - INTENSITY_STEP / 2)
                        & (value <= middle + f * (above - middle) + INTENSITY_STEP / 2)
                    ).sum()
                )
                for f in FACTORS
            ]
        )
        counts.append(len(value))
        widths.append(float((above - below).sum()))
        if scene not in drawn:
            drawn.add(scene)
            spread = quantiles[..., -1] - quantiles[..., 0]
            picture = pair_picture(pair, np.asarray(says.reported), title=name, spread=spread)
            save_picture(out / "pictures" / f"{name}.png", picture)
    found = {
        "names": pairs.names,
        "scenes": pairs.scenes,
        "sums": network_sums(predict, sensor.params, pairs),
        "covered": covered,
        "counts": counts,
        "widths": widths,
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(found))
    return found


def as_folders(run: Path, fold: int, data: DataConfig, out: Path) -> None:
    """Adds the fold's frames, simulated by the run that has not seen them and measured, to OUT/frames."""
    dataset = open_dataset(data)
    judged = select(FOLDS[fold], dataset)
    for folder in write_both_sides(jaxsim.load(run), dataset, judged, out=out / "folds" / str(fold)):
        together = out / "frames" / folder.name
        grid, about = read_grid(folder)
        known = read_grid(together)[1] if (together / "grid.json").is_file() else {}
        together.mkdir(parents=True, exist_ok=True)
        for name in frame_names(folder):
            with replacing(together / f"{name}.npz") as path:
                shutil.copyfile(folder / f"{name}.npz", path)
        write_grid(together, grid, frames=known | about)


def scatter(of_network: Mapping[str, float], of_trees: Mapping[str, float], frames: Mapping[str, int]) -> Canvas:
    """Each drive a dot: the network's error over that of trees; below the line the network is nearer."""
    size, margin = 420, 64
    values = [*of_network.values(), *of_trees.values()]
    low, high = 0.9 * min(values), 1.05 * max(values)
    place = lambda value: (value - low) / (high - low) * size  # noqa: E731
    canvas = Canvas(size + margin + 70, size + 2 * margin)
    bottom = margin / 2 + size
    for tick in ticks(low, high):
        canvas.line([(margin + place(tick), margin / 2), (margin + place(tick), bottom)], colour=RULE)
        canvas.line([(margin, bottom - place(tick)), (margin + size, bottom - place(tick))], colour=RULE)
        canvas.text(margin + place(tick), bottom + 17, label(tick), anchor="middle", size=11, colour=FAINT)
        canvas.text(margin - 7, bottom - place(tick) + 4, label(tick), anchor="end", size=11, colour=FAINT)
    canvas.line([(margin, bottom), (margin + size, margin / 2)], colour=FAINT)
    dots = {drive: (margin + place(of_trees[drive]), bottom - place(error)) for drive, error in of_network.items()}
    for drive, (x, y) in dots.items():
        canvas.dot(x, y, colour=AFTER, radius=3 + frames[drive] ** 0.5 / 2)
    # Names stay clear of the dots, and of one another.
    taken = [*dots.values()]
    for drive, (x, y) in sorted(dots.items(), key=lambda entry: entry[1][1]):
        while any(x + 1 < tx < x + 40 and abs(ty - y) < 11 for tx, ty in taken):
            y += 1
        canvas.text(x + 9, y + 4, drive, size=11)
        taken += [(x + 9 + step, y) for step in (0, 13, 26)]
    canvas.text(
        margin + size / 2, bottom + 40, "trees with context, mean absolute error of a drive", anchor="middle", size=13
    )
    canvas.text(16, margin / 2 + size / 2, "network, the same", anchor="middle", size=13, turned=True)
    return canvas


def short(scene: str) -> str:
    return scene.split("_drive_")[-1].removesuffix("_sync")


def by_drive(sums: PairedSums, scenes: Sequence[str]) -> dict[str, float]:
    """Mean absolute error of each drive."""
    found = {}
    for scene in dict.fromkeys(scenes):
        own = [frame for frame, name in zip(sums, scenes, strict=True) if name == scene]
        found[short(scene)] = sum(f["absolute"] for f in own) / sum(f["cells"] for f in own)
    return dict(sorted(found.items()))


@dataclass
class Coverage:
    """What the outer quantiles cover, a frame an entry; the fold that each is of."""

    scenes: list[str] = field(default_factory=list)
    folds: list[int] = field(default_factory=list)
    inside: list[list[int]] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)

    def add(self, fold: int, judged: Mapping[str, Any]) -> None:
        self.scenes += judged["scenes"]
        self.folds += [fold] * len(judged["scenes"])
        self.inside += judged["covered"]
        self.counts += judged["counts"]
        self.widths += judged["widths"]

    def told(self) -> str:
        """Coverage as it stands; and at the factor of each fold that the drives of all other folds ask for."""
        own = int(np.argmin(np.abs(FACTORS - 1)))
        aim = QUANTILES[-1] - QUANTILES[0]
        text = f"{round(100 * aim)} % intervals cover {self._share([own] * len(self.counts))}"
        folds = np.array(self.folds)
        if len(set(self.folds)) == 1:
            return text
        inside, counts = np.array(self.inside), np.array(self.counts)
        asked = {
            fold: int(np.argmin(np.abs(inside[folds != fold].sum(0) / counts[folds != fold].sum() - aim)))
            for fold in set(self.folds)
        }
        factors = sorted(FACTORS[k] for k in asked.values())
        every = FACTORS[np.argmin(np.abs(inside.sum(0) / counts.sum() - aim))]
        of_others = self._share([asked[fold] for fold in self.folds])
        return (
            f"{text}. With the quantiles of each fold {factors[0]:.2f} to {factors[-1]:.2f} times as far from the "
            f"median, which is what the drives of the other folds ask for, {of_others}. "
            f"All drives together ask for {every:.2f}"
        )

    def _share(self, at: Sequence[int]) -> str:
        """The share inside with its interval over drives, by drive, and the mean width, at a factor for each frame."""
        drives = sorted(set(self.scenes))
        scenes = np.array(self.scenes)
        columns = np.array(
            [
                [row[k], n, FACTORS[k] * w]
                for row, k, n, w in zip(self.inside, at, self.counts, self.widths, strict=True)
            ]
        )
        total = np.array([columns[scenes == drive].sum(0) for drive in drives])
        low, high = ratio_interval(total[:, 0], total[:, 1])
        share, each = total[:, 0].sum() / total[:, 1].sum(), total[:, 0] / total[:, 1]
        return (
            f"{100 * share:.1f} % ({100 * low:.1f}..{100 * high:.1f}) of the measurements, {100 * each.min():.1f} to "
            f"{100 * each.max():.1f} % by drive, with a mean width of {total[:, 2].sum() / total[:, 1].sum():.3f}"
        )


def main(
    root: Path,
    out: Path,
    *,
    folds: Sequence[int],
    seeds: Sequence[int],
    config: str,
    frames: bool,
    flags: Sequence[str],
) -> None:
    experiment = load_experiment(config)[0]
    assert isinstance(experiment, Experiment)
    data = replace(experiment.data, root=root, cache=out / "cache")
    scenes: list[str] = []
    sums: dict[str, PairedSums] = {}
    coverage = Coverage()
    for fold in tqdm(folds, desc="folds", unit="fold"):
        rows = baselines_of(fold, data, experiment, out)
        runs = {seed: network_of(fold, seed, data, config=config, out=out, flags=flags) for seed in seeds}
        if len(runs) > 1:
            rows |= {f"network, seed {seed}": score_run(run, fold, data, out)["sums"] for seed, run in runs.items()}
        run = joined(list(runs.values()), fold, out)
        scored = score_run(run, fold, data, out)
        if frames:
            as_folders(run, fold, data, out)
        rows |= {"network": scored["sums"]}
        scenes += scored["scenes"]
        coverage.add(fold, scored)
        for name, of_frames in rows.items():
            sums.setdefault(name, []).extend(of_frames)
    order = sorted(sums, key=lambda name: -total_scores(sums[name])["mae"].value)
    scores = {name: total_scores(sums[name]) for name in order}
    intervals = {name: scene_intervals(sums[name], scenes) for name in order}
    differences = {name: difference_of(sums["network"], sums[name], scenes) for name in order if name != "network"}
    errors = {name: by_drive(sums[name], scenes) for name in order}
    shown = [name for name in ("per-row median", "range, incidence, row", *TREES, "network") if name in errors]
    counts = {short(scene): scenes.count(scene) for scene in scenes}
    rows = [[drive, str(counts[drive]), *(f"{errors[name][drive]:.4f}" for name in shown)] for drive in sorted(counts)]
    covers = coverage.told()
    text = [
        f"{len(scenes)} frames of {len(counts)} drives, each judged by what has not seen it; intervals over drives",
        score_table(scores, intervals),
        difference_table(differences),
        markdown_table(["drive", "frames", *shown], rows),
        covers,
    ]
    content = {
        "mae_by_drive": errors,
        "scores": {name: {k: s.value for k, s in row.items()} for name, row in scores.items()},
    }
    with replacing(out / "unseen_drives.md") as path:
        path.write_text("\n\n".join(text) + "\n")
    with replacing(out / "unseen_drives.json") as path:
        path.write_text(json.dumps(content | {"coverage": covers}, indent=2))
    drawn = scatter(errors["network"], errors[BAR], counts)
    save_figure(out, "unseen_drives", drawn, words="Each drive's error, the network's beside the bar's")
    print("\n\n".join(text))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--folds", type=int, nargs="+", default=list(range(len(FOLDS))))
    parser.add_argument("--seeds", type=int, nargs="+", default=[2])
    parser.add_argument("--config", default="kitti_drives")
    parser.add_argument("--frames", action="store_true")
    given = sys.argv[1:]
    stop = given.index("--") if "--" in given else len(given)
    enable_compilation_cache()
    main(**vars(parser.parse_args(given[:stop])), flags=given[stop + 1 :])
