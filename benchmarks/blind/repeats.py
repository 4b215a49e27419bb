"""How often something repeats where nothing is hidden, and what is made of what does:

    python -m benchmarks.blind.repeats OUT --nulls 100 --simulator ideal noisy --planted 2

Nulls of the hidden world with exact and misspecified nuisances in turn, for every simulator; the null model is fitted
and its residuals examined (`jaxsim.discover.repeats`), without the rest of `discover`: seconds a case. Patterns
(PATTERNS) are multiplied onto the measured intensities of further nulls. One JSON line a case goes to
OUT/cases.jsonl; the same command again goes on where it stopped. `--table` runs nothing. Writes OUT/summary.md, also
printed. Development seeds alone: nothing here is sealed.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.blind.hidden import key_path, make_case
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.plan import DEVELOPMENT
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import rate
from jaxsim.devices import by_small_steps
from jaxsim.discover import Comparison, read_comparison
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.repeats.examine import Dense
from jaxsim.discover.repeats.find import LEAST_HEIGHT, ChannelScales, find_repeats
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import signs_of

Row = dict[str, Any]
Pattern = Float[np.ndarray, "r c"]
NUISANCES = ("exact", "misspecified")
NO_FLOOR = dict.fromkeys(LEAST_HEIGHT, 0.0)
LEVELS = (0.02, 0.1, 0.5)
"""Probabilities at which p-values of nulls are counted: as often as they say, if they are exact."""


def _dead(row: np.ndarray, column: np.ndarray) -> Pattern:
    share = np.ones(column.shape[1])
    for place, left in ((0.1, 0.6), (0.45, 0.5), (0.8, 0.7)):
        share[int(place * column.shape[1])] = left
    return np.log(share)[None] + 0.0 * row


def _fine(row: np.ndarray, column: np.ndarray) -> Pattern:
    return 0.08 * np.random.default_rng(3).normal(size=row.shape)


PATTERNS: dict[str, Callable[[np.ndarray, np.ndarray], Pattern]] = {
    "ripple": lambda row, column: np.log1p(0.2 * np.sin(2 * np.pi * 16 * column / column.shape[1] + 0.7)),
    "parity": lambda row, column: 0.1 * (row % 2 - 0.5),
    "columns": _dead,
    "aslant": lambda row, column: 0.1 * np.cos(2 * np.pi * (3 * row / len(row) + 5 * column / column.shape[1])),
    "cells": _fine,
}
"""Nats of ln I by row and column: +-20 % in 16 periods over the columns; 10 % between odd and even rows; three single
columns at 60, 50 and 70 %; a fine wave over rows and columns; another number in every cell, 8 %."""


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    jobs = [(simulator, "", k) for k in range(args.nulls) for simulator in args.simulator]
    # Planted ones have seeds of their own, far from the nulls'.
    jobs += [(simulator, name, k) for k in range(args.planted) for name in PATTERNS for simulator in args.simulator]
    cases = {_key(*job): partial(run, *job, folder=args.out / "case", first=args.first) for job in jobs}
    run_cases(args.out, {} if args.table else cases, summary=summary)


def _key(simulator: str, pattern: str, number: int) -> str:
    return f"{simulator} {pattern or 'null'} {number}"


@by_small_steps
def run(simulator: str, pattern: str, number: int, *, folder: Path, first: int) -> Row:
    """One case: made, the null fitted, what repeats found and, of planted ones, learned."""
    nuisance = NUISANCES[number % 2]
    seed = first + number + (500 if pattern else 0)
    if seed >= DEVELOPMENT:
        raise ValueError(f"repeats: seed {seed} is sealed; give --first below {DEVELOPMENT - 1000}")
    shutil.rmtree(folder, ignore_errors=True)
    key_path(folder).unlink(missing_ok=True)
    make_case(folder, effect="none", severity=1.0, seed=seed, nuisance=nuisance, simulator=simulator)
    comparison = read_comparison(folder / "simulated", folder / "measured")
    row, column = np.indices(np.shape(comparison.scan.range_m)[1:])
    truth = np.zeros(row.shape)
    if pattern:
        truth = PATTERNS[pattern](row, column)
        light = np.clip(np.asarray(comparison.measured.intensity) * np.exp(truth), 0, 1).astype(np.float32)
        comparison = replace(comparison, measured=replace(comparison.measured, intensity=light))
    began = time.process_time()
    result = {"key": _key(simulator, pattern, number), "simulator": simulator, "pattern": pattern, "seed": seed}
    result |= {"nuisance": nuisance, "code": code_version(), **examined(comparison, truth)}
    shutil.rmtree(folder)
    return result | {"cpu_seconds": round(time.process_time() - began, 1)}


def examined(comparison: Comparison, truth: Pattern) -> Row:
    """What repeats in a comparison; where a pattern is planted, what the laws explain of it."""
    null_model = NullModel.of(Division.of(comparison))
    dense = Dense.of(null_model)
    maps = dense.maps()
    signs = signs_of(int(dense.finding.sum()))
    centred = {channel: replace(one, total=one.centred(one.total)) for channel, one in maps.items()}
    looks = {c: ChannelScales.at(one, dense.finding, signs, bins=RULES.repeats_bins) for c, one in centred.items()}
    agreements = [one for look in looks.values() for one in look.agreement]
    by_chance = np.max([one.by_chance for one in agreements], axis=0)
    p = min(float(np.mean(by_chance >= one.strength.max() - 1e-9)) for one in agreements)
    every = find_repeats(maps, dense.finding, least=NO_FLOOR)
    told = find_repeats(maps, dense.finding) if every else ()
    row: Row = {"p": p, "repeats": [_plain(one.repeat) for one in every], "answered": bool(told)}
    if truth.any() and told:
        learned = dense.learn(told, [], null_model.problem.noise)
        height = np.sum([law_on_grid(one.learned, truth.shape) for one in learned], axis=0)
        off = (truth - truth.mean()) - (height - height.mean())
        row["learned"] = [_plain(one.repeat) | {"judged_nats": one.judged_nats} for one in learned]
        row["share"] = float(1 - (off**2).mean() / truth.var())
        row["slope"] = float(((truth - truth.mean()) * height).mean() / truth.var())
    return row


def _plain(repeat: Any) -> Row:
    size = repeat.size
    return {
        **{name: getattr(repeat, name) for name in ("channel", "scale", "along", "place", "p_value", "p_judge")},
        "size": [size.value, size.low, size.high],
    }


def law_on_grid(law: Any, shape: tuple[int, int]) -> Pattern:
    """A learned law's height in every cell."""
    row, column = np.mgrid[: shape[0], : shape[1]]
    of = {"row": row, "column": column, "even rows": row % 2, "even columns": column % 2}
    values = np.asarray(law.values)
    if law.kind == "wave":
        angle = 2 * np.pi * sum(of[name] * turns for name, [turns] in zip(law.covariates, law.knots, strict=True))
        return values[0] * np.cos(angle) + values[1] * np.sin(angle)
    places = [np.searchsorted(knots, of[name]) for name, knots in zip(law.covariates, law.knots, strict=True)]
    places = [np.minimum(at, len(knots) - 1) for at, knots in zip(places, law.knots, strict=True)]
    known = [
        np.asarray(knots)[at] == of[name] for name, at, knots in zip(law.covariates, places, law.knots, strict=True)
    ]
    table = values.reshape([len(knots) for knots in law.knots])
    return np.where(np.logical_and.reduce(known), table[tuple(places)], 0.0)


