"""Which effect is missing: forward selection over the catalogue, with a bar that a null must not pass.

A candidate counts by its held-out gain (`survey`). It is accepted where the gain exceeds BAR nats and the units
agree on its sign; the set of look-alikes is whatever accepted candidate is not clearly worse than the best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxsim.discover.model.fit import Fit, Problem, fit, on_top
from jaxsim.discover.model.lattice import FINEST
from jaxsim.discover.model.null import fit_null
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.name.candidates import Candidate, survey
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.effects import Effect

BAR = 10.0
"""Held-out nats in all that a candidate must gain."""
LEVEL = 0.02
"""Of the sign-flip test over units."""
ALIKE = 0.10
"""A candidate is a look-alike unless the paired test against the best falls below this ..."""
CLEARLY = 0.75
"""... or it gains less than this share of the best's."""
CLEAR = 0.5
"""Share of the largest gain that a candidate must reach, accepted or not as that one may be."""
MOST = 4
"""Effects added at most."""


@dataclass(frozen=True)
class Bars:
    """Held-out nats in all that must be passed."""

    effect: float = BAR
    free: float = BAR
    """By a free curve."""


@dataclass(frozen=True)
class Step:
    """One effect added, and what stood beside it."""

    chosen: Candidate
    alike: tuple[Candidate, ...]
    ranking: tuple[Candidate, ...]
    fitted: Fit
    """On all find units."""
    p_value: float


@dataclass(frozen=True)
class Choice:
    """The effects added and the problem with them in place."""

    steps: tuple[Step, ...]
    problem: Problem
    last: tuple[Candidate, ...]
    """The candidates of the step that added nothing more."""
    bars: Bars = Bars()


def accepted(candidate: Candidate, bar: float = BAR) -> bool:
    """Whether a candidate passes the bar, and the units agree that it should; of an effect of single beams, also on
    what its beams' numbers gain over a smooth change along the rows."""
    return not smooth_is_enough(candidate) and candidate.total > bar and scenes_agree(candidate)


def scenes_agree(candidate: Candidate) -> bool:
    """Whether the units agree on its gain."""
    return candidate.chance <= LEVEL or candidate.sudden


def smooth_is_enough(candidate: Candidate) -> bool:
    """Whether an effect of single beams gains no more, for certain, than a smooth change along the rows."""
    if candidate.own is None:
        return False
    rough = clipped(candidate.own)
    return bool(rough.sum() <= BAR or p_value(rough) > LEVEL)


def worse(candidate: Candidate, best: Candidate) -> bool:
    """Whether the units say that `candidate` explains clearly less than `best`."""
    difference = clipped(best.by_unit - candidate.by_unit)
    if candidate.total < CLEARLY * best.total and difference.sum() > 0:
        return True
    return p_value(difference) <= ALIKE and difference.sum() > 2.0


def padded(candidate: Candidate, best: Candidate) -> bool:
    """Whether `candidate` has more numbers to fit and still gains no more: the simpler one says it all."""
    more = numbers(candidate) > numbers(best)
    return more and candidate.total <= best.total + 2.0


def numbers(candidate: Candidate) -> int:
    """How many numbers its fit chose."""
    return sum(np.size(value) for value in candidate.fits[0].z.values())


def choose(
    problem: Problem,
    effects: Iterable[Effect],
    *,
    bars: Bars = Bars(),
    most: int = MOST,
    say: Callable[[str], None] = lambda line: None,
) -> Choice:
    """Adds the best accepted effect, refits the null on top, and again, until none is accepted; then looks back."""
    steps: list[Step] = []
    null = problem
    left = list(effects)
    everyone = np.ones(len(problem.ev.unit), np.float32)
    while True:
        ranking = survey(problem, left)
        # A weak candidate is not the answer to a strong disagreement on which no candidate is accepted.
        least = CLEAR * ranking[0].total if ranking else 0.0
        good = [candidate for candidate in ranking if accepted(candidate, bars.effect) and candidate.total >= least]
        if not good or len(steps) == most:
            kept = look_back(null, steps, bars, say=say)
            problem = problem if len(kept) == len(steps) else with_steps(null, kept)
            return Choice(kept, problem, tuple(ranking), bars)
        best = good[0]
        alike = tuple(c for c in good[1:] if not worse(c, best) and not padded(c, best))
        values = tuple(to_values(best.effect, one.z) for one in best.fits)
        found = fit(best.effect, problem, everyone, starts=values, fixed=best.effect.name in FINEST)
        say(f"{best.effect.name}: {best.total:.0f} nats on scenes that its fit had not seen")
        steps.append(Step(best, alike, tuple(ranking), found, best.chance))
        added = on_top(best.effect, problem, found.z)
        problem, _ = fit_null(added.scan, added.ev, everyone, clutter=added.clutter)
        left = [effect for effect in left if effect.name != best.effect.name]


def look_back(
    null: Problem, steps: Sequence[Step], bars: Bars, *, say: Callable[[str], None] = lambda line: None
) -> tuple[Step, ...]:
    """The steps whose effects are still accepted once all others are in place: an early one may have stood in for two
    that came later."""
    kept = list(steps)
    for step in steps[:-1]:
        others = [other for other in kept if other is not step]
        [again] = survey(with_steps(null, others), [step.chosen.effect])
        if not accepted(again, bars.effect):
            say(f"{step.chosen.effect.name} is not needed beside the others: {again.total:.0f} nats")
            kept = others
    return tuple(kept)


def with_steps(null: Problem, steps: Sequence[Step]) -> Problem:
    """The null, refitted on top of the effects of `steps`."""
    problem = null
    for step in steps:
        problem = on_top(step.chosen.effect, problem, step.fitted.z)
    everyone = np.ones(len(problem.ev.unit), np.float32)
    return fit_null(problem.scan, problem.ev, everyone, clutter=problem.clutter)[0]
