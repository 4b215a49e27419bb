"""From CARLA's buffers to CARLA's attributes and back: how near they come, and whether the gap closes.

    python -m benchmarks.blind.carla_round_trip OUT [--seeds 5] [--first 0] [--scenes 16] [--channels 32]
        [--columns 256] [--fresh 8] [--table]

Each seed draws a street a scene and hides attributes of `sensor.lidar.ray_cast` (benchmarks/blind/carla/law.py). Its
buffers are the measured side, those of `ray_cast_semantic` in the same streets the simulated one. Then as a user does:
`jaxsim frames` on both, `jaxsim discover`, `jaxsim engines answer/sensor.json --for carla`. The law is cast again with
the attributes that were written, in fresh streets, and held against the hidden ones there: mean absolute difference of
the intensity (and of its rays' ranges the scatter), and of the share of rays that return a range of 5 m, the mean
absolute difference; beside them the same between two draws of the hidden law, which no answer can beat.

Folders of answers stay in OUT; a killed run goes on, and --table runs no answer. OUT/cases.jsonl has a row a seed,
OUT/summary.md the table.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.blind.carla import buffers, law, street
from benchmarks.blind.rows import append_row, code_version, read_rows
from jaxsim.cli import main as jaxsim
from jaxsim.report.results import markdown_table

Row = dict[str, Any]
SIDES = {"simulated": "ray_cast_semantic", "measured": "ray_cast"}
STRETCH_M = 5.0
"""Of range, over which the share of rays that return is taken."""


def write_recordings(folder: Path, seed: int, hidden: Mapping[str, float], *, scenes: int, ray: np.ndarray) -> None:
    """Both sides' buffers, a folder a street."""
    for side, kind in SIDES.items():
        for k in range(scenes):
            place = folder / f"{side}_raw" / f"street{k:02d}"
            buffers.write_attributes(place, kind, channels=ray.shape[0], columns=ray.shape[1])
            seen = street.look(ray, np.random.default_rng([seed, 2, k]))
            if side == "simulated":
                buffers.write_semantic(place / "000000.raw", ray, seen)
            else:
                cast = law.ray_cast(seen.distance_m, np.random.default_rng([seed, 3, k]), **hidden)
                buffers.write_plain(place / "000000.raw", ray, *cast)


def answer(folder: Path) -> None:
    """What a user runs, from buffers to CARLA's attributes."""
    for side in SIDES:
        jaxsim(["frames", str(folder / f"{side}_raw"), "--out", str(folder / side)])
    sides = ["--measured", str(folder / "measured"), "--simulated", str(folder / "simulated")]
    jaxsim(["discover", *sides, "--out", str(folder / "answer")])


def written(folder: Path) -> dict[str, float]:
    """The attributes that `jaxsim engines` writes of an answer."""
    out = folder / "carla.json"
    jaxsim(["engines", str(folder / "answer/sensor.json"), "--for", "carla", "--out", str(out)])
    return {name: float(value) for name, value in json.loads(out.read_text())["attributes"].items()}


def distances(
    first: Mapping[str, float], second: Mapping[str, float], *, seed: int, fresh: int, ray: np.ndarray
) -> dict[str, float]:
    """Of two laws in streets that nothing was fitted to: intensity, returns, scatter of the range (m)."""
    sides: list[list[np.ndarray]] = [[], []]
    truth = []
    for k in range(fresh):
        distance_m = street.look(ray, np.random.default_rng([seed, 4, k])).distance_m
        truth.append(distance_m)
        for side, attributes in enumerate((first, second)):
            sides[side].append(
                np.stack(law.ray_cast(distance_m, np.random.default_rng([seed, 5 + side, k]), **attributes))
            )
    range_a, light_a = np.stack(sides[0], axis=1)
    range_b, light_b = np.stack(sides[1], axis=1)
    distance_m = np.stack(truth)
    both = (range_a > 0) & (range_b > 0)
    bins = np.arange(0, 120, STRETCH_M)
    counts = np.histogram(distance_m[distance_m > 0], bins)[0]
    shares = [np.histogram(distance_m[r > 0], bins)[0] / np.maximum(counts, 1) for r in (range_a, range_b)]
    scatter = [np.std((r - distance_m)[r > 0]) for r in (range_a, range_b)]
    return {
        "intensity": float(np.abs(light_a - light_b)[both].mean()),
        "returns": float(np.abs(shares[0] - shares[1]) @ counts / counts.sum()),
        "range_m": float(abs(scatter[0] - scatter[1])),
    }


def run(seed: int, out: Path, *, scenes: int, fresh: int, ray: np.ndarray, answers: bool = True) -> Row | None:
    """A row of a seed; None where its answer is not there and none is to be made."""
    hidden = law.hidden_attributes(seed)
    folder = out / f"seed{seed}"
    if not (folder / "answer/verdict.json").is_file():
        if not answers:
            return None
        shutil.rmtree(folder, ignore_errors=True)
        write_recordings(folder, seed, hidden, scenes=scenes, ray=ray)
        answer(folder)
    found = written(folder)
    verdict = json.loads((folder / "answer/verdict.json").read_text())
    now = {**law.DEFAULTS, **found}
    asked = {"seed": seed, "fresh": fresh, "ray": ray}
    return {
        "key": f"{seed}",
        "seed": seed,
        "code": code_version(),
        "hidden": dict(hidden),
        "written": found,
        "named": [one["name"] for one in verdict["effects"]],
        "cannot": _cannot(folder / "carla.md"),
        "before": distances(law.DEFAULTS, hidden, **asked),
        "after": distances(now, hidden, **asked),
        "again": distances(hidden, hidden, **asked),
        "seconds": verdict["seconds"],
    }


def _cannot(page: Path) -> list[str]:
    """What `jaxsim engines` says that CARLA cannot express."""
    return [line.split("`")[1] for line in page.read_text().splitlines() if line.startswith("- `")]


def summary(rows: Sequence[Row]) -> str:
    """A line a seed."""
    lines = []
    for row in rows:
        names = sorted({*row["hidden"], *row["written"]})
        told = [f"{name} {_short(row['hidden'], name)} -> {_short(row['written'], name)}" for name in names]
        gaps = [
            f"{row['before'][name]:.3g} -> {row['after'][name]:.3g} ({row['again'][name]:.3g})"
            for name in ("intensity", "returns", "range_m")
        ]
        lines.append([str(row["seed"]), "<br>".join(told), ", ".join(row["cannot"]) or "-", *gaps])
    heads = ["seed", "hidden -> written", "not CARLA's", "intensity", "share that returns", "scatter of range, m"]
    return markdown_table(heads, lines)


def _short(values: Mapping[str, float], name: str) -> str:
    return f"{values[name]:.3g}" if name in values else "default"


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    for name, value in (("seeds", 5), ("first", 0), ("scenes", 16), ("fresh", 8), ("channels", 32), ("columns", 256)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--table", action="store_true", help="make no answer; write the table of those that are there")
    given = parser.parse_args(argv)
    given.out.mkdir(parents=True, exist_ok=True)
    ray = buffers.rays(given.channels, given.columns)
    path = given.out / "cases.jsonl"
    for seed in tqdm(range(given.first, given.first + given.seeds), unit="seed"):
        row = run(seed, given.out, scenes=given.scenes, fresh=given.fresh, ray=ray, answers=not given.table)
        if row is not None:
            append_row(path, row)
    text = summary(read_rows(path))
    (given.out / "summary.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
