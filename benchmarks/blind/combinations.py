"""What an oracle that knows the other effects would reach on pairs and triples that were answered:

    python -m benchmarks.blind.combinations benchmarks/blind/measured/hidden_{sealed,additions}/cases.jsonl

makes their cases again (a case follows from its row) and asks of each hidden effect, with the others in place and all
fitted beside one another from their true parameters, what discover asks: does it pass the bar, do scenes agree?
(*detects*); and does no other effect of its channels gain more in its place? (*tells apart*). So the oracle is spared
what discover has to find out, which effects there are, and has the same likelihood, nuisances and frames.

A line a case is printed and kept in OUT (--out), from which the same command goes on; then how often discover's answer
was exact, and the oracle could have been. 10 to 40 processor seconds a case.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.case import made_again
from benchmarks.blind.rows import append_row, read_rows
from benchmarks.blind.tables import of_kind, rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.model.fit import in_place
from jaxsim.discover.model.null_model import refit, refitted
from jaxsim.discover.model.parameters import to_z
from jaxsim.discover.name.candidates import rank_effects
from jaxsim.effects import EFFECTS, get_effect

Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    answered = {(str(path), row["key"]): row for path in args.rows for row in of_kind(read_rows(path), "combination")}
    known = {row["key"]: row for row in read_rows(args.out)}
    enable_compilation_cache()
    told: list[Row] = []
    for (path, key), row in tqdm(answered.items(), unit="case"):
        name = f"{Path(path).parent.name} {key}"
        if name not in known:
            known[name] = {"key": name, "exact": row["exact"], "answer": row["answer"], "effects": ask(row)}
            append_row(args.out, known[name])
        told.append(known[name])
        print(line(told[-1]), flush=True)
    print(summary(told))


def ask(row: Row) -> list[Row]:
    """Of each effect that a row's case hides: what it gains beside the others, nats a find scene, whether naming would
    accept it, and the effect of the same channels that gains most there."""
    with tempfile.TemporaryDirectory() as folder:
        comparison, true = made_again(row, Path(folder) / "case")
        null = NullModel.of(Division.of(comparison)).problem
    effects = [get_effect(name) for name in true]
    rows = null.ev.rays.row.shape[-1]
    together = refit(null, effects, [to_z(effect, true[effect.name], rows) for effect in effects])
    told: list[Row] = []
    for effect in effects:
        others = [(one.effect, one.fit.z) for one in together if one.effect is not effect]
        beside = refitted(in_place(null, others))
        alike = [one for one in EFFECTS.values() if one.channels == effect.channels and one.name not in true]
        ranking = rank_effects(beside, [effect, *alike])
        [itself] = [one for one in ranking if one.effect is effect]
        told.append(
            {
                "name": effect.name,
                "gain": itself.total / len(itself.gain),
                "accepted": itself.accepted(),
                "first": ranking[0].effect.name,
            }
        )
    return told


def detects(told: Row) -> bool:
    """Whether every effect of a case passes beside the others."""
    return all(one["accepted"] for one in told["effects"])


def tells_apart(told: Row) -> bool:
    """Whether, besides, none is explained better by another."""
    return detects(told) and all(one["first"] == one["name"] for one in told["effects"])


def line(told: Row) -> str:
    """A case as a line of a Markdown table."""
    words = []
    for one in told["effects"]:
        rival = "" if one["first"] == one["name"] else f", less than {one['first']}"
        words.append(f"{one['name']} {one['gain']:.1f}{'' if one['accepted'] else ' (not accepted)'}{rival}")
    return f"| {'; '.join(words)} | {', '.join(told['answer'])} | {'yes' if told['exact'] else 'no'} |"


def summary(told: Sequence[Row]) -> str:
    """Discover beside the oracle, on the same cases."""
    cells = [
        rate(one["exact"] for one in told),
        rate(detects(one) for one in told),
        rate(tells_apart(one) for one in told),
        rate(one["exact"] for one in told if tells_apart(one)),
    ]
    head = (
        "discover: exact",
        "oracle detects all",
        "oracle tells all apart",
        "exact, of those that the oracle tells apart",
    )
    return "\n".join(["", f"| {' | '.join(head)} |", "|---" * len(head) + "|", f"| {' | '.join(cells)} |"])


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="+", help="cases.jsonl of benchmarks.blind.effects")
    parser.add_argument("--out", type=Path, required=True, help="a file of rows, which a further call goes on with")
    args = parser.parse_args(argv)
    for path in args.rows:
        if not path.is_file():
            parser.error(f"{path} is not there; give files of rows, cases.jsonl")
    return args


if __name__ == "__main__":
    main()
