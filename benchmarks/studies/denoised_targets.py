"""What a denoised target does to the intensity network: trained on raw, on denoised targets, judged by the truth.

    python benchmarks/studies/denoised_targets.py WEIGHTS.npz OUT [--steps 450] [--train 0-959:8] [--judge 1920-2079:4]
        [--targets raw non_local_means lidia lidia_tuned] [--trained raw lidia] [--seeds 2] [--tuning 40]
        [-- FLAGS OF train.py]

WEIGHTS.npz is a file that `jaxsim convert lidia` wrote (the docs' table has model_state_sigma_blind_bw). For every
target of `--trained`, `train.py ablation` learns from the same frames of the embedded world with the same settings; the
target alone differs. Judged on frames of other streets, cell by cell where the camera saw and the beam came back,
against what the sensor would report without noise (truth) and against what it measured. Also the `--targets`
themselves: PSNR to the truth on the judged frames. `lidia_tuned` is the same network after `--tuning` updates of
`lidia_adaptation.adapt` on noisy and noise-free windows of sixteen streets that are neither trained on nor judged. What
is there, trainings and tuned weights, is not made again.

Writes OUT/denoised_targets.json and .jpg, the runs and the tuned weights to OUT.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

import jaxsim
from benchmarks.studies.lidia_adaptation import Adaptation, adapt
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.data import open_dataset, select
from jaxsim.data.records import PairRecord, kept_of
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.data.synthetic.world import cloud_of
from jaxsim.files import replacing
from jaxsim.frame import LOST_BELOW, Frame, Pair
from jaxsim.metrics import paired_scores, paired_sums
from jaxsim.pairs.prepared import pairs_folder, prepared
from jaxsim.prepare.denoise import denoise
from jaxsim.prepare.denoise.lidia import open_lidia, save_lidia
from jaxsim.report.pictures import intensity_panel, save_picture, strip
from jaxsim.report.results import markdown_table
from jaxsim.simulate.discover_sides import measured_in
from jaxsim.simulate.predict import make_predict
from jaxsim.train.experiments import load_experiment

SCRIPT = Path(__file__).parents[2] / "train.py"
TUNED_ON = range(4000, 4064, 4)
"""Frames that the tuned network learns from, one a street."""


def without_noise(world: SyntheticWorld, record: PairRecord) -> np.ndarray:
    """Noise-free intensity of the beams that came back, on the window of the frame's pair.

    Raises ValueError where these are other beams than the pair's.
    """
    truth = world.truth(record.position)
    measured = world.measure(record.position, truth)
    cloud = cloud_of(replace(measured, intensity=truth.image.intensity), world.spec, world.columns)
    frame = Frame(name=record.name, scene=record.scene, camera=record.view, cloud=cloud)
    clean = measured_in((record.grid, record.pair.row_share[:, 0]), frame, lines=world.spec.rows)
    if not (clean.valid == record.pair.measured.valid).all():
        raise ValueError(f"{record.name}: the beams that came back are not those of its pair")
    return np.where(clean.valid, clean.intensity, 0)


def tune(weights: Path, out: Path, prepare: PrepareConfig, data: DataConfig, updates: int) -> Path:
    """Weights after `updates` updates on pairs of noisy and noise-free windows."""
    path = out / f"lidia_tuned_{updates}.npz"
    if path.is_file():
        return path
    world = open_dataset(data)
    raw = prepared(world, TUNED_ON, data, prepare=prepare)
    records = [raw.record(k) for k in range(len(raw))]
    clean = [without_noise(world, record) for record in tqdm(records, desc="truth to tune on", unit="frame")]  # type: ignore
    noisy = np.stack([pair.measured.intensity for pair in raw])
    valid = np.stack([pair.measured.valid for pair in raw])
    blocks = len(clean) * (noisy.shape[2] // noisy.shape[1])
    settings = Adaptation(epochs=max(1, round(updates * 4 / blocks)), lr=1e-3, stride=noisy.shape[1], transpose=False)
    network = adapt(open_lidia(weights), np.stack(clean), valid, settings=settings, noisy=noisy)
    save_lidia(path, network.values)
    return path


def make_pairs(numbers: Sequence[int], data: DataConfig, prepare: PrepareConfig) -> float:
    """Keeps the pairs with this denoiser's target, made of the raw ones: nothing else of a pair depends on it. Seconds
    of processor time for each that was made."""
    raw = prepared(open_dataset(data), numbers, data, prepare=replace(prepare, denoise="none", denoise_weights=None))
    folder = pairs_folder(data, prepare)
    missing = [k for k, i in enumerate(numbers) if not (folder / f"{i:06d}.npz").is_file()]
    begun = time.process_time()
    for k in tqdm(missing, desc=f"denoising: {prepare.denoise}", unit="frame", disable=not missing):
        record = raw.record(k)
        pair = replace(record.pair, target=target_of(record.pair, prepare))
        with replacing(folder / f"{numbers[k]:06d}.npz") as path:
            np.savez(path, **kept_of(replace(record, pair=pair)))
    return (time.process_time() - begun) / max(len(missing), 1)


def target_of(pair: Pair, prepare: PrepareConfig) -> np.ndarray:
    settings = {"weights": prepare.denoise_weights, "statistics": prepare.denoise_statistics}
    return denoise(pair.measured.intensity, pair.measured.valid, prepare.denoise, **settings)  # type: ignore


def train(name: str, out: Path, data: DataConfig, flags: Sequence[str], *, steps: int, seed: int) -> Path:
    """Trains `configs/ablation.py` with these flags; the run's folder."""
    run = out / "runs" / name
    if not (run / "card.md").is_file():
        command = [sys.executable, str(SCRIPT), "ablation", "--data.train", data.train, "--data.validation"]
        command += [data.validation, "--data.cache", str(data.cache), "--optim.steps", str(steps), *flags]
        command += ["--run.seed", str(seed), "--run.out", str(run.parent), "--run.name", name]
        # Validation scores of a training are those to the measurement: once, at its end.
        command += ["--run.picture-every", str(steps), "--run.save-every", str(steps)]
        if status := subprocess.run(command).returncode:
            sys.exit(f"error: training {name} ended with status {status}")
    return run


