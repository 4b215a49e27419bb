"""The lines of a verdict that account for the answer: what was named, what ranked below, what moved, and notes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxsim.discover.add import parameters_of
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.random_effects import gain_and_classes
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import CLEAR, LEVEL, Choice, Step, padded, scenes_agree, smooth_is_enough
from jaxsim.discover.read import Comparison
from jaxsim.discover.scenes import Split, clipped, mean_interval
from jaxsim.discover.verdict import Interval, Named, Rank
from jaxsim.effects import EFFECTS

SHOWN = 12
"""Candidates of the first step that are listed."""
FEW_JUDGES = 5
"""Below so many judge scenes a note says that intervals are wide."""


def named(step: Step, parameters: dict[str, Any]) -> Named:
    effect, gain = step.chosen.effect, clipped(step.chosen.by_unit)
    low, high = mean_interval(gain)
    alike = tuple(c.effect.name for c in step.alike)
    apart = {name: effect.look_alikes.get(name) or EFFECTS[name].look_alikes.get(effect.name, "") for name in alike}
    return Named(
        name=effect.name,
        look_alikes=alike,
        tell_apart={name: text or "scenes in which their covariates differ more" for name, text in apart.items()},
        channels=effect.channels,
        p_value=step.p_value,
        gain=Interval(float(gain.mean()), low, high, "nats per scene"),
        parameters=parameters,
    )


def ranking(choice: Choice) -> tuple[Rank, ...]:
    """The first step's best candidates and why each was not named."""
    rows = choice.steps[0].ranking if choice.steps else choice.last
    bar = choice.bars.effect
    return tuple(
        Rank(one.effect.name, one.total / len(one.by_unit), one.chance, bar / len(one.by_unit), why_not(one, choice))
        for one in rows[:SHOWN]
    )


def why_not(candidate: Candidate, choice: Choice) -> str:
    """Why a candidate of the first step is not what was named first; empty if it is."""
    name, steps = candidate.effect.name, choice.steps
    order = [step.chosen.effect.name for step in steps]
    if name in order:
        return "" if name == order[0] else f"named too, after {', '.join(order[: order.index(name)])}"
    if steps and name in {one.effect.name for one in steps[0].alike}:
        return "these data cannot tell it from the one that is named"
    if candidate.total <= choice.bars.effect:
        return "its gain is within what a null reaches"
    if smooth_is_enough(candidate):
        return "a smooth change along the rows gains as much"
    if not scenes_agree(candidate):
        return "the scenes disagree on it"
    if not steps:
        strongest = (choice.last or (candidate,))[0]
        if candidate.total < CLEAR * strongest.total:
            return f"it is weak beside {strongest.effect.name}, on which the scenes disagree"
        return "a free curve explains clearly more"
    if padded(candidate, steps[0].chosen):
        return "it has more numbers to fit than the one that is named, and gains no more"
    return "it explains clearly less than the one that is named"


def moved(null: Problem, choice: Choice, fitted: Sequence[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """Noise scales, rates, gain and reflectances without the effects and with them; and of several effects (`fitted` is
    z of each) the parameters when each was added, and in the end."""
    problems = (null, choice.problem)
    names = null.noise.__dataclass_fields__
    found = {n: (float(getattr(null.noise, n)), float(getattr(choice.problem.noise, n))) for n in names}
    everyone = np.ones(len(null.ev.unit), np.float32)
    levels = [np.asarray(gain_and_classes(one.ev, one.equations, everyone)).tolist() for one in problems]
    classes = [f"class {k}" for k in np.unique(np.asarray(null.ev.rays.semantic))]
    found |= {name: (a, b) for name, a, b in zip(["gain", *classes], *levels, strict=True)}
    if len(choice.steps) > 1:
        for step, z in zip(choice.steps, fitted, strict=True):
            effect = step.chosen.effect
            first, last = (parameters_of(effect, one) for one in (step.fitted.z, z))
            single = [name for name, value in first.items() if isinstance(value, float)]
            found |= {f"{effect.name}.{name}": (first[name], last[name]) for name in single}
    return found


def notes(comparison: Comparison, parts: Split, there: Sequence[str], choice: Choice) -> tuple[str, ...]:
    """What a reader must know."""
    found = list(comparison.notes)
    if there:
        found.append(
            f"beside what the sensor model already had: {', '.join(there)}, held as given; the judge scenes are "
            "those of any other run on these frames: after several rounds, what they show is no longer new"
        )
    if len(set(comparison.scenes)) == 1:
        found.append(
            "one drive alone: its frames are cut into the same sectors with gaps between them; sectors are less "
            "independent than drives"
        )
    for step in choice.steps:
        if step.chosen.chance > LEVEL:
            found.append(f"{step.chosen.effect.name}: a rare event; few scenes show it, without the test over scenes")
    if len(parts.judge) < FEW_JUDGES:
        found.append(f"{len(parts.judge)} judge scenes: intervals of the gap are wide")
    return tuple(found)
