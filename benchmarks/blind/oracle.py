"""What an oracle that knows the form would reach on cases that were answered:

    python -m benchmarks.blind.oracle benchmarks/blind/measured/worlds_*/cases.jsonl

It knows which effect may be hidden, and asks one question: is it there? Its evidence is what discover's own likelihood
gains with that effect on scenes that the fit has not seen (`ranking` of a row), so that it has the same nuisances and
the same frames. It *detects* where that is more than the same effect gains on 19 of 20 nulls of the same kind of case,
and *tells apart* where, besides, no other effect of the catalogue gains more. A bar for one question is lower than
discover's, which asks forty; so what the oracle does not detect, these frames hardly show to this likelihood.

A row keeps the five effects that gain most. On a null, another gains at most what the fifth does and is taken to gain
just that, which raises the bar; a hidden effect that is not among the five is not detected.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.plan import Settings
from benchmarks.blind.rows import read_rows
from benchmarks.blind.tables import of_kind, rate

Row = dict[str, Any]
FALSE = 0.05
"""Share of nulls on which an oracle's test detects."""
FEWEST = 20
"""Nulls that a bar needs: one in twenty is what the test allows."""


def condition(row: Row) -> str:
    """Cases of one condition share their bars."""
    return Settings(**row["settings"]).cell


def judged(rows: Sequence[Row]) -> list[tuple[Row, bool, bool]]:
    """Every single effect whose condition has nulls enough, whether the oracle detects it, and tells it apart."""
    some = [row for row in rows if row.get("ranking")]
    nulls: dict[str, list[dict[str, float]]] = {}
    for row in of_kind(some, "none"):
        nulls.setdefault(condition(row), []).append(dict(row["ranking"]))
    found = []
    for row in of_kind(some, "single"):
        seen = nulls.get(condition(row), [])
        if len(seen) >= FEWEST:
            [name], gains = row["truth"], dict(row["ranking"])
            detects = gains.get(name, -np.inf) > bar(name, seen)
            found.append((row, bool(detects), bool(detects and max(gains, key=gains.__getitem__) == name)))
    return found


def bar(name: str, nulls: Sequence[dict[str, float]]) -> float:
    """Nats a scene that the effect gains on one null in twenty, or a bound of it where it is not among the five."""
    gains = [gains.get(name, min(gains.values())) for gains in nulls]
    return float(np.quantile(gains, 1 - FALSE, method="inverted_cdf"))


def table(rows: Sequence[Row]) -> str:
    """A line a condition: discover beside the oracle on the same cases, and which cases the oracle does not detect.
    Empty where no condition has effects and nulls enough."""
    groups: dict[str, list[tuple[Row, bool, bool]]] = {}
    for one in judged(rows):
        groups.setdefault(condition(one[0]), []).append(one)
    if not groups:
        return ""
    head = ("condition", "right first", "in the set", "oracle detects", "oracle tells apart", "right first of detected",
            "not detected")  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, some in sorted(groups.items()):
        cells = [
            rate(row["first_right"] for row, _, _ in some),
            rate(row["in_set"] for row, _, _ in some),
            rate(detects for _, detects, _ in some),
            rate(apart for _, _, apart in some),
            rate(row["first_right"] for row, detects, _ in some if detects),
            ", ".join(row["truth"][0] for row, detects, _ in some if not detects) or "-",
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="+", help="cases.jsonl of benchmarks.blind.worlds or .effects")
    parser.add_argument("--severity", type=float, help="of the effects that are asked; by default all")
    args = parser.parse_args(argv)
    found: dict[tuple[str, bool], Row] = {}
    for path in args.rows:
        if not path.is_file():
            parser.error(f"{path} is not there; give files of rows, cases.jsonl")
        # Nulls were asked again by later runs: the last row of a case counts.
        found |= {(row["key"], row["settings"]["sealed"]): row for row in read_rows(path)}
    rows = list(found.values())
    if args.severity is not None:
        rows = [row for row in rows if row["kind"] == "none" or row["severity"] == args.severity]
    print(table(rows) or f"no oracle: its bars need {FEWEST} nulls of a condition, and an effect")


if __name__ == "__main__":
    main()
