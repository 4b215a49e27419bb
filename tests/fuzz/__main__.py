"""`python -m tests.fuzz N SEED`: N mutations over all readers, what came of them, exit code 1 for bad outcomes.

The last line counts all readers and gives the seed. With `--kept FILE` a killed run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path

from tests.fuzz.judge import BAD, COLUMNS
from tests.fuzz.worker import LIMIT_S, Outcome, run, table
from tests.programs import at_least, processor_s

PATIENCE_S = 180.0
"""Until a worker is ended that takes no processor time: it waits for ever. A busy machine makes nobody late."""


class Worker:
    """A process that reads, and the number that it is at."""

    def __init__(self, work: Path, seed: int, only: str):
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=run, args=(theirs, work, seed, only), daemon=True)
        work.mkdir(parents=True, exist_ok=True)
        self.process.start()
        self.begun_s = self.spent_s = self.seen = 0.0
        theirs.close()
        if (said := self.pipe.recv()) != "ready":
            raise RuntimeError(f"a valid tree cannot be made or read:\n{said}")

    def send(self, number: int) -> None:
        self.pipe.send(number)
        self.begun_s = self.spent_s = self._spent_s()
        self.seen = time.monotonic()

    def is_late(self) -> bool:
        """Whether it waits for ever, or works without an end."""
        if (spent_s := self._spent_s()) != self.spent_s:
            self.spent_s, self.seen = spent_s, time.monotonic()
        return time.monotonic() - self.seen > PATIENCE_S or self.spent_s - self.begun_s > 3 * LIMIT_S

    def _spent_s(self) -> float:
        return processor_s(self.process.pid or 0)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def outcomes(numbers: Iterator[int], seed: int, *, workers: int, only: str, work: Path) -> Iterator[Outcome]:
    """What came of these mutations, as they end; a worker that hangs or dies is replaced."""
    names = [name for name in table() if only in name]
    place = iter(range(10**9))
    idle = [Worker(work / str(next(place)), seed, only) for _ in range(workers)]
    busy: dict[Connection, tuple[Worker, int]] = {}
    again: list[int] = []
    todo = True
    while todo or busy or again:
        while idle and (todo or again):
            number = again.pop() if again else next(numbers, None)
            todo = todo and number is not None
            if number is not None:
                worker = idle.pop()
                worker.send(number)
                busy[worker.pipe] = worker, number
        ready = wait(list(busy), timeout=1.0) if busy else []
        late = [pipe for pipe, (worker, _) in busy.items() if pipe not in ready and worker.is_late()]
        for pipe in {*ready, *late}:
            worker, number = busy.pop(pipe)  # type: ignore[index]
            try:
                answer = worker.pipe.recv() if pipe in ready else "late"
            except (EOFError, OSError):
                answer = "died"
            if isinstance(answer, Outcome):
                yield answer
                idle.append(worker)
                continue
            if answer not in ("late", "died"):
                raise RuntimeError(f"mutation {number} cannot be made:\n{answer}")
            worker.end()
            code = worker.process.exitcode
            if code == -signal.SIGTERM:  # from outside, as a busy machine's watchman does
                again.append(number)
            else:
                # What ends without a word ran out of memory, or crashed in code that is not Python's.
                column = "hang" if answer == "late" else "memory"
                yield Outcome(number, names[number % len(names)], column, "?", f"exit code {code}")
            idle.append(Worker(work / str(next(place)), seed, only))
    for worker in idle:
        worker.end()


def show(counts: dict[str, Counter[str]], seed: int) -> str:
    """The table, a line a reader, and the seed."""
    wide = max(map(len, counts)) + 2
    lines = [" " * wide + " | ".join(COLUMNS)]
    for name in sorted(counts):
        lines.append(f"{name:<{wide}}" + " | ".join(f"{counts[name][c]:>{len(c)}}" for c in COLUMNS))
    total = sum(counts.values(), Counter())
    told = ", ".join(f"{column} {total[column]}" for column in COLUMNS)
    return "\n".join([*lines, f"seed {seed}, {len(counts)} readers, {total.total()} mutations: {told}"])


def kept(file: Path, *, about: str) -> list[Outcome]:
    """The outcomes that an earlier run kept. Raises ValueError where it was about other mutations."""
    if not file.exists():
        file.write_text(json.dumps(about) + "\n")
    lines = file.read_text().splitlines(keepends=True)
    if json.loads(lines[0]) != about:
        raise ValueError(f"{file} keeps what came of other mutations; name another file")
    if not lines[-1].endswith("\n"):  # the run was killed while it wrote this one
        file.write_text("".join(lines := lines[:-1]))
    return [Outcome(*json.loads(line)) for line in lines[1:]]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("count", type=at_least(1), help="mutations")
    parser.add_argument("seed", type=at_least(0))
    parser.add_argument("--first", type=at_least(0), default=0, help="number of the first: repeats a single one")
    parser.add_argument("--only", default="", help="readers whose name holds this")
    parser.add_argument("--workers", type=at_least(1), default=os.cpu_count() or 1)
    parser.add_argument(
        "--kept", type=Path, help="a file for the outcomes, a line each: what is in it is not made again"
    )
    parser.add_argument("--each", type=at_least(0), default=2, help="bad outcomes to show of each reader and column")
    given = parser.parse_args(argv)
    names = [name for name in table() if given.only in name]
    if not names:
        parser.error(f"no reader's name holds {given.only!r}; there are {', '.join(table())}")
    counts: dict[str, Counter[str]] = {name: Counter() for name in names}

    def count(outcome: Outcome) -> None:
        counts[outcome.reader][outcome.column] += 1
        if outcome.column in BAD and counts[outcome.reader][outcome.column] <= given.each:
            print(
                f"{outcome.column}: {outcome.reader}, mutation {outcome.number}, {outcome.mutation}\n"
                f"    {outcome.text}",
                flush=True,
            )

    todo = range(given.first, given.first + given.count)
    before = kept(given.kept, about=f"seed {given.seed}, readers {', '.join(names)}") if given.kept else []
    before = [outcome for outcome in before if outcome.number in todo]
    for outcome in before:
        count(outcome)
    done = {outcome.number for outcome in before}
    numbers = (number for number in todo if number not in done)
    with tempfile.TemporaryDirectory() as work:
        for outcome in outcomes(numbers, given.seed, workers=given.workers, only=given.only, work=Path(work)):
            count(outcome)
            if given.kept:
                with given.kept.open("a") as file:
                    file.write(json.dumps(outcome) + "\n")
    print(show(counts, given.seed))
    return int(any(counts[name][column] for name in names for column in BAD))


if __name__ == "__main__":
    sys.exit(main())
