"""Blind naming in three worlds, for several sensors, simulators and given arrays:

    python -m benchmarks.blind.worlds OUT --world home raycast mitsuba --simulator ideal noisy --given all bare \\
        --sensor spin64 turn --cases 15 --nulls 10

Every combination (a cell) has the same plan: single effects, at severities in turn, and nulls, half of them with exact
and half with misspecified nuisances; the rendered world has streets of one kind for both, and skips what it cannot
hide. The first world has a sensor of its own, each other world those of --sensor that it knows. One JSON line a case
goes to OUT/cases.jsonl; the same command again goes on where it stopped, and larger counts or further cells add the
cases that are new. `--table` runs nothing. Writes OUT/summary.md, also printed.

Development cases have seeds below 10000; `--sealed` ones, on which nothing may be tuned, from 10000 on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.blind.effects import answers
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.oracle import table
from benchmarks.blind.plan import Job, Settings
from benchmarks.blind.rows import append_row, check_settings, read_rows
from benchmarks.blind.tables import answer_of, coverage, of_kind, rate

Row = dict[str, Any]
SENSORS = {
    "home": ("own",),
    "raycast": ("spin16", "spin64", "front128", "raster"),
    "mitsuba": ("turn", "front", "coarse"),
}
"""Of each world; the later worlds' libraries need not be installed for the first alone."""
NEEDS = {"raycast": "embreex", "mitsuba": "mitsuba"}
"""The library that a world is made with."""
HIDDEN = (
    "beam_gain", "range_falloff", "random_dropout", "gamma_response", "range_noise", "incidence_cosine",
    "beam_range_bias", "atmospheric_extinction", "material_dropout", "near_range_overlap", "range_scale",
    "window_contamination", "intensity_quantization", "oren_nayar", "range_quantization",
)  # fmt: skip
"""What the worlds can hide, channels in turn."""
CANNOT = {"mitsuba": ("range_quantization",)}
"""What a world cannot hide of these."""
NULLS = ("exact", "misspecified")
TOLD = ("world", "sensor", "simulator", "given")
"""Settings that tell one cell from another."""
HEAD = (
    *TOLD, "nulls: an effect named", "right first", "in the set",
    "a name that is not hidden", "90 % intervals that cover", "cpu s",
)  # fmt: skip


