"""Whether two commits give the same answers, bit for bit: to be run before and after code is moved.

    python -m benchmarks.same BEFORE               on the one commit
    python -m benchmarks.same AFTER                on the other, on the same machine
    python -m benchmarks.same --compare BEFORE AFTER

Small inputs of every kind of work: `discover` on eight development cases, twenty training steps of each of the three
trainers, and `simulate`, `export`, `prepare` and `detect`. One thread, for sums differ with the number of threads.
OUT/record.json gets every value of the JSON files and a SHA-256 of every array and other file that came out; OUT/work
holds these files themselves. Times, dates and fingerprints of code are left out: they never come twice.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    # What JAX reads from the environment, before it is imported.
    os.environ.update(
        JAX_PLATFORMS="cpu",
        JAXSIM_QUIET="1",
        OMP_NUM_THREADS="1",
        OPENBLAS_NUM_THREADS="1",
        XLA_FLAGS="--xla_cpu_multi_thread_eigen=false --xla_backend_optimization_level=1",
    )

import numpy as np

from benchmarks.blind.hidden import make_case
from benchmarks.blind.hidden.streets import make_unpaired
from jaxsim.cli import main
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import DepthExperiment, DetectorExperiment, Experiment, Stage
from jaxsim.discover import discover_folders, discover_unpaired
from jaxsim.effects.chain import SensorModel
from jaxsim.files import write_text
from jaxsim.report.discovery import write_report
from jaxsim.train import load_experiment, train

SMALL = {"scenes": 12, "rows": 24, "columns": 192, "seed": 4711}
CANDIDATES = (
    *("beam_gain", "range_falloff", "incidence_cosine", "gamma_response", "intensity_offset"),
    *("beam_range_bias", "range_noise", "random_dropout", "material_dropout", "extrinsic_rotation"),
)
"""Those of the paired cases: of every channel, and some that look alike."""
CASES = {
    "intensity": {"effect": "beam_gain", "severity": 4.0},
    "range": {"effect": "beam_range_bias", "severity": 4.0},
    "drop": {"effect": "material_dropout", "severity": 4.0},
    "pair": {"effect": "range_falloff+random_dropout", "severity": 4.0},
    "exact": {"effect": "none", "nuisance": "exact"},
    "misspecified": {"effect": "none", "nuisance": "misspecified"},
    "outside": {"effect": "outside:azimuth_periodic_gain", "severity": 4.0},
}
UNPAIRED = {"effect": "beam_gain", "severity": 4.0, "scenes": 16, "rows": 24, "columns": 192, "seed": 4711}
STEPS = 20
FRESH = ("seconds", "fingerprint", "sources")
"""Names of values that never come twice: times, hashes of code, and stamps of files, which tell their times."""
PAGES = (".html", ".md")
"""What tells times in its text."""


def run(out: Path, only: list[str]) -> None:
    """Makes everything anew in OUT/work, or those that are named, and writes OUT/record.json."""
    enable_compilation_cache()
    record_path = (out / "record.json").resolve()
    record = json.loads(record_path.read_text()) if record_path.is_file() else {}
    work = out / "work"
    work.mkdir(parents=True, exist_ok=True)
    # Paths stand in what is written: they are to be the same wherever OUT lies.
    os.chdir(work)
    jobs = {
        **{f"discover/{name}": discover_case for name in CASES},
        "discover/unpaired": discover_streets,
        "train/intensity": train_intensity,
        "train/detector": train_detector,
        "train/depth": train_depth,
        "simulate": simulate,
        "export": export,
        "prepare": prepare,
        "detect": detect,
    }
    for name, job in jobs.items():
        if only and name not in only:
            continue
        folder = Path(name)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        before = os.times()
        job(folder)
        after = os.times()
        record = {key: value for key, value in record.items() if not key.startswith(f"{name}/")} | dict(told(folder))
        write_text(record_path, json.dumps(record, indent=1))
        print(f"{name}: {after.user + after.system - before.user - before.system:.0f} s of processor time", flush=True)


def discover_case(folder: Path) -> None:
    case = folder / "case"
    make_case(case, **SMALL, **CASES[folder.name])
    nulls = 2 if folder.name == "intensity" else 0
    both = {"simulated": case / "simulated", "measured": case / "measured"}
    save_answer(folder, discover_folders(**both, effects=CANDIDATES, nulls=nulls))


def discover_streets(folder: Path) -> None:
    case = folder / "case"
    make_unpaired(case, **UNPAIRED)
    save_answer(folder, discover_unpaired(simulated=case / "simulated", measured=case / "measured", per_scene=2000))


def save_answer(folder: Path, result: Any) -> None:
    """Writes what `jaxsim discover` writes, the time left out; the case is made anew by its seed and goes."""
    result = replace(result, verdict=replace(result.verdict, seconds=0.0))
    result.verdict.save(folder)
    result.effects_model.save(folder / "sensor.json")
    write_text(folder / "report.sha256", hashlib.sha256(write_report(folder, result).read_bytes()).hexdigest())
    shutil.rmtree(folder / "case")
    (folder / "case.key.json").unlink()


def train_intensity(folder: Path) -> None:
    made, _ = load_experiment("synthetic")
    assert isinstance(made, Experiment)
    train(
        replace(
            made,
            data=replace(made.data, train="0-3", validation="4-5"),
            prepare=replace(made.prepare, columns=64, network_size=(64, 128)),
            generator=replace(made.generator, filters=4, blocks=1, downsamples=2, enhancer_blocks=1),
            discriminator=replace(made.discriminator, filters=4, max_filters=8, scales=1, layers=1),
            optim=replace(made.optim, batch=2, steps=STEPS, ema_start=2),
            run=short(made.run, folder),
        )
    )


def train_detector(folder: Path) -> None:
    made, _ = load_experiment("voxel_rcnn_small")
    assert isinstance(made, DetectorExperiment)
    network = made.detector
    train(
        replace(
            made,
            data=replace(made.data, train="0-12:4", validation="1920-1924:4"),
            voxels=replace(
                made.voxels,
                range_m=(0.0, -12.8, -3.0, 25.6, 12.8, 1.0),
                max_voxels_train=3000,
                max_voxels=3000,
                max_points=8192,
                growth=(2.5, 2.0, 1.0, 0.8),
            ),
            detector=replace(
                network,
                backbone=replace(network.backbone, widths=(4, 8, 8, 8), out=8, bev_layers=(1, 1), bev_widths=(16, 16)),
                roi=replace(network.roi, width=8, layers=(16, 16), rois=24),
                proposals=replace(network.proposals, before=128, after=24),
                train_proposals=replace(network.train_proposals, before=256, after=64),
                final=replace(network.final, before=64, after=24),
            ),
            # Two scenes a step and four scenes: two steps an epoch.
            optim=replace(made.optim, batch=2, epochs=STEPS // 2),
            run=short(made.run, folder),
        )
    )


def train_depth(folder: Path) -> None:
    made, _ = load_experiment("penet_synthetic")
    assert isinstance(made, DepthExperiment)
    crop = (32, 64)
    # Four frames, two a step: two steps an epoch.
    stages = (
        Stage("branches", STEPS // 2 - 3, 2, crop, ((3, 0.4),), "renorm"),
        Stage("refinement", 1, 2, crop, (), "renorm"),
        Stage("joint", 2, 2, crop, (), "stored"),
    )
    train(
        replace(
            made,
            data=replace(made.data, train="0-15:4", validation="1920-1924:4"),
            image_crop=(64, 128),
            penet=replace(made.penet, width=2, stages=stages),
            run=short(made.run, folder),
        )
    )


def short(settings: Any, folder: Path) -> Any:
    """The settings of a run of few steps in this folder."""
    return replace(settings, name=folder.name, out=folder.parent, log_every=1, save_every=10, picture_every=10)


def simulate(folder: Path) -> None:
    needs("train/intensity")
    effects = {"range_noise": {"sd_m": 0.05}, "random_dropout": {"probability": 0.1}}
    SensorModel(tuple(effects.items())).save(folder / "effects.json")
    given = [*at(folder), "--effects", str(folder / "effects.json"), "--frames", "0-2", "--batch", "2"]
    main(["simulate", "train/intensity", *given, "--previews", "1"])


def export(folder: Path) -> None:
    main(["export", "--data.kind", "synthetic", "--frames", "0-3", "--validation", "2-3", *at(folder)])


def prepare(folder: Path) -> None:
    size = ["--prepare.columns", "64", "--prepare.network-size", "64", "128"]
    main(["prepare", "synthetic", "--train", "0-3", "--eval", "4-5", "--workers", "1", *size, *at(folder)])


def detect(folder: Path) -> None:
    needs("train/detector", "export")
    tree = Path("export/out/training")
    given = ["--clouds", str(tree / "velodyne"), "--calib", str(tree / "calib"), "--pictures", "1"]
    main(["detect", "train/detector", *given, *at(folder)])


def at(folder: Path) -> list[str]:
    return ["--out", str(folder / "out")]


def needs(*names: str) -> None:
    for name in names:
        if not any(Path(name).iterdir() if Path(name).is_dir() else ()):
            sys.exit(f"same: {name} is not there; make it first (--only {name})")


def told(folder: Path) -> Iterator[tuple[str, Any]]:
    """Name and value of everything that lies in a folder."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".lock")):
        name = path.as_posix()
        if "checkpoints" in path.parts:
            # Orbax's files hold times; its item `sha256` holds those of our arrays.
            if path.parent.name == "sha256" and path.name == "metadata":
                yield from leaves(json.loads(path.read_text()), f"{name}:")
        elif path.suffix == ".json":
            yield from leaves(json.loads(path.read_text()), f"{name}:")
        elif path.suffix == ".jsonl":
            for k, line in enumerate(path.read_text().splitlines()):
                yield from leaves(json.loads(line), f"{name}:{k}.")
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                for key in arrays.files:
                    array = arrays[key]
                    head = f"{array.dtype.str} {array.shape} ".encode()
                    yield f"{name}:{key}", hashlib.sha256(head + array.tobytes()).hexdigest()
        elif path.suffix not in PAGES:
            yield name, hashlib.sha256(path.read_bytes()).hexdigest()


def leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Dotted names and values of a tree of plain values."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key not in FRESH:
                yield from leaves(one, f"{name}{key}.")
    elif isinstance(value, list):
        for k, one in enumerate(value):
            yield from leaves(one, f"{name}{k}.")
    else:
        # Where OUT lies says nothing of what is in it.
        yield name.removesuffix("."), value.replace(str(Path.cwd()), "") if isinstance(value, str) else value


def compare(before: Path, after: Path) -> int:
    """Prints what differs between two records; 1 where anything does."""
    old = json.loads((before / "record.json").read_text())
    new = json.loads((after / "record.json").read_text())
    differing = [name for name in sorted({*old, *new}) if old.get(name) != new.get(name)]
    for name in differing:
        print(f"{name}: {old.get(name)} -> {new.get(name)}")
    print(f"{len(differing)} of {len({*old, *new})} values differ")
    return int(bool(differing))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="+", metavar="OUT")
    parser.add_argument("--compare", action="store_true", help="compare the records of two folders")
    parser.add_argument("--only", nargs="+", default=[], metavar="JOB", help="make these alone: discover/pair ...")
    given = parser.parse_args()
    if given.compare:
        sys.exit(compare(*given.out))
    run(given.out[0], given.only)
