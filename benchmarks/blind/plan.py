"""Which cases are run. A case's seed depends on what it hides and on its number alone, so that a later run with more
cases takes over the earlier ones."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from benchmarks.blind.hidden import list_combinations, list_effects, list_outside

DEVELOPMENT = 10_000
"""Seeds below this are for development; sealed cases have seeds from here on."""
LAST = 2**31

ONLY_JOINTLY = ("oren_nayar", "specular_lobe", "gamma_response", "incidence_range_bias", "interference")
"""Effects that such frames need not tell from their look-alikes, by the grades of identifiability in the literature
alone (to be had only from several channels together, or as a member of a set). All others are called separable, those
without a grade too."""


@dataclass(frozen=True)
class Settings:
    """What all cases of a run share."""

    sealed: bool = False
    scenes: int = 16
    rows: int = 48
    columns: int = 384
    drawn: int = 0
    """Nulls drawn from each case to set its bar."""
    simulator: str = "ideal"
    """Whose errors the simulated side has of its own (benchmarks/blind/hidden/simulator.py)."""
    world: str = "home"
    """'home' (benchmarks/blind/hidden), 'raycast' or 'mitsuba' (folders of those names)."""
    sensor: str = "own"
    """A sensor of a later world; the first has its own."""
    given: str = "all"
    """'all' arrays that the simulated side may have, or 'bare': range and intensity alone."""

    @property
    def cell(self) -> str:
        """What tells one group of cases of `benchmarks.blind.worlds` from another."""
        return f"{self.world}-{self.sensor}-{self.simulator}-{self.given}"


@dataclass(frozen=True)
class Job:
    """One case: what it hides (in the hidden world's words), how strongly, in which nuisances, and its number."""

    effect: str
    severity: float
    nuisance: str
    repeat: int

    @property
    def key(self) -> str:
        return f"{self.effect} {self.severity:g} {self.nuisance} {self.repeat}"

    def seed(self, *, sealed: bool) -> int:
        """0..9999 for development, from 10000 on for sealed cases."""
        number = int.from_bytes(hashlib.sha256(self.key.encode()).digest()[:8], "big")
        return DEVELOPMENT + number % (LAST - DEVELOPMENT) if sealed else number % DEVELOPMENT

    def place(self, *, sealed: bool) -> int:
        """A number for the case's folder, which says nothing about what it hides."""
        return int.from_bytes(hashlib.sha256(f"{sealed} {self.key}".encode()).digest()[8:16], "big")


@dataclass(frozen=True)
class Counts:
    """How many cases of each kind."""

    severities: tuple[float, ...] = (1.0, 2.0, 4.0)
    repeats: int = 1
    """Of every effect at every severity."""
    nulls: int = 100
    """Of each level."""
    outside: int = 5
    """Of each kind outside the catalogue."""
    pairs: int = 20
    """Pairs, and as many triples."""
    first: int = 0
    """Number of the first of each kind, so that cases come that no earlier run has asked."""


def plan(counts: Counts, *, sealed: bool) -> list[Job]:
    """All cases, some of each kind early: in the order of the hashes of their names."""
    jobs = [
        Job(effect, severity, "default", repeat)
        for repeat in range(counts.first, counts.first + counts.repeats)
        for severity in counts.severities
        for effect in list_effects()
    ]
    jobs += [
        Job("none", 1.0, level, k)
        for level in ("exact", "misspecified")
        for k in range(counts.first, counts.first + counts.nulls)
    ]
    strong = 4.0
    numbers = range(counts.first, counts.first + counts.outside)
    jobs += [Job(f"outside:{name}", strong, "default", k) for name in list_outside() for k in numbers]
    # The first combinations stay the same when more are asked for.
    drawn = DEVELOPMENT if sealed else 0
    last = counts.first + counts.pairs if counts.pairs else 0
    sets = [names for size in (2, 3) if last for names in list_combinations(size, last, drawn)[counts.first :]]
    jobs += [Job("+".join(names), strong, "default", 0) for names in sets]
    return sorted(jobs, key=lambda job: hashlib.sha256(f"order {job.key}".encode()).digest())