def scores_of(
    images: Sequence[np.ndarray], pairs: Sequence[Pair], references: Sequence[np.ndarray]
) -> dict[str, float]:
    """mae, rmse, psnr, ssim to the references, on cells that the camera saw and whose beam came back; drop_iou."""
    parts = [
        paired_sums(image, image < LOST_BELOW, reference, returned=pair.measured.valid, m=pair.painted.valid)
        for image, pair, reference in zip(images, pairs, references, strict=True)
    ]
    sums = {key: sum(np.asarray(part[key], np.float64) for part in parts) for key in parts[0]}
    return {name: score.value for name, score in paired_scores(sums).items()}


def predictions(run: Path, pairs: Sequence[Pair]) -> list[np.ndarray]:
    sensor = jaxsim.load(run)
    predict = make_predict(sensor.generate, sensor.run.experiment.prepare)
    return [np.asarray(predict(sensor.params, pair).reported) for pair in pairs]


def main(
    weights: Path,
    out: Path,
    *,
    steps: int,
    train_on: str,
    judge: str,
    targets: Sequence[str],
    trained: Sequence[str],
    seeds: int,
    tuning: int,
    more: Sequence[str],
) -> None:
    out.mkdir(parents=True, exist_ok=True)
    experiment = load_experiment("ablation")[0]
    data = replace(experiment.data, train=train_on, validation=judge, cache=out / "cache")  # type: ignore
    raw: PrepareConfig = experiment.prepare  # type: ignore
    flags: dict[str, list[str]] = {"raw": [], "non_local_means": ["--prepare.denoise", "non_local_means"]}
    methods: dict[str, Callable[[], PrepareConfig]] = {
        "raw": lambda: raw,
        "non_local_means": lambda: replace(raw, denoise="non_local_means"),
        "lidia": lambda: replace(raw, denoise="lidia", denoise_weights=weights),
        "lidia_tuned": lambda: replace(raw, denoise="lidia", denoise_weights=tune(weights, out, raw, data, tuning)),
    }
    world = open_dataset(data)
    numbers = [*select(train_on, world)], [*select(judge, world)]
    kept = prepared(world, numbers[1], data, prepare=raw)
    records, judged = [kept.record(k) for k in range(len(kept))], list(kept)
    truth = [without_noise(world, record) for record in tqdm(records, desc="truth to judge by", unit="frame")]  # type: ignore
    measured = [pair.measured.intensity for pair in judged]

    results: dict[str, dict] = {}
    panels: list[tuple[str, np.ndarray]] = []
    for name in targets:
        prepare = methods[name]()
        if prepare.denoise == "lidia":
            flags[name] = ["--prepare.denoise", "lidia", "--prepare.denoise-weights", str(prepare.denoise_weights)]
        seconds = make_pairs(numbers[1], data, prepare)
        own = [pair.target for pair in prepared(world, numbers[1], data, prepare=prepare)]
        row: dict = {"target_psnr_db": scores_of(own, judged, truth)["psnr"], "seconds_a_frame": seconds, "runs": []}
        title = f"target: {name}, {row['target_psnr_db']:.1f} dB over all frames"
        print(f"{title}; {seconds:.2f} s of processor time a frame", flush=True)
        panels.append((title, intensity_panel(own[0], judged[0].measured.valid)))
        if name in trained:
            make_pairs(numbers[0], data, prepare)
            for seed in range(2, 2 + seeds):
                run = train(f"{name}_{seed}", out, data, [*flags[name], *more], steps=steps, seed=seed)
                images = predictions(run, judged)
                row["runs"].append(
                    {"truth": scores_of(images, judged, truth), "measured": scores_of(images, judged, measured)}
                )
                print(f"{name}, seed {seed}: {row['runs'][-1]}", flush=True)
                if seed == 2:
                    title = f"trained on it: {row['runs'][0]['truth']['psnr']:.1f} dB over all frames"
                    panels.append((title, intensity_panel(images[0], judged[0].painted.valid)))
        results[name] = row
        with replacing(out / "denoised_targets.json") as path:
            path.write_text(json.dumps(results, indent=2))
        end = ("without noise", intensity_panel(truth[0], judged[0].measured.valid))
        save_picture(out / "denoised_targets.jpg", strip([*panels, end], width=756))
    print(table(results))


