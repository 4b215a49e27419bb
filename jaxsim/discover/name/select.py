"""Which effect is missing: forward selection over the catalogue, with a bar that a null must not pass.

A candidate counts by its held-out gain (`rank_effects`). It is accepted where the gain exceeds the bar and the scenes
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
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.steps import Step, worse
from jaxsim.discover.rules import RULES
from jaxsim.effects import Effect

Log = Callable[[str], None]
"""Where lines on the progress go."""


@dataclass(frozen=True)
class Bars:
    """Held-out nats in all that must be passed."""

    effect: float = RULES.bar_nats
    free: float = RULES.bar_nats
    """By a free curve."""


@dataclass(frozen=True)
class FittedStep(Step[Candidate]):
    """One effect added, fitted."""

    fitted: Fit
    """On all find scenes."""

    @property
    def p_value(self) -> float:
        """That the scenes agree so well on the chosen effect by chance."""
        return self.chosen.chance


@dataclass(frozen=True)
class Choice:
    """The effects added and the problem with them in place."""

    steps: tuple[FittedStep, ...]
    problem: Problem
    last: tuple[Candidate, ...]
    """The candidates of the step that added nothing more."""
    bars: Bars = Bars()

    @property
    def first_ranking(self) -> tuple[Candidate, ...]:
        """All candidates of the first step, best first."""
        return self.steps[0].ranking if self.steps else self.last


def padded(candidate: Candidate, best: Candidate) -> bool:
    """Whether `candidate` has more numbers to fit and still gains no more: the simpler one says it all."""
    return candidate.numbers > best.numbers and candidate.total <= best.total + RULES.alike_nats


def choose(
    problem: Problem,
    effects: Iterable[Effect],
    *,
    bars: Bars = Bars(),
    most: int = RULES.most_effects,
    log: Log = lambda line: None,
) -> Choice:
    """Adds the best accepted effect, refits the null on top, and again, until none is accepted; then looks back."""
    steps: list[FittedStep] = []
    null = problem
    rest = list(effects)
    all_blocks = np.ones(len(problem.ev.unit), np.float32)
    while True:
        ranking = rank_effects(problem, rest)
        # A weak candidate is not the answer to a strong disagreement on which no candidate is accepted.
        least = RULES.weak_share * ranking[0].total if ranking else 0.0
        good = [candidate for candidate in ranking if candidate.accepted(bars.effect) and candidate.total >= least]
        if not good or len(steps) == most:
            needed = look_back(null, steps, bars, log=log)
            problem = problem if len(needed) == len(steps) else with_steps(null, needed)
            return Choice(needed, problem, tuple(ranking), bars)
        best = good[0]
        alike = tuple(c for c in good[1:] if not worse(c, best) and not padded(c, best))
        starts = tuple(to_values(best.effect, one.z) for one in best.fits)
        result = fit(best.effect, problem, all_blocks, starts=starts, fixed=best.effect.name in FINEST)
        log(f"{best.effect.name}: {best.total:.0f} nats on scenes that its fit had not seen")
        steps.append(FittedStep(best, alike, tuple(ranking), result))
        added = on_top(best.effect, problem, result.z)
        problem, _ = fit_null(added.scan, added.ev, all_blocks, clutter=added.clutter)
        rest = [effect for effect in rest if effect.name != best.effect.name]


def look_back(
    null: Problem, steps: Sequence[FittedStep], bars: Bars, *, log: Log = lambda line: None
) -> tuple[FittedStep, ...]:
    """The steps whose effects are still accepted once all others are in place: an early one may have stood in for two
    that came later."""
    needed = list(steps)
    for step in steps[:-1]:
        others = [other for other in needed if other is not step]
        [again] = rank_effects(with_steps(null, others), [step.chosen.effect])
        if not again.accepted(bars.effect):
            log(f"{step.chosen.effect.name} is not needed beside the others: {again.total:.0f} nats")
            needed = others
    return tuple(needed)


def with_steps(null: Problem, steps: Sequence[FittedStep]) -> Problem:
    """The null, refitted on top of the effects of `steps`."""
    problem = null
    for step in steps:
        problem = on_top(step.chosen.effect, problem, step.fitted.z)
    all_blocks = np.ones(len(problem.ev.unit), np.float32)
    return fit_null(problem.scan, problem.ev, all_blocks, clutter=problem.clutter)[0]
