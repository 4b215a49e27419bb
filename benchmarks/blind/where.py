"""Where simulation and measurement disagree, blindly: `python -m benchmarks.blind.where OUT [--sealed] [--help]`.

The cases of `benchmarks.blind.effects`, of which only the first step of `discover` is asked: on which covariate of
which channel the residuals depend. One JSON line a case goes to OUT/cases.jsonl; the same command again goes on.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.blind.hidden import key_path, make_case, score
from benchmarks.blind.plan import Counts, Job, Settings, plan
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import of_kind, rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover import disagreements, read_comparison

Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    counts = Counts(nulls=args.nulls, outside=args.outside, pairs=args.pairs)
    settings = Settings(args.sealed)
    enable_compilation_cache()
    cases = {job.key: partial(_answer, job, settings, args.out / "case") for job in plan(counts, sealed=args.sealed)}
    run_cases(args.out, cases, summary=summary, settings=settings.__dict__, most=args.most)


def _answer(job: Job, settings: Settings, case: Path) -> Row:
    """Makes a case, asks where it disagrees, and only then opens the key."""
    _remove(case)
    seed, shape = job.seed(sealed=settings.sealed), (settings.scenes, settings.rows, settings.columns)
    about = {"effect": job.effect, "severity": job.severity, "seed": seed, "nuisance": job.nuisance}
    make_case(case, **about, **dict(zip(("scenes", "rows", "columns"), shape, strict=True)))
    where = [asdict(place) for place in disagreements(read_comparison(case / "simulated", case / "measured"))]
    scored = score(json.loads(key_path(case).read_text()), {"verdict": "none", "effects": [], "where": where})
    _remove(case)
    known = {name: scored[name] for name in ("kind", "truth", "severity", "level", "where_right")}
    return {
        "key": job.key,
        "settings": settings.__dict__,
        "seed": seed,
        "code": code_version(),
        **known,
        "where": where,
    }


def _remove(case: Path) -> None:
    shutil.rmtree(case, ignore_errors=True)
    key_path(case).unlink(missing_ok=True)


def summary(rows: Sequence[Row]) -> str:
    """Rates with 95 % intervals, and what was found of each case that hides something."""
    lines = ["| cases | a right place is listed | something is listed |", "|---|---|---|"]
    for severity in sorted({row["severity"] for row in of_kind(rows, "single")}):
        some = of_kind(rows, "single", lambda row, s=severity: row["severity"] == s and row["where_right"] is not None)
        right, listed = rate(row["where_right"] for row in some), rate(row["where"] for row in some)
        lines.append(f"| one effect, severity {severity:g} | {right} | {listed} |")
    for kind, words in (("combination", "pairs and triples"), ("outside", "outside the catalogue")):
        some = of_kind(rows, kind)
        right, listed = rate(row["where_right"] for row in some), rate(row["where"] for row in some)
        lines.append(f"| {words}, severity 4 | {right} | {listed} |")
    for level in ("exact", "misspecified"):
        none = of_kind(rows, "none", lambda row, level=level: row["level"] == level)
        lines.append(f"| nothing hidden, {level} nuisances | - | {rate(row['where'] for row in none)} |")
    lines += ["", "| hidden | severity | listed, strongest first |", "|---|---|---|"]
    lines += [
        f"| {', '.join(row['truth']) or row['level']} | {row['severity']:g} | {_words(row['where'])} |"
        for row in sorted(rows, key=lambda row: (row["truth"], row["severity"]))
        if row["truth"] or row["where"]
    ]
    return "\n".join(lines)


def _words(where: Sequence[Row]) -> str:
    return ", ".join(f"{place['channel']} on {place['covariate']}" for place in where[:5]) or "nothing"


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--nulls", type=int, default=50, help="of each level")
    parser.add_argument("--outside", type=int, default=1, help="cases of each kind outside the catalogue")
    parser.add_argument("--pairs", type=int, default=6, help="pairs, and as many triples")
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
