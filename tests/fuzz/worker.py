"""Reads mutated trees in a process of its own: under a limit of memory, and ended from outside where it hangs."""

from __future__ import annotations

import os
import resource
import shutil
import time
import traceback
import warnings
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.fuzz.judge import PACKAGE, digest, fault, of_error
from tests.fuzz.mutations import mutate
from tests.fuzz.reader import Reader

MEMORY = 2 << 30
"""Bytes that a reader may take beside what the process has before."""


LIMIT_S = 10.0
"""Processor time after which a reader hangs."""


class Outcome(NamedTuple):
    """What became of one mutation."""

    number: int
    reader: str
    column: str
    mutation: str
    text: str = ""


def table() -> dict[str, Reader]:
    """Every reader by its name."""
    from tests.fuzz.logs import LOGS
    from tests.fuzz.made import MADE
    from tests.fuzz.recordings import RECORDINGS

    return RECORDINGS | MADE | LOGS


def prepare(work: Path, only: str = "") -> tuple[dict[str, Reader], dict[str, str]]:
    """Makes the valid trees below `work/valid`, reads each, and gives the readers with their values' digests."""
    readers = {name: reader for name, reader in table().items() if only in name}
    digests = {}
    for name, reader in readers.items():
        folder = work / "valid" / name.replace(" ", "_")
        if not folder.exists():
            folder.mkdir(parents=True)
            reader.make(folder)
        digests[name] = _read(reader, folder, work)[1]
    return readers, digests


def _read(reader: Reader, folder: Path, work: Path) -> tuple[Any, str]:
    """The value of a copy, as a reader may write beside what it reads."""
    copy = fresh(folder, work)
    value = reader.read(copy)
    return value, digest(value)


def fresh(folder: Path, work: Path) -> Path:
    """A copy of a tree, always at the same place: values may hold paths."""
    copy = work / "case"
    shutil.rmtree(copy, ignore_errors=True)
    return Path(shutil.copytree(folder, copy, symlinks=True))


def attack(number: int, seed: int, readers: dict[str, Reader], digests: dict[str, str], work: Path) -> Outcome:
    """Mutation `number` of a seed."""
    rng = np.random.default_rng([seed, number])
    name = list(readers)[number % len(readers)]
    reader = readers[name]
    copy = fresh(work / "valid" / name.replace(" ", "_"), work)
    files = sorted({p for pattern in reader.files for p in copy.glob(pattern) if p.is_file()})
    chosen = files[int(rng.integers(0, len(files)))]
    mutation = f"{mutate(chosen, rng)} of {chosen.relative_to(copy)}"
    begun = time.process_time()
    column, text = _outcome(reader, copy, digests[name])
    # Of this process's own time: a busy machine makes nothing hang.
    if (taken := time.process_time() - begun) > LIMIT_S:
        column, text = "hang", f"{taken:.0f} s"
    return Outcome(number, name, column, mutation, text)


def _outcome(reader: Reader, folder: Path, valid: str) -> tuple[str, str]:
    """The column of what comes of reading a tree, and what is to be said of it."""
    try:
        value = reader.read(folder)
        if digest(value) == valid:
            return "same", ""
        wrong = "its digest was not compared" if reader.sealed else fault(value, reader)
        return ("implausible accepted", wrong) if wrong else ("different but sane", "")
    except BaseException as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(PACKAGE)]
        place = f"{frames[-1].filename[len(PACKAGE) + 1 :]}:{frames[-1].lineno}" if frames else "?"
        return of_error(error, folder), f"{type(error).__name__} at {place}: {str(error)[:300]}"


def run(pipe: Connection, work: Path, seed: int, only: str) -> None:
    """Answers numbers with outcomes until the pipe closes."""
    # Also what libraries of C say.
    for stream in (1, 2):
        os.dup2(os.open(work / "said", os.O_WRONLY | os.O_CREAT), stream)
    warnings.simplefilter("ignore")
    try:
        readers, digests = prepare(work, only)
    except BaseException:
        pipe.send(traceback.format_exc())
        raise
    pipe.send("ready")
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, resource.RLIM_INFINITY))
    while True:
        try:
            number = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(attack(number, seed, readers, digests, work))
        except Exception:
            pipe.send(traceback.format_exc())
