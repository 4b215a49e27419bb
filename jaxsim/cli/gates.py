"""A gate that `jaxsim discover` asks, or writes: what it says, and how the command then ends."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jaxsim.cli.endings import words_of
from jaxsim.discover.distances import QuickDistances
from jaxsim.discover.gate import (
    Check,
    Colour,
    check_free,
    check_quick,
    check_verdict,
    colour_of,
    read_gate,
    save_gate,
    thresholds_of,
)
from jaxsim.discover.verdict import Verdict
from jaxsim.files import check_apart, write_text
from jaxsim.report.gates import TITLES, junit, markdown

EXIT: dict[Colour, int] = {"pass": 0, "gap": 1, "unsure": 2}
"""How the command ends where it asks a gate."""
NOT_FAST = ("effects", "effects_from", "control", "nulls", "every_frame")
"""Flags of naming, which --fast leaves out."""
Compared = Verdict | QuickDistances
"""What a gate is asked of: a whole answer, or distances alone."""


def check_flags(flags: Mapping[str, Any]) -> None:
    """Raises ValueError for flags of gates that do not go together."""
    gate, write_gate = flags["gate"], flags["write_gate"]
    fast = flags["fast"]
    if fast and not (gate or write_gate):
        raise ValueError("discover: --fast is for a gate; give --gate gate.json, or --write-gate gate.json first")
    for flag in NOT_FAST:
        if fast and flags[flag]:
            name = flag.replace("_", "-")
            raise ValueError(f"discover: --{name} came with --fast, which names nothing; leave one of them out")
    if gate and write_gate:
        raise ValueError("discover: --write-gate makes a gate, --gate asks it; give one of them")
    # Before anything is written there, or computed for it.
    check_apart(flags["out"], flags["measured"], flags["simulated"], by="discover")
    if write_gate:
        check_free(write_gate)


def ask_gate(path: Path, out: Path, compare: Callable[[], Compared]) -> int:
    """The exit status of a gate, whose checks are written to `out`; where the gate cannot be read, or frames cannot be
    compared, that of "unsure": a gap is what a simulation lacks, not what a file does."""
    begun = time.monotonic()
    notes: tuple[str, ...] = ()
    try:
        gate = read_gate(path)
        shown = compare()
        if isinstance(shown, Verdict):
            checks, notes = check_verdict(gate, shown), shown.notes
        else:
            checks = check_quick(gate, shown)
    except Exception as error:
        words = words_of(error)
        if words is None:  # a fault of jaxsim's own, or of an effect of the user's, is no gap of a simulation either
            traceback.print_exc()
        checks = (Check("comparison", "unsure", words or f"{type(error).__name__}: {error}"),)
    colour = colour_of(checks)
    write_text(out / "junit.xml", junit(checks, seconds=time.monotonic() - begun))
    page = markdown(checks, title=TITLES[colour], notes=notes)
    write_text(out / "gate.md", page)
    print(page)
    return EXIT[colour]


def make_gate(path: Path, out: Path, shown: Compared) -> None:
    """Writes a gate of what frames that are held to be right show; of distances also OUT/gate.md."""
    if isinstance(shown, Verdict):
        save_gate(path, baseline=out / "verdict.json")
    else:
        save_gate(path, thresholds=thresholds_of(shown.channels), frames=shown.frames)
        words = [(name, f"{d.value:.4g} ({d.low:.4g} .. {d.high:.4g}) {d.unit}") for name, d in shown.channels.items()]
        checks = tuple(Check(name, "pass", text) for name, text in words)
        write_text(out / "gate.md", markdown(checks, title="What the gate was written from"))
    print(f"{path}: {' '.join(path.read_text().split())}")
