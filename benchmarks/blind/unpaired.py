"""Blind naming where streets differ: `python -m benchmarks.blind.unpaired OUT [--sealed] [--severity 4 8] [--help]`.

As `benchmarks.blind.effects`, but the simulated folder shows other streets than the measured one, which knows no
classes, as real drives seldom do; `discover --unpaired` answers. Hides every effect that can be told so, those that
would need the classes, some of those that need the same streets, and nothing. One JSON line a case goes to
OUT/cases.jsonl; the same command again goes on.

Development cases have seeds below 10000; `--sealed` ones, on which nothing may be tuned, from 10000 on.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.blind.hidden import case_name, score_case
from benchmarks.blind.hidden.streets import make_unpaired
from benchmarks.blind.plan import Job
from benchmarks.blind.rows import code_version, run_cases
from benchmarks.blind.tables import coverage, rate
from jaxsim.compilation import enable_compilation_cache
from jaxsim.discover import discover_unpaired
from jaxsim.discover.unpaired.columns import untold
from jaxsim.effects import EFFECTS

CANNOT = ("beam_range_bias", "motion_distortion", "snr_dropout", "edge_dropout", "range_scale", "blooming")
"""Effects that need the same streets, of each channel."""
STRONG = 4.0
"""Severity of those."""
Row = dict[str, Any]


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    settings = {"sealed": args.sealed, "scenes": args.scenes, "unpaired": True}
    enable_compilation_cache()
    told = [name for name in EFFECTS if name not in untold(classes=True)]
    again = range(args.first, args.first + args.repeats)
    jobs = [Job(name, severity, "default", k) for k in again for severity in args.severity for name in told]
    jobs += [Job(name, STRONG, "default", k) for k in again for name in CANNOT]
    nulls = range(args.first, args.first + args.nulls)
    jobs += [Job("none", 1.0, level, k) for k in nulls for level in ("exact", "default")]
    cases = {job.key: partial(_answer, job, settings, args.out / "cases") for job in jobs}
    run_cases(args.out, cases, summary=summary, settings=settings, most=args.most)


def _answer(job: Job, settings: Row, folder: Path) -> Row:
    """Makes a case, lets `discover_unpaired` answer, and only then opens the key."""
    case = folder / case_name(job.place(sealed=settings["sealed"]))
    shutil.rmtree(case, ignore_errors=True)
    case.with_name(f"{case.name}.key.json").unlink(missing_ok=True)
    seed = job.seed(sealed=settings["sealed"])
    about = {"effect": job.effect, "severity": job.severity, "seed": seed, "nuisance": job.nuisance}
    make_unpaired(case, **about, scenes=settings["scenes"])
    begun = time.process_time()
    result = discover_unpaired(simulated=case / "simulated", measured=case / "measured")
    spent = time.process_time() - begun
    result.verdict.save(case / "out")
    scored = score_case(case)
    for part in ("simulated", "measured"):
        shutil.rmtree(case / part)
    return {"key": job.key, "settings": settings, "seed": seed, "code": code_version(), "cpu_seconds": spent, **scored}


def summary(rows: Sequence[Row]) -> str:
    """Rates with 95 % intervals, and what was answered to each effect."""
    single = [row for row in rows if row["kind"] == "single"]
    told = [row for row in single if row["truth"][0] not in untold(classes=False)]
    lines = ["| cases | rate |", "|---|---|"]
    for severity in sorted({row["severity"] for row in told}):
        some = [row for row in told if row["severity"] == severity]
        lines.append(f"| severity {severity:g}: right name first | {rate(row['first_right'] for row in some)} |")
        lines.append(f"| right name in the set | {rate(row['in_set'] for row in some)} |")
        wrong = (row["named"] and not row["in_set"] for row in some)
        lines.append(f"| another name alone | {rate(wrong)} |")
    of_classes = [
        row
        for row in single
        if row["truth"][0] in untold(classes=False) and row["truth"][0] not in untold(classes=True)
    ]
    named = rate(row["named"] for row in of_classes)
    lines.append(f"| effects that need classes on both sides, not given here: something named | {named} |")
    cannot = [row for row in single if row["truth"][0] in untold(classes=True)]
    lines.append(f"| effects that need the same streets: something named | {rate(row['named'] for row in cannot)} |")
    for level in ("exact", "default"):
        none = [row for row in rows if row["kind"] == "none" and row["level"] == level]
        lines.append(f"| nothing hidden, {level} nuisances: something named | {rate(row['named'] for row in none)} |")
    if found := coverage(p for row in told if row["first_right"] for p in row["parameters"]):
        lines.append(f"| 90 % intervals that cover | {found} parameters |")
    lines += ["", "| hidden | severity | answer |", "|---|---|---|"]
    lines += [
        f"| {_words(row['truth'], 'nothing')} | {row['severity']:g} | {_words(row['answer'], row['verdict'])} |"
        for row in sorted(rows, key=lambda row: (row["truth"], row["severity"]))
        if row["truth"] or row["answer"]
    ]
    return "\n".join(lines)


def _words(names: Sequence[str], none: str) -> str:
    return ", ".join(names) or none


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--severity", type=float, nargs="+", default=[4.0, 8.0])
    parser.add_argument("--repeats", type=int, default=1, help="cases of each effect and severity")
    parser.add_argument("--nulls", type=int, default=20, help="of each level")
    parser.add_argument("--first", type=int, default=0, help="number of the first of each, for cases never asked")
    parser.add_argument("--scenes", type=int, default=16)
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