def summary(rows: Sequence[Row]) -> str:
    """A line a simulator and nuisance of nulls, then a line a planted pattern."""
    if not rows:
        return "no case yet"
    nulls = [row for row in rows if not row["pattern"]]
    planted = [row for row in rows if row["pattern"]]
    text = [f"{len(rows)} cases; code {', '.join(sorted({row['code'] for row in rows}))}."]
    heads = [f"p <= {level:g}" for level in LEVELS]
    text += ["", _line(["simulator", "nuisances", "nulls", "answered", *heads, "largest that held"]), "|---" * 8 + "|"]
    for simulator, nuisance in dict.fromkeys((row["simulator"], row["nuisance"]) for row in nulls):
        some = [row for row in nulls if (row["simulator"], row["nuisance"]) == (simulator, nuisance)]
        shares = [f"{np.mean([row['p'] <= level for row in some]):.2f}" for level in LEVELS]
        text.append(_line([simulator, nuisance, len(some), rate(r["answered"] for r in some), *shares, _largest(some)]))
    if nulls:
        text.append(_line(["every", "both", len(nulls), rate(r["answered"] for r in nulls), *[""] * 4]))
    text += [
        "",
        _line(["simulator", "pattern", "answered", "share of the pattern", "slope", "told as"]),
        "|---" * 6 + "|",
    ]
    for row in sorted(planted, key=lambda row: (row["simulator"], row["pattern"])):
        told = "; ".join(
            f"{one['scale']} {one['along']} {one['size'][0]:.3f} ({one['size'][1]:.3f} to {one['size'][2]:.3f})"
            for one in row.get("learned", [])[:3]
        )
        numbers = [f"{row[name]:.2f}" if name in row else "-" for name in ("share", "slope")]
        text.append(_line([row["simulator"], row["pattern"], "yes" if row["answered"] else "no", *numbers, told]))
    return "\n".join(text)


def _largest(rows: Sequence[Row]) -> str:
    """Of patterns that both find and judge scenes show on nulls, the largest of each channel."""
    sizes: dict[str, float] = {}
    for one in (one for row in rows for one in row["repeats"]):
        sizes[one["channel"]] = max(sizes.get(one["channel"], 0.0), abs(one["size"][0]))
    return ", ".join(f"{channel} {size:.4f}" for channel, size in sizes.items()) or "-"


def _line(cells: Iterable[Any]) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--nulls", type=int, default=100, help="a simulator")
    parser.add_argument("--planted", type=int, default=0, help="cases of each pattern and simulator")
    parser.add_argument("--simulator", nargs="+", choices=SIMULATORS, default=["ideal", "noisy"])
    parser.add_argument("--first", type=int, default=7000, help="seed of the first case")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
