"""Blind naming of hidden effects: `python -m benchmarks.blind.effects OUT [--sealed] [--workers 2] [--help]`.

Makes cases with the independent generator of benchmarks/blind/hidden, runs `discover` on each, writes the verdicts,
and only then opens the keys. One JSON line a case goes to OUT/cases.jsonl. The same command again goes on where it
stopped, and with larger counts it adds the cases that are new: seeds follow from what a case hides, not from its
place in the plan. `--table` computes nothing and shows what is there.

Development cases have seeds below 10000; `--sealed` ones, on which nothing may be tuned, from 10000 on.

Writes OUT/summary.md (also printed), OUT/confusion.svg and OUT/power.svg.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.plan import Counts, Job, Settings, plan
from benchmarks.blind.rows import append_row, check_settings, code_version, read_rows
from benchmarks.blind.tables import summary

RECYCLE = 40
"""Cases after which a worker starts anew: compiled programs of other shapes pile up in it."""


def main(argv: list[str] | None = None) -> None:
    args = _arguments(argv)
    counts = Counts(tuple(args.severity), args.repeats, args.nulls, args.outside, args.pairs, args.first)
    settings = Settings(args.sealed, args.scenes, drawn=args.calibrate, simulator=args.simulator)
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = {row["key"]: row for row in read_rows(kept)}
    check_settings(list(rows.values()), settings.__dict__)
    jobs = [job for job in plan(counts, sealed=args.sealed) if not args.only or job.effect in args.only]
    done = {key for key, row in rows.items() if row["verdict"] != "error"}
    jobs = [job for job in jobs if job.key not in done][: args.most]
    if not args.table:
        for row in tqdm(
            answers([(job, settings) for job in jobs], args.out, workers=args.workers), total=len(jobs), unit="case"
        ):
            append_row(kept, row)
            rows[row["key"]] = row
    text = summary(list(rows.values()))
    (args.out / "summary.md").write_text(text + "\n")
    print(text)
    if rows:
        from benchmarks.blind.pictures import save_pictures

        save_pictures(args.out, list(rows.values()))


def answers(jobs: list[tuple[Job, Settings]], out: Path, *, workers: int) -> Iterator[dict[str, Any]]:
    """Rows as they come. Each worker computes on one core: two cases side by side waste less than one on two cores."""
    if not jobs:
        return
    # Read by XLA and BLAS when a worker starts.
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    for name in ("NPROC", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    spawn = multiprocessing.get_context("spawn")
    # A pool anew every so often; `max_tasks_per_child` hangs on some releases of Python 3.11 and 3.12.
    for first in range(0, len(jobs), RECYCLE * workers):
        pool = ProcessPoolExecutor(workers, spawn, initializer=_begin)
        try:
            some = jobs[first : first + RECYCLE * workers]
            for future in as_completed([pool.submit(_answer, job, settings, out) for job, settings in some]):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _begin() -> None:
    from jaxsim.compilation import enable_compilation_cache
    from jaxsim.discover.name import candidates

    enable_compilation_cache()
    candidates.THREADS = 1
    code_version()


def _answer(job: Job, settings: Settings, out: Path) -> dict[str, Any]:
    """A case's row; a case that ends with an error has one too, counts as wrong, and is tried again by the next run."""
    from benchmarks.blind.case import run_case

    try:
        folder = out / "cases"
        return run_case(job, settings, folder if settings.cell == Settings().cell else folder / settings.cell)
    except Exception as error:
        print(f"{job.key}: {error!r}", file=sys.stderr)
        return failed(job, settings, error)


def failed(job: Job, settings: Settings, error: Exception) -> dict[str, Any]:
    outside, effects = job.effect.startswith("outside:"), [] if job.effect == "none" else job.effect.split("+")
    kind = "outside" if outside else ("none", "single")[len(effects)] if len(effects) < 2 else "combination"
    wrong = ("named", "first_right", "in_set", "exact", "where_right", "right")
    return {
        "key": job.key,
        "settings": settings.__dict__,
        "seed": job.seed(sealed=settings.sealed),
        "code": code_version(),
        "seconds": 0.0,
        "cpu_seconds": 0.0,
        "kind": kind,
        "truth": effects,
        "severity": job.severity,
        "level": job.nuisance,
        "verdict": "error",
        "answer": [],
        "set_size": None,
        "f1": 0.0,
        "parameters": [],
        "error": repr(error),
        **dict.fromkeys(wrong, False),
    }


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usual = Counts()
    parser.add_argument("out", type=Path)
    parser.add_argument("--sealed", action="store_true", help="the sealed cases instead of the development ones")
    parser.add_argument("--workers", type=int, default=2, help="processes, one core each (default 2)")
    parser.add_argument("--severity", type=float, nargs="+", default=list(usual.severities))
    parser.add_argument("--repeats", type=int, default=usual.repeats, help="of each effect at each severity")
    parser.add_argument("--nulls", type=int, default=usual.nulls, help="of each level")
    parser.add_argument("--outside", type=int, default=usual.outside, help="cases of each kind outside the catalogue")
    parser.add_argument("--pairs", type=int, default=usual.pairs, help="pairs, and as many triples")
    parser.add_argument("--first", type=int, default=0, help="number of the first of each, for cases never asked")
    parser.add_argument("--scenes", type=int, default=Settings().scenes)
    parser.add_argument("--simulator", choices=SIMULATORS, default="ideal", help="errors of the simulated side")
    parser.add_argument(
        "--calibrate", type=int, default=0, metavar="N", help="set each case's bar on N nulls drawn from it"
    )
    parser.add_argument("--most", type=int, default=None, help="stop after so many new cases")
    parser.add_argument("--only", nargs="+", metavar="EFFECT", help="cases that hide this alone, as in 'none'")
    parser.add_argument("--table", action="store_true", help="run nothing; show what OUT holds")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
