"""`python -m tests.kills N SEED`: N attacks over all commands, each resumed; exit code 1 where a result differs.

Of each command the first attack is a second process on the same folder at the same time, and then in turn: killed
(SIGKILL, with all its processes), killed, stopped (SIGTERM), a full disk (files beyond a random size cannot be
written; the command must end with one line and a status of 1, and go on once they can). With `--kept FOLDER` an attack
that was itself ended goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tests.kills.commands import COMMANDS, Command, digests, fresh
from tests.kills.process import Running
from tests.programs import at_least

GOOD = ("same bytes", "ended before")
"""Outcomes as they should be: the second, where the command ended before it was reached, and rightly."""
KINDS = ("two at once", "killed", "killed", "stopped", "full disk")


def run_whole(command: Command, work: Path, cache: Path) -> float:
    """Runs it to its end, and gives the processor time that it took. Raises RuntimeError where it fails."""
    running = Running(command.words, work, cache)
    if running.wait():
        raise RuntimeError(f"{' '.join(command.words)}\n{running.said[-3000:]}")
    return running.took_s


def broken(command: Command, kind: str, work: Path, cache: Path, *, share: float, took_s: float, largest: int) -> str:
    """Lets one attack happen to a fresh command; what is wrong with how it ended, or `ended before`, or nothing."""
    if kind == "two at once":
        both = [Running(command.words, work, cache, log=f"said{k}") for k in range(2)]
        ended = [(one.wait(), one.said) for one in both]
        wrong = [said for code, said in ended if code and (code != 1 or "another process" not in said)]
        return f"ends otherwise: {wrong[0][-400:]}" if wrong else "" if any(code for code, _ in ended) else GOOD[1]
    running = Running(command.words, work, cache, largest=int(largest * share) if kind == "full disk" else None)
    if kind == "full disk":
        right = running.wait() == 1
    elif not running.reach((0.1 + 0.9 * share) * took_s):
        right = False
    else:
        # -15: it had done its work, and Python was on its way out.
        right = running.end(hard=kind == "killed") in (-9, 143, -15)
    if "Traceback" in running.said:
        return f"traceback: {running.said[-400:]}"
    return "" if right else GOOD[1] if running.code == 0 else f"ends otherwise: {running.code}, {running.said[-400:]}"


def attack(name: str, count: int, seed: int, base: Path) -> Counter[str]:
    """What came of so many attacks on one command; the same for a seed, whichever others are asked for."""
    command, place = COMMANDS[name], base / name.replace(" ", "_")
    rng = np.random.default_rng([seed, list(COMMANDS).index(name)])
    shares = rng.uniform(0.05, 0.95, count)
    about, log = place / "whole.json", place / "outcomes.jsonl"
    if not about.exists():
        fresh(place / "inputs", make=command.inputs)
        # Twice: the second one finds compiled programs and rendered frames, as the attacked ones will.
        run_whole(command, fresh(place / "work", like=place / "inputs"), base)
        for folder in command.kept:
            shutil.copytree(place / "work" / folder, place / "inputs" / folder)
        took_s = run_whole(command, fresh(place / "work", like=place / "inputs"), base)
        files = [path for path in (place / "work" / command.results).rglob("*") if path.is_file()]
        whole = {"took_s": took_s, "largest": max(path.stat().st_size for path in files)}
        about.write_text(json.dumps(whole | {"digests": digests(place / "work" / command.results)}))
        log.touch()
    whole = json.loads(about.read_text())
    print(f"{name}: {whole['took_s']:.0f} s of processor time, {len(whole['digests'])} results", flush=True)
    found = [json.loads(line) for line in log.read_text().splitlines()]
    for k in range(len(found), count):
        work, kind = fresh(place / "work", like=place / "inputs"), KINDS[k % len(KINDS)]
        outcome = broken(command, kind, work, base, share=shares[k], took_s=whole["took_s"], largest=whole["largest"])
        if outcome in ("", GOOD[1]):
            outcome = resumed(command, work, base, whole["digests"]) or outcome or GOOD[0]
        print(f"{name}, {kind}, {shares[k]:.2f}: {outcome}", flush=True)
        found.append([kind, outcome.partition(":")[0]])
        with log.open("a") as file:
            file.write(json.dumps(found[-1]) + "\n")
    return Counter(f"{kind}: {outcome}" for kind, outcome in found)


def resumed(command: Command, work: Path, cache: Path, wanted: dict[str, str]) -> str:
    """Gives the command again; what is wrong with the results then, or nothing."""
    try:
        run_whole(command, work, cache)
    except RuntimeError as error:
        return f"does not resume: {str(error)[-600:]}"
    now = digests(work / command.results)
    changed = sorted(file for file in {*now, *wanted} if now.get(file) != wanted.get(file))
    return f"differs: {', '.join(changed[:5])}" if changed else ""


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("count", type=at_least(1), help="attacks")
    parser.add_argument("seed", type=at_least(0))
    can = [name for name, command in COMMANDS.items() if not command.needs or find_spec(command.needs)]
    parser.add_argument("--only", nargs="+", default=can, choices=list(COMMANDS), help="default: all that can run here")
    parser.add_argument("--kept", type=Path, help="a folder for what was done, to go on from")
    given = parser.parse_args(argv)
    total = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        base = (given.kept / f"{given.seed}").absolute() if given.kept else Path(folder)
        for k, name in enumerate(given.only):
            counts = attack(name, len(range(k, given.count, len(given.only))), given.seed, base)
            print(f"{name:<16}{told(counts)}", flush=True)
            total += counts
    print(f"seed {given.seed}, {len(given.only)} commands, {total.total()} attacks: {told(total)}")
    return int(any(outcome.partition(": ")[2] not in GOOD for outcome in total))


def told(counts: Counter[str]) -> str:
    return ", ".join(f"{outcome} {count}" for outcome, count in sorted(counts.items()))


if __name__ == "__main__":
    sys.exit(main())
