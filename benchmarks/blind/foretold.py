"""Whether what frames could show is what they show: expected gains beside those that naming reached.

    python -m benchmarks.blind.foretold benchmarks/blind/measured/hidden_sealed/cases.jsonl --severity 1 2

takes rows of `benchmarks.blind.effects` or `.worlds` that hide one effect, makes their cases again (a case follows from
its row), fits the null alone, and puts the true effect on its rays (`jaxsim.discover.sensitivity`). A line a row: the
gain that naming reached, if the row lists it, the expected one, whether these frames could show the effect, and whether
it was in the set; then how often the two agree. About 6 processor seconds a row.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.blind.case import made_again
from benchmarks.blind.rows import read_rows
from benchmarks.blind.tables import of_kind, rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped
from jaxsim.discover.show.sensitivity import could_pass, expected_gains
from jaxsim.effects import EFFECTS, get_effect

Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    rows = [row for row in of_kind(read_rows(args.rows), "single") if row["severity"] in args.severity]
    rows = [row for row in rows if not get_effect(row["truth"][0]).of_recording]
    rows = [row for row in rows if not args.only or row["truth"][0] in args.only]
    enable_compilation_cache()
    told = []
    for row in tqdm(rows, unit="case"):
        with tempfile.TemporaryDirectory() as folder:
            told.append(foretold(row, Path(folder) / "case"))
        print(_line(told[-1]), flush=True)
    print(summary(told))


def foretold(row: Row, case: Path) -> Row:
    """A row's case made again, and what its frames could show of the hidden effect."""
    comparison, true = made_again(row, case)
    [name] = row["truth"]
    null = NullModel.of(Division.of(comparison)).problem
    _, expected = expected_gains(null, EFFECTS[name], true[name])
    shutil.rmtree(case)
    reached = dict(row["ranking"]).get(name)
    return {
        "name": name,
        "severity": row["severity"],
        "reached": None if reached is None else reached * len(expected),
        "expected": float(clipped(expected).sum()),
        "could": could_pass(EFFECTS[name], expected, rows=null.ev.rays.row.shape[-1]),
        "in_set": row["in_set"],
    }


def _line(told: Row) -> str:
    reached = "-" if told["reached"] is None else f"{told['reached']:.0f}"
    words = [told["name"], f"{told['severity']:g}", reached, f"{told['expected']:.0f}"]
    return f"| {' | '.join([*words, 'yes' if told['could'] else 'no', 'yes' if told['in_set'] else 'no'])} |"


def summary(told: Sequence[Row]) -> str:
    """How often what could be shown was."""
    could = [one for one in told if one["could"]]
    not_ = [one for one in told if not one["could"]]
    both = [(one["expected"], one["reached"]) for one in told if one["reached"] and one["reached"] > RULES.bar_nats]
    ratio = np.exp(np.abs(np.log([max(a, 0.1) / b for a, b in both]))) if both else np.array([np.nan])
    return "\n".join(
        [
            "",
            f"could be shown: in the set {rate(one['in_set'] for one in could)}",
            f"could not: in the set {rate(one['in_set'] for one in not_)}",
            f"expected over reached, of {len(both)} above the bar: off by a factor of {np.median(ratio):.1f} (median)",
        ]
    )


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, help="a cases.jsonl")
    parser.add_argument("--severity", type=float, nargs="+", default=[1.0, 2.0])
    parser.add_argument("--only", nargs="+", choices=tuple(EFFECTS), metavar="EFFECT", help="rows that hide these")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
