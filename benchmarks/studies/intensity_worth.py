"""What a detector makes of intensity: real clouds as measured, with all intensities 0, and with shuffled ones.

    python benchmarks/studies/intensity_worth.py LOOP [--checkpoints 5] [--trained real simulated_64 raw_64]

LOOP is the folder of `jaxsim real2sim2real`, with trained detectors in it. Each is scored again on the loop's real
frames, where nothing changes but the intensity of their points: `shuffled` gives a scene's intensities to its points at
random, so that they say nothing of the surfaces while their distribution stays. What a detector loses by that is what
intensity is worth to it; what one gains by zeros is what unseen intensities cost it.

Moderate AP R40 in space at the first overlap, mean of the last checkpoints; mean and standard deviation over the seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from jaxsim.compilation import enable_compilation_cache
from jaxsim.data import open_dataset, select
from jaxsim.detect.scenes import Scene
from jaxsim.evaluate.detector import experiment_scenes, load_detector, make_find, mean_curves, score_detector
from jaxsim.report.results import markdown_table
from jaxsim.runs.run import Checkpoints


def zero(intensity: np.ndarray) -> np.ndarray:
    return np.zeros_like(intensity)


def shuffled(intensity: np.ndarray) -> np.ndarray:
    return np.random.default_rng(0).permutation(intensity)


CLOUDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"as measured": np.asarray, "zero": zero, "shuffled": shuffled}


def with_intensity(scene: Scene, change: Callable[[np.ndarray], np.ndarray]) -> Scene:
    points = scene.points.copy()
    points[:, 3] = change(points[:, 3])
    return replace(scene, points=points)


def average(run: Path, checkpoints: int, judged: Path) -> dict[str, float]:
    """AP by kind of intensity, of a detector on the frames of the run `judged`."""
    detector, real = load_detector(run).experiment, load_detector(judged).experiment
    dataset = open_dataset(real.data)
    scenes = experiment_scenes(dataset, select(real.data.validation, dataset), replace(detector, data=real.data))
    find, steps = make_find(detector), Checkpoints(run).steps[-checkpoints:]
    networks = [load_detector(run, step=step).network for step in steps]
    found = {}
    for name, change in CLOUDS.items():
        clouds = [with_intensity(scene, change) for scene in scenes]
        curves = [score_detector(find, network, clouds, experiment=detector)[0] for network in networks]
        found[name] = mean_curves(curves)["3d", "0.7", "moderate"][0]
    return found


def main(loop: Path, checkpoints: int, trained: Sequence[str]) -> None:
    seeds = sorted(path for path in (loop / "detectors").glob("seed*") if (path / "real" / "card.md").is_file())
    if not seeds:
        raise SystemExit(f"error: no finished detector in {loop}/detectors/seed*/real; jaxsim real2sim2real makes them")
    rows = []
    for kind in trained:
        runs = [seed / kind for seed in seeds if (seed / kind / "card.md").is_file()]
        scores = [average(run, checkpoints, run.parent / "real") for run in tqdm(runs, desc=kind, unit="seed")]
        columns = {name: [score[name] for score in scores] for name in CLOUDS}
        rows.append(
            [kind, f"{len(runs)}", *(f"{np.mean(x):.1f} ± {np.std(x, ddof=len(x) > 1):.1f}" for x in columns.values())]
        )
        print(rows[-1], flush=True)
    print(markdown_table(["trained on", "seeds", *(f"real, {name}" for name in CLOUDS)], rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("loop", type=Path)
    parser.add_argument("--checkpoints", type=int, default=5)
    parser.add_argument("--trained", nargs="+", default=["real", "simulated_64", "raw_64"])
    enable_compilation_cache()
    main(**vars(parser.parse_args()))
