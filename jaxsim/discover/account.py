"""The lines of a verdict that account for the answer: what was named, what ranked below, what moved, and notes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxsim.discover.fit import Problem
from jaxsim.discover.name import BAR, Choice, Step, accepted
from jaxsim.discover.read import Comparison
from jaxsim.discover.split import Split
from jaxsim.discover.survey import clipped
from jaxsim.discover.verdict import Interval, Named, Rank
from jaxsim.effects import EFFECTS


def named(step: Step, parameters: dict[str, Any]) -> Named:
    effect, gain = step.chosen.effect, clipped(step.chosen.by_unit)
    draws = np.random.default_rng(0).choice(gain, (2000, len(gain))).mean(1)
    low, high = np.quantile(draws, [0.05, 0.95])
    alike = tuple(c.effect.name for c in step.alike)
    apart = {name: effect.look_alikes.get(name) or EFFECTS[name].look_alikes.get(effect.name, "") for name in alike}
    return Named(
        name=effect.name,
        look_alikes=alike,
        tell_apart={name: text or "scenes in which their covariates differ more" for name, text in apart.items()},
        channels=effect.channels,
        p_value=step.p_value,
        gain=Interval(float(gain.mean()), float(low), float(high), "nats per scene"),
        parameters=parameters,
    )


def ranking(choice: Choice) -> tuple[Rank, ...]:
    """The first step's candidates and why each was not named."""
    ranking = choice.steps[0].ranking if choice.steps else choice.last
    best = choice.steps[0] if choice.steps else None
    rows = []
    for candidate in ranking[:12]:
        name, p = candidate.effect.name, candidate.chance
        if best and name == best.chosen.effect.name:
            why = ""
        elif best and name in {c.effect.name for c in best.alike}:
            why = "these data cannot tell it from the one that is named"
        elif not accepted(candidate):
            why = "its gain is within what a null reaches, or the scenes disagree on it"
        else:
            why = "it explains clearly less than the one that is named"
        rows.append(
            Rank(name, candidate.total / max(len(candidate.by_unit), 1), p, BAR / max(len(candidate.by_unit), 1), why)
        )
    return tuple(rows)


def moved(null: Problem, after: Problem) -> dict[str, tuple[float, float]]:
    names = null.noise.__dataclass_fields__
    return {n: (float(getattr(null.noise, n)), float(getattr(after.noise, n))) for n in names}


def notes(comparison: Comparison, parts: Split, there: Sequence[str]) -> tuple[str, ...]:
    notes = list(comparison.notes)
    if there:
        notes.append(f"beside what the sensor model already had: {', '.join(there)}")
    if len(set(comparison.scenes)) == 1:
        notes.append(
            "one drive alone: its frames are cut into the same sectors with gaps between them; sectors are less "
            "independent than drives"
        )
    if len(parts.find) < 8:
        notes.append(f"{len(parts.find)} scenes to find with are few: weak effects cannot be told from none")
    return tuple(notes)
