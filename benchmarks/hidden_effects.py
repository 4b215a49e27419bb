"""Blind naming of hidden effects: `python -m benchmarks.hidden_effects OUT [--help]`.

Makes sealed cases with the independent generator of tests/hidden, runs `discover` on each, writes the verdicts,
and only then opens the keys. One JSON line a case in OUT/cases.jsonl; a killed run goes on where it stopped.
Prints the confusion of what was hidden with what was named, and the rates that docs/discover.md quotes.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from jaxsim.cli import enable_compilation_cache
from jaxsim.discover import discover_folders
from tests.hidden import case_name, key_path, list_combinations, list_effects, list_outside, make_case, score_case

DEVELOPMENT = 10_000
"""Seeds below this are for development; sealed cases start here."""


def plan(args: argparse.Namespace) -> Iterator[tuple[str, float, str, int]]:
    """(effect, severity, nuisance, seed) of every case, in an order that has some of each kind early."""
    jobs = [(effect, s, "default") for s in args.severity for effect in list_effects()]
    jobs += [("none", 1.0, level) for level in ("exact", "misspecified") for _ in range(args.nulls)]
    jobs += [(f"outside:{name}", max(args.severity), "default") for name in list_outside() for _ in range(args.outside)]
    jobs += [
        (name, max(args.severity), "default")
        for size in (2, 3)
        for name in list_combinations(size, args.pairs, args.seed)
    ]
    order = np.random.default_rng(args.seed).permutation(len(jobs))
    for k in order[: args.most or None]:
        yield (*jobs[k], args.seed + int(k))


def run(folder: Path, job: tuple[str, float, str, int], scenes: int) -> dict[str, Any]:
    """Makes, answers and scores one case; keeps the verdict and throws the frames away."""
    effect, severity, nuisance, seed = job
    case = folder / case_name(seed)
    for old in (case, key_path(case)):
        if old.is_dir():
            shutil.rmtree(old)
        elif old.is_file():
            old.unlink()
    make_case(case, effect=effect, severity=severity, seed=seed, nuisance=nuisance, scenes=scenes)
    begun = time.monotonic()
    result = discover_folders(case / "simulated", case / "measured")
    (case / "out").mkdir()
    result.verdict.save(case / "out")
    seconds = time.monotonic() - begun
    scored = score_case(case, case / "out" / "verdict.json")
    shutil.rmtree(case / "simulated")
    shutil.rmtree(case / "measured")
    closure = result.verdict.closure
    return {"seed": seed, "seconds": seconds, **scored, "closure": closure.value if closure else None}


def wilson(hits: int, n: int) -> str:
    """A share with its 95 % Wilson interval."""
    if not n:
        return "-"
    z, p = 1.96, hits / n
    middle, half = (
        (p + z * z / (2 * n)) / (1 + z * z / n),
        z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n),
    )
    return f"{100 * p:.0f} % ({hits} of {n}; {100 * (middle - half):.0f}-{100 * (middle + half):.0f})"


def summary(rows: list[dict[str, Any]]) -> str:
    """The rates and the confusion table, in Markdown."""
    single = [r for r in rows if r["kind"] == "single"]
    lines = ["| measure | value |", "|---|---|"]
    for severity in sorted({r["severity"] for r in single}):
        some = [r for r in single if r["severity"] == severity]
        lines.append(
            f"| severity {severity:g}: right name first | {wilson(sum(r['first_right'] for r in some), len(some))} |"
        )
        lines.append(f"| severity {severity:g}: in the set | {wilson(sum(r['in_set'] for r in some), len(some))} |")
    sizes = [r["set_size"] for r in single if r["set_size"]]
    lines.append(f"| mean set size | {np.mean(sizes):.2f} |" if sizes else "| mean set size | - |")
    for level in ("exact", "misspecified"):
        some = [r for r in rows if r["kind"] == "none" and r["level"] == level]
        lines.append(f"| {level} nulls: an effect named | {wilson(sum(r['named'] for r in some), len(some))} |")
        lines.append(f"| {level} nulls: anything but none | {wilson(sum(not r['right'] for r in some), len(some))} |")
    some = [r for r in rows if r["kind"] == "outside"]
    lines.append(
        f"| outside: right channel and covariate, nothing named | {wilson(sum(r['right'] for r in some), len(some))} |"
    )
    lines.append(f"| outside: an effect named | {wilson(sum(r['named'] for r in some), len(some))} |")
    some = [r for r in rows if r["kind"] == "combination"]
    lines.append(f"| pairs and triples: exact set | {wilson(sum(r['exact'] for r in some), len(some))} |")
    lines.append(f"| pairs and triples: mean F1 | {np.mean([r['f1'] or 0 for r in some]):.2f} |" if some else "")
    inside = [p["inside"] for r in rows for p in r["parameters"] if p["inside"] is not None]
    lines.append(f"| 90 % intervals that cover | {100 * np.mean(inside):.0f} % of {len(inside)} |" if inside else "")
    closure = [r["closure"] for r in single if r["first_right"] and r["closure"] is not None]
    lines.append(f"| median closure, rightly named | {np.median(closure):.2f} |" if closure else "")
    lines.append(f"| median seconds a case | {np.median([r['seconds'] for r in rows]):.0f} |" if rows else "")
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for r in rows:
        table[" + ".join(r["truth"]) or "none"][" + ".join(r["answer"]) or r["verdict"]] += 1
    lines += ["", "| hidden | answers |", "|---|---|"]
    lines += [
        f"| {hidden} | {', '.join(f'{a} {n}' for a, n in table[hidden].most_common())} |" for hidden in sorted(table)
    ]
    return "\n".join(line for line in lines if line or line == "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=DEVELOPMENT, help="first seed; below 10000 is development")
    parser.add_argument("--severity", type=float, nargs="+", default=[2.0, 4.0])
    parser.add_argument("--nulls", type=int, default=100, help="of each level")
    parser.add_argument("--outside", type=int, default=3, help="cases of each kind outside the catalogue")
    parser.add_argument("--pairs", type=int, default=20, help="pairs, and as many triples")
    parser.add_argument("--scenes", type=int, default=16)
    parser.add_argument("--most", type=int, default=0, help="stop after so many cases; 0 runs all")
    args = parser.parse_args()
    enable_compilation_cache()
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.is_file() else []
    done = {row["seed"] for row in rows}
    for job in tqdm(list(plan(args)), unit="case"):
        if job[3] in done:
            continue
        rows.append(run(args.out, job, args.scenes))
        with kept.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    print(summary(rows))


if __name__ == "__main__":
    main()
