"""Rows of a run on disk: one JSON line a case, each written whole; and the run of those that are missing."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.blind.plan import Settings

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("jaxsim/discover", "jaxsim/effects", "jaxsim/geometry", "benchmarks/blind")
"""Folders that an answer and its score depend on; the hidden world lies in the last ..."""
MEASURED = ROOT / "benchmarks" / "blind" / "measured"
"""... and beside it what was answered, which no answer depends on."""


@cache
def code_version() -> str:
    """Hash of the sources that rows depend on: rows of different code are not one measurement.

    Of the files as they are when it is first called: a worker calls it when it starts."""
    here = [path for folder in SOURCES for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".json")]
    files = sorted(path for path in here if MEASURED not in path.parents)
    parts = [f"{path.relative_to(ROOT)} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in files]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a run, the last one of each case; a line that a killed run left half written is cut off the file.

    Raises ValueError for a line that is no row.
    """
    if not path.is_file():
        return []
    text = path.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if len(whole) < len(text):
        os.truncate(path, len(whole))
    rows: dict[str, dict[str, Any]] = {}
    for number, line in enumerate(whole.decode().splitlines(), 1):
        try:
            row = json.loads(line)
            rows[row["key"]] = row
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path}, line {number} is no row of this benchmark ({error!r}); give another OUT"
            ) from error
    return list(rows.values())


def append_row(path: Path, row: dict[str, Any]) -> None:
    """Adds a row in one write, and has it on the disk before it returns."""
    handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(handle, (json.dumps(row) + "\n").encode())
        os.fsync(handle)
    finally:
        os.close(handle)


def check_settings(rows: Sequence[dict[str, Any]], settings: dict[str, Any]) -> None:
    """Raises ValueError where rows were made with other settings than these. Rows from before there was a setting have
    what is usual."""
    for row in rows:
        known = asdict(Settings()) | row["settings"]
        other = {name: (known.get(name), value) for name, value in settings.items()}
        other = {name: pair for name, pair in other.items() if pair[0] != pair[1]}
        if other:
            told = ", ".join(f"{name} {was} (now {now})" for name, (was, now) in other.items())
            raise ValueError(f"OUT holds cases with {told}; give another OUT, or the same settings")


def run_cases(
    out: Path,
    cases: Mapping[str, Callable[[], dict[str, Any]]],
    *,
    summary: Callable[[Sequence[dict[str, Any]]], str],
    settings: dict[str, Any] | None = None,
    most: int | None = None,
) -> None:
    """Answers those of the cases, by key, that OUT/cases.jsonl lacks, `most` of them, each to a row with its key; then
    prints the summary of all rows and writes it to OUT/summary.md.

    Raises ValueError where there are rows of other `settings`.
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "cases.jsonl"
    rows = {row["key"]: row for row in read_rows(kept)}
    if settings is not None:
        check_settings(list(rows.values()), settings)
    # Sources that change while cases run are not those that answer them: what is loaded now counts.
    code_version()
    for key in tqdm([key for key in cases if key not in rows][:most], unit="case"):
        row = cases[key]()
        append_row(kept, row)
        rows[row["key"]] = row
    text = summary(list(rows.values()))
    (out / "summary.md").write_text(text + "\n")
    print(text)