def main(argv: list[str] | None = None) -> None:
    args = arguments(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = {row["key"]: row for row in read_rows(kept)}
    nulls = range(args.first_null, args.first_null + args.nulls)
    numbers = range(args.first_case, args.first_case + args.cases)
    tasks = plan_cells(cells(args), args.severity, cases=numbers, nulls=nulls, effects=args.only or HIDDEN)
    for settings in {settings.cell: settings for _, settings in tasks}.values():
        check_settings([r for r in rows.values() if cell_of(r) == settings.cell], asdict(settings))
    done = {key for key, row in rows.items() if row["verdict"] != "error"}
    tasks = [] if args.table else [task for task in tasks if key_of(*task) not in done][: args.most]
    for world in sorted({settings.world for _, settings in tasks} & {*NEEDS}):
        if not find_spec(NEEDS[world]):
            raise ValueError(
                f"worlds: {world} needs {NEEDS[world]}, which is not installed; pip install -e '.[worlds]'"
            )
    for row in tqdm(answers(tasks, args.out, workers=args.workers), total=len(tasks), unit="case"):
        row |= {"key": f"{cell_of(row)} {row['key']}"}
        append_row(kept, row)
        rows[row["key"]] = row
    text = summary(list(rows.values()))
    (args.out / "summary.md").write_text(text + "\n")
    print(text)


def cells(args: argparse.Namespace) -> list[Settings]:
    """Settings of every combination asked for; rasters are the sensors' own unless the arguments say otherwise.

    Raises ValueError for a world that knows none of the sensors.
    """
    found = []
    for world in args.world:
        own = Settings() if world != "raycast" else Settings(rows=0, columns=0)
        rows, columns = args.rows or own.rows, args.columns or own.columns
        sensors = [name for name in SENSORS[world] if world == "home" or name in args.sensor]
        if not sensors:
            raise ValueError(f"worlds: {world} has none of these sensors; --sensor {' or '.join(SENSORS[world])}")
        for sensor in sensors:
            for simulator in args.simulator:
                for given in args.given:
                    shared = {"simulator": simulator, "world": world, "sensor": sensor, "given": given}
                    found.append(Settings(args.sealed, args.scenes, rows, columns, **shared))
    return found


def plan_cells(
    groups: Sequence[Settings],
    severities: Sequence[float],
    *,
    cases: Iterable[int],
    nulls: Iterable[int],
    effects: Sequence[str] = HIDDEN,
) -> list[tuple[Job, Settings]]:
    """The same jobs for every cell, the cells in turn, so that a run that is stopped has seen of each.

    The n-th case hides the n-th effect; severities change from case to case and from round to round, so that after as
    many rounds as there are severities every effect has had each. More cases keep those that fewer had.
    """
    planted = []
    for n in cases:
        turn, place = divmod(n, len(effects))
        severity = float(severities[(place + turn) % len(severities)])
        planted.append(Job(effects[place], severity, "default", turn // len(severities)))
    none = [Job("none", 1.0, NULLS[k % 2], k // 2) for k in nulls]
    jobs = [job for pair in zip_longest(none, planted) for job in pair if job]
    return [(job, settings) for job in jobs for settings in groups if job.effect not in CANNOT.get(settings.world, ())]


def key_of(job: Job, settings: Settings) -> str:
    return f"{settings.cell} {job.key}"


def cell_of(row: Row) -> str:
    return Settings(**row["settings"]).cell


def summary(rows: Sequence[Row]) -> str:
    """A line a cell and a line for cells together; what an oracle reaches, where nulls enough were asked; then what was
    answered to each case that was not answered rightly."""
    if not rows:
        return "no case yet"
    codes, failed = sorted({row["code"] for row in rows}), [row["key"] for row in rows if row["verdict"] == "error"]
    text = [f"{len(rows)} cases; code {', '.join(codes)}."]
    if len(codes) > 1:
        text[0] += f" These rows were answered by {len(codes)} versions of the code: they are not one measurement."
    if failed:
        text[0] += f" Ended with an error, counted as wrong ({len(failed)}): {', '.join(failed)}."
    groups: dict[str, list[Row]] = {}
    for row in sorted(rows, key=cell_of):
        groups.setdefault(cell_of(row), []).append(row)
    text += ["", f"| {' | '.join(HEAD)} |", "|" + "---|" * len(HEAD)]
    text += [_line(some) for some in [*groups.values(), *_together(rows)]]
    if beside := table(rows):
        text += ["", "Beside an oracle that knows the form (benchmarks/blind/oracle.py):", "", beside]
    text += ["", "| cell | hidden | severity | place | answer |", "|---|---|---|---|---|"]
    text += [
        f"| {cell} | {', '.join(row['truth']) or 'nothing, ' + row['level']} | {row['severity']:g} | "
        f"{row.get('place') or '-'} | {answer_of(row)} |"
        for cell, some in groups.items()
        for row in sorted(some, key=lambda row: (row["truth"], row["severity"]))
        if not (row["right"] and row["exact"])
    ]
    return "\n".join(text)


def _together(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows of several cells: of each world, of each sensor, simulator and choice of arrays, and all."""
    found = [list(rows)]
    for name in reversed(TOLD):
        values = sorted({row["settings"][name] for row in rows})
        found = [[row for row in rows if row["settings"][name] == value] for value in values if len(values) > 1] + found
    return [some for some in found if len({cell_of(row) for row in some}) > 1]


def _line(rows: Sequence[Row]) -> str:
    """The rates of some rows; of several cells where they differ."""
    none, single = of_kind(rows, "none"), of_kind(rows, "single")
    words = []
    for name in TOLD:
        there = {row["settings"][name] for row in rows}
        words.append(there.pop() if len(there) == 1 else "every")
    cells = [
        rate(row["named"] for row in none),
        rate(row["first_right"] for row in single),
        rate(row["in_set"] for row in single),
        rate(row.get("false_names") for row in single),
        coverage(p for row in single for p in row["parameters"]) or "-",
        f"{np.median([row['cpu_seconds'] for row in rows]):.0f}",
    ]
    return f"| {' | '.join([*words, *cells])} |"


def arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--world", nargs="+", choices=tuple(SENSORS), default=["home", "raycast"])
    parser.add_argument("--simulator", nargs="+", choices=SIMULATORS, default=["ideal", "noisy"])
    known = [name for world in SENSORS if world != "home" for name in SENSORS[world]]
    parser.add_argument("--sensor", nargs="+", choices=known, default=["spin64", "turn"], help="of the later worlds")
    parser.add_argument("--given", nargs="+", choices=("all", "bare"), default=["all"])
    parser.add_argument("--cases", type=int, default=len(HIDDEN), help="single effects a cell")
    parser.add_argument("--first-case", type=int, default=0, help="single effects from this number of the plan on")
    parser.add_argument("--nulls", type=int, default=10, help="nulls a cell")
    parser.add_argument("--first-null", type=int, default=0, help="nulls from this on: fresh ones where some were seen")
    parser.add_argument("--severity", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    parser.add_argument("--only", nargs="+", choices=HIDDEN, metavar="EFFECT", help="hide these alone")
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--scenes", type=int, default=Settings().scenes)
    parser.add_argument("--rows", type=int, default=0, help="0: the sensor's")
    parser.add_argument("--columns", type=int, default=0, help="0: the sensor's")
    parser.add_argument("--workers", type=int, default=2, help="processes, one core each (default 2)")
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
