"""How often a gate turns red: on nulls, where it should not, and on hidden effects, where it should.

    python -m benchmarks.blind.gates OUT [--nulls 60] [--first 50000] [--severity 4] [--effects beam_gain ...]
        [--scenes 12] [--rows 24] [--columns 192]
    python -m benchmarks.blind.gates --answered benchmarks/blind/measured/hidden_sealed/cases.jsonl ...

The first asks what `discover --gate --fast` asks, of sensors and simulators of the hidden world, without and with noise
of the simulator's own. Thresholds come from half of a sensor's streets (`RULES`), the gate is asked of the other half,
where nothing has changed (a null), or where the sensor has a hidden effect since. The second looks at answers that
were given before: a gate without --fast that allows nothing is red where something was found for certain
(`Rules.gate_effect_nats`), and unsure where what was found gained less. Rows of before laws were learned know of no
gain of what has no name.

A killed run goes on. OUT/cases.jsonl has a row a case, with the distances of each street, OUT/summary.md the table.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.blind import hidden
from benchmarks.blind.tables import rate
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.discover.distances import distances_of, frame_distances
from jaxsim.discover.gate import (
    NOT_NAMED,
    Gate,
    check_distances,
    colour_of,
    thresholds_of,
)
from jaxsim.discover.rules import RULES as DISCOVER_RULES
from jaxsim.discover.verdict import Interval
from jaxsim.report.results import markdown_table

SIMULATORS = ("ideal", "noisy")
FIRST = 50_000
"""Seed of the first sensor."""
RULES: dict[str, Callable[[Interval], float]] = {
    "the mean before": lambda before: before.value,
    "the upper end of its interval": lambda before: before.high,
    "--write-gate, a tenth above that": lambda before: thresholds_of({"": before})[""],
}
"""Where a threshold is set, by what the streets before show."""
EFFECTS = (
    *("beam_gain", "range_scale", "random_dropout", "atmospheric_extinction", "incidence_cosine", "range_noise"),
    *("beam_range_bias", "snr_dropout"),
)
Row = dict[str, Any]


def jobs(nulls: int, effects: Sequence[str], severity: float, first: int = FIRST) -> list[Row]:
    """What is asked: each sensor once as it is, the first of them once more with an effect each."""
    sensors = [
        {"seed": first + k, "simulator": simulator, "nuisance": ("exact", "misspecified")[k % 2]}
        for k in range(nulls)
        for simulator in SIMULATORS
    ]
    planned = [sensor | {"effect": "none", "severity": 1.0} for sensor in sensors]
    for sensor, name in zip(sensors, np.repeat(effects, len(SIMULATORS)), strict=False):
        planned.append(sensor | {"effect": str(name), "severity": severity})
    return planned


def answer(job: Row, *, scenes: int, rows: int, columns: int) -> Row:
    """The distances of each street of a case."""
    with tempfile.TemporaryDirectory() as folder:
        hidden.make_case(Path(folder) / "case", **job, scenes=scenes, rows=rows, columns=columns)
        ours = open_polar_frames(Path(folder) / "case/simulated")
        theirs = open_polar_frames(Path(folder) / "case/measured")
        table = [frame_distances(ours.read(name)[0], theirs.read(name)[0]) for name in ours.names]
    return job | {"streets": [[float(f"{value:.6g}") for value in row] for row in table]}


def halves(row: Row) -> list[dict[str, Interval]]:
    """Distances of the streets before, and of those that are judged."""
    table = np.array(row["streets"])
    cut = len(table) // 2
    return [distances_of(part) for part in (table[:cut], table[cut:])]


def colours(rows: Sequence[Row], simulator: str, rule: Callable[[Interval], float]) -> list[tuple[str, str]]:
    """Effect and the gate's colour of each case of a simulator."""
    own = [row for row in rows if row["simulator"] == simulator]
    before = {row["seed"]: halves(row)[0] for row in own if row["effect"] == "none"}
    told = []
    for row in own:
        thresholds = {name: rule(one) for name, one in before[row["seed"]].items()}
        gate = Gate({name: most for name, most in thresholds.items() if most > 0}, frozenset(), {})
        told.append((row["effect"], colour_of(check_distances(gate, halves(row)[1]))))
    return told


def summary(rows: Sequence[Row]) -> str:
    """Markdown: how many nulls turn red or cannot be judged, and which effects are seen."""
    lines = []
    for simulator in SIMULATORS:
        for words, rule in RULES.items():
            told = colours(rows, simulator, rule)
            nulls = [colour for effect, colour in told if effect == "none"]
            planted = {effect: colour for effect, colour in told if effect != "none"}
            seen = [name for name, colour in planted.items() if colour == "gap"]
            unseen = ", ".join(name for name in planted if name not in seen)
            lines.append(
                [
                    simulator,
                    words,
                    rate(colour == "gap" for colour in nulls),
                    rate(colour == "unsure" for colour in nulls),
                    f"{len(seen)} of {len(planted)}" + (f", not {unseen}" if unseen else ""),
                ]
            )
    return markdown_table(["simulator", "thresholds", "nulls red", "nulls that cannot be judged", "effects red"], lines)


def colour_of_answer(row: Row) -> str:
    """Of a gate without --fast that allows nothing."""
    if row["verdict"] == "none":
        return "pass"
    if row["verdict"] == NOT_NAMED:
        gains = {NOT_NAMED: sum(answer for answer, *_ in row["gained"].values())}
    else:
        # Rows of before 25 November know the gain of what was found first alone, which is the most that any gained.
        gains = row.get("gains") or {name: gain for name, gain in row["ranking"] if name in row["answer"]}
    return "gap" if any(gain >= DISCOVER_RULES.gate_effect_nats for gain in gains.values()) else "unsure"


def of_answers(rows: Iterable[Row]) -> str:
    """How many of whole answers turn red, or cannot be judged, of rows that other benchmarks wrote."""
    rows = list(rows)
    nulls = [colour_of_answer(row) for row in rows if row["kind"] == "none"]
    planted = [colour_of_answer(row) for row in rows if row["kind"] == "single" and row["severity"] >= 2]
    told = []
    for words, colours in (("nulls", nulls), ("single effects of severity 2 or more", planted)):
        told += [f"{words} {colour}: {rate(one == colour for one in colours)}" for colour in ("gap", "unsure")]
    return "; ".join(told)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--nulls", type=int, default=60)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first sensor")
    parser.add_argument("--severity", type=float, default=4.0)
    parser.add_argument("--effects", nargs="*", default=list(EFFECTS))
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--rows", type=int, default=24)
    parser.add_argument("--columns", type=int, default=192)
    parser.add_argument("--answered", type=Path, nargs="*", default=[])
    given = parser.parse_args()
    for path in given.answered:
        print(f"{path}: {of_answers(map(json.loads, path.read_text().splitlines()))}")
    if given.out is None:
        return
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "cases.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
    keys = ("effect", "seed", "simulator", "severity")
    done = {tuple(row[key] for key in keys) for row in rows}
    planned = jobs(given.nulls, given.effects, given.severity, given.first)
    missing = [job for job in planned if tuple(job[key] for key in keys) not in done]
    with path.open("a") as file:
        for job in tqdm(missing, unit="case"):
            rows.append(answer(job, scenes=given.scenes, rows=given.rows, columns=given.columns))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    text = summary(rows)
    (given.out / "summary.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