def table(results: dict[str, dict]) -> str:
    """Means over the seeds."""
    heads = ["target", "target: PSNR", "network to truth: PSNR", "MAE", "to measurement: PSNR", "MAE", "drop IoU"]
    columns = (
        ("truth", "psnr", ".2f", " dB"), ("truth", "mae", ".4f", ""), ("measured", "psnr", ".2f", " dB"),
        ("measured", "mae", ".4f", ""), ("measured", "drop_iou", ".3f", ""),
    )  # fmt: skip
    rows = []
    for name, row in results.items():
        cells = [
            f"{np.mean([run[to][key] for run in row['runs']]):{form}}{unit}" if row["runs"] else ""
            for to, key, form, unit in columns
        ]
        rows.append([name, f"{row['target_psnr_db']:.2f} dB", *cells])
    return markdown_table(heads, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=450)
    parser.add_argument("--train", dest="train_on", default="0-959:8")
    parser.add_argument("--judge", default="1920-2079:4")
    parser.add_argument("--targets", nargs="+", default=["raw", "non_local_means", "lidia", "lidia_tuned"])
    parser.add_argument("--trained", nargs="*", default=["raw", "non_local_means", "lidia", "lidia_tuned"])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--tuning", type=int, default=40)
    cut = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    arguments = parser.parse_args(sys.argv[1:cut])
    enable_compilation_cache()
    main(**vars(arguments), more=sys.argv[cut + 1 :])
