"""`python -m tests.kills N SEED`: N kills over all commands, each resumed; exit code 1 where a result differs.

A third of the kills are full disks instead: files beyond a random size cannot be written, the command must end with one
line and a status of 1, and go on once they can.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.kills.commands import COMMANDS, Command, digests, fresh
from tests.programs import environment

OUTCOMES = ("same bytes", "ended before", "differs", "does not resume", "traceback")
GOOD = OUTCOMES[:2]


def start(command: Command, work: Path, cache: Path, *, largest: int | None = None) -> subprocess.Popen[bytes]:
    """The command at work in its own group of processes; `largest` is the size of a file that it may write."""

    def limited() -> None:
        os.setsid()
        if largest is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    return subprocess.Popen(
        [sys.executable, "-m", "jaxsim.cli", *command.words],
        cwd=work,
        env=environment(cache, JAX_COMPILATION_CACHE_DIR=str(cache / "xla"), JAX_DISABLE_MOST_OPTIMIZATIONS="1"),
        stdout=(work / "said").open("ab"),
        stderr=subprocess.STDOUT,
        preexec_fn=limited,
    )


def run_whole(command: Command, work: Path, cache: Path) -> float:
    """Runs it to its end, and gives the seconds that it took. Raises RuntimeError where it fails."""
    begun = time.monotonic()
    if start(command, work, cache).wait():
        raise RuntimeError(f"{' '.join(command.words)}\n{(work / 'said').read_text()[-3000:]}")
    return time.monotonic() - begun


def kill(command: Command, work: Path, cache: Path, *, after_s: float) -> bool:
    """Kills it and all its processes after so many seconds; whether that was before its end."""
    process = start(command, work, cache)
    try:
        process.wait(timeout=after_s)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True


def fill(command: Command, work: Path, cache: Path, *, largest: int) -> str:
    """Runs it where larger files cannot be written; an outcome, empty where it ended as it should."""
    ended = start(command, work, cache, largest=largest).wait()
    said = (work / "said").read_text()
    if "Traceback" in said:
        return "traceback"
    return "" if ended == 1 else "ended before" if ended == 0 else f"status {ended}"


def attack(name: str, count: int, seed: int, base: Path) -> Counter[str]:
    """What came of so many kills of one command; the same for a seed, whichever others are asked for."""
    command, place, found = COMMANDS[name], base / name.replace(" ", "_"), Counter[str]()
    rng = np.random.default_rng([seed, list(COMMANDS).index(name)])
    (place / "inputs").mkdir(parents=True)
    command.inputs(place / "inputs")
    # Twice: the second one finds compiled programs, as the killed ones will.
    for _ in range(2):
        took = run_whole(command, fresh(place / "inputs", place / "work"), base)
    wanted = digests(place / "work" / command.results)
    files = (place / "work" / command.results).rglob("*")
    largest_file = max(path.stat().st_size for path in files if path.is_file())
    print(f"{name}: {took:.0f} s, {len(wanted)} results", flush=True)
    for k in range(count):
        work = fresh(place / "inputs", place / "work")
        if k % 3 == 2:
            largest = int(largest_file * rng.uniform(0.05, 0.95))
            how, outcome = f"no file above {largest} bytes", fill(command, work, base, largest=largest)
        else:
            after_s = float(rng.uniform(0.2, 1.0)) * took
            how = f"killed after {after_s:.1f} s"
            outcome = "" if kill(command, work, base, after_s=after_s) else "ended before"
        if outcome in ("", "ended before"):
            try:
                run_whole(command, work, base)
                now = digests(work / command.results)
                changed = [file for file in {*now, *wanted} if now.get(file) != wanted.get(file)]
                outcome = f"differs: {', '.join(sorted(changed)[:5])}" if changed else outcome or "same bytes"
            except RuntimeError as error:
                outcome = f"does not resume: {str(error)[-400:]}"
        print(f"{name}, {how}: {outcome}", flush=True)
        found[outcome.partition(":")[0]] += 1
    return found


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("count", type=int, help="kills")
    parser.add_argument("seed", type=int)
    parser.add_argument("--only", nargs="*", default=list(COMMANDS), choices=list(COMMANDS))
    given = parser.parse_args(argv)
    total = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for k, name in enumerate(given.only):
            counts = attack(name, len(range(k, given.count, len(given.only))), given.seed, Path(folder))
            print(f"{name:<16}{told(counts)}", flush=True)
            total += counts
    print(f"seed {given.seed}, {len(given.only)} commands, {total.total()} kills: {told(total)}")
    return int(any(outcome not in GOOD for outcome in total))


def told(counts: Counter[str]) -> str:
    return ", ".join(f"{outcome} {count}" for outcome, count in sorted(counts.items()))


if __name__ == "__main__":
    sys.exit(main())
