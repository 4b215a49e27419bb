"""Which effect is missing: forward selection over the catalogue, with a bar that a null must not pass.

A candidate counts by its held-out gain (`rank_effects`). It is accepted where the gain exceeds the bar and the scenes
agree on its sign; the set of look-alikes is whatever accepted candidate is not clearly worse than the best. What does
not ask how a candidate was fitted (`Step`, `Selection`, `worse`, `runner_up`) also serves where the streets differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.fit import Fit, Problem, fit, in_place
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.model.null_model import refit, refitted
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.effects import Effect, Law
from jaxsim.progress import Log


@runtime_checkable
class Ranked(Protocol):
    """A candidate as a ranking sees it."""

    @property
    def effect(self) -> Any: ...

    @property
    def chance(self) -> float:
        """Probability that scenes agree so well by chance."""
        ...

    @property
    def by_scene(self) -> Float[np.ndarray, " s"]:
        """Gain on held-out scenes, nats."""
        ...

    @property
    def total(self) -> float:
        """Gain of all scenes, none of which decides alone, nats."""
        ...


C = TypeVar("C", bound=Ranked)


@dataclass(frozen=True)
class Step(Generic[C]):
    """One effect added, and what stood beside it."""

    chosen: C
    alike: tuple[C, ...]
    """Candidates that are not clearly worse."""
    ranking: tuple[C, ...]
    """All candidates, best first."""


@dataclass(frozen=True)
class Selection(Generic[C]):
    """The effects added."""

    steps: tuple[Step[C], ...]
    last: tuple[C, ...]
    """The candidates of the step that added nothing more."""

    @property
    def first_ranking(self) -> tuple[C, ...]:
        """All candidates of the first step, best first."""
        return self.steps[0].ranking if self.steps else self.last


def worse(candidate: Ranked, best: Ranked, *, share: float = RULES.alike_share, nats: float = RULES.alike_nats) -> bool:
    """Whether the scenes say that `candidate` explains clearly less than `best`: less than `share` of what it does, or
    by more than `nats` on which they agree."""
    difference = clipped(best.by_scene - candidate.by_scene)
    if candidate.total < share * best.total and difference.sum() > 0:
        return True
    return bool(p_value(difference) <= RULES.alike_level and difference.sum() > nats)


def runner_up(steps: Sequence[Step[C]]) -> C | None:
    """The best candidate of the first step that is nowhere named and no look-alike of what is."""
    if not steps:
        return None
    # A look-alike would close the gap as the named effect does, and be no placebo for it.
    taken = {candidate.effect.plain_name for step in steps for candidate in (step.chosen, *step.alike)}
    return next((candidate for candidate in steps[0].ranking if candidate.effect.name not in taken), None)


@dataclass(frozen=True)
class Bars:
    """Held-out nats in all that must be passed."""

    effect: float = RULES.bar_nats
    free: float = RULES.bar_nats
    """The bar of a free curve."""


@dataclass(frozen=True)
class FittedStep(Step[Candidate]):
    """One effect added, fitted."""

    fit: Fit
    """Its fit to all find scenes."""

    @property
    def placed(self) -> tuple[Law, dict[str, Any]]:
        """The effect and its z, to be put in place."""
        return self.chosen.effect, self.fit.z


@dataclass(frozen=True)
class Choice(Selection[Candidate]):
    """The effects added and the problem with them in place."""

    steps: tuple[FittedStep, ...]
    problem: Problem
    bars: Bars = Bars()
    refused: Mapping[str, str] = field(default_factory=dict)
    """Why accepted effects were refused, by name."""
    needless: tuple[str, ...] = ()
    """Names of effects that were added and taken back, as what came after them explains what they did."""


Refuse = Callable[[FittedStep, Problem], str]
"""Why an effect that would be added to a problem is none after all; empty where it is one."""


def too_rich(candidate: Candidate, best: Candidate) -> bool:
    """Whether `candidate` has more numbers to fit and still gains no more: the simpler one says it all."""
    return candidate.numbers > best.numbers and candidate.total <= best.total + RULES.alike_nats


def much_richer(candidate: Candidate, best: Candidate) -> bool:
    """Whether `candidate` is no other explanation: with many more numbers a law says what any other does. One number
    more is the form of another law (rain that thins out with some power, beside fog)."""
    return too_rich(candidate, best) and candidate.numbers > best.numbers + 1


def choose(
    problem: Problem,
    effects: Iterable[Effect],
    *,
    bars: Bars = Bars(),
    refuse: Refuse | None = None,
    log: Log = lambda line: None,
) -> Choice:
    """Adds the best accepted effect, refits all on top, and again, until none is accepted; then looks back.

    The first may have stood in for two that act together (a number a class for losses at random and a longest range),
    and what comes after it then only mends it. So where a simpler candidate gained nearly as much, a second choice
    begins with that, and holds where it says as much with fewer numbers. Of accepted effects those are left out that
    `refuse` says.
    """
    catalogue = list(effects)
    ranking = rank_effects(problem, catalogue)
    first = add_steps(problem, catalogue, (), ranking=ranking, bars=bars, refuse=refuse, log=log)
    choice = second_choice(problem, catalogue, first, bars=bars, refuse=refuse, log=log)
    # The first ranking is told whole, with what was added and taken back.
    of_first = tuple(replace(step, ranking=tuple(ranking)) for step in choice.steps[:1])
    return replace(choice, steps=(*of_first, *choice.steps[1:]))


def second_choice(
    problem: Problem, catalogue: Sequence[Effect], first: Choice, *, bars: Bars, refuse: Refuse | None, log: Log
) -> Choice:
    """The choice that begins with a simpler candidate, where there is one and it says as much; else the first."""
    begun = simpler_beginning(first)
    if begun is None:
        return first
    step, rival = begun
    log(f"{rival.effect.name} is simpler than {first.steps[step].chosen.effect.name}: once more, beginning with it")
    earlier = first.steps[:step]
    with_others = with_steps(problem, earlier) if earlier else problem
    ranking = first.steps[step].ranking
    # What gained more only stood in for several, or the second choice will not hold.
    instead = fitted_step(with_others, rival, ranking=ranking, among=ranking)
    if refuse and refuse(instead, with_others):
        return first
    second = add_steps(problem, catalogue, (*earlier, instead), bars=bars, refuse=refuse, log=log)
    if not says_as_much(second, first):
        return first
    # What the first choice took back led to the second, and is told of it, too.
    return replace(second, needless=(*first.needless, *second.needless))


def simpler_beginning(choice: Choice) -> tuple[int, Candidate] | None:
    """The earliest step of a choice of several in which an accepted candidate of the same channels with fewer numbers
    gained nearly as much (`Rules.nearly_share`), and that candidate, the best of such; None where there is none."""
    if len(choice.steps) < 2:
        return None
    named = {step.chosen.effect.name for step in choice.steps}
    for k, step in enumerate(choice.steps[:-1]):
        best = step.chosen
        for one in step.ranking:
            near = one.total >= RULES.nearly_share * best.total and one.accepted(choice.bars.effect)
            simpler = one.numbers < best.numbers and one.effect.channels == best.effect.channels
            if near and simpler and one.effect.name not in named:
                return k, one
    return None


def says_as_much(second: Choice, first: Choice) -> bool:
    """Whether a choice gains no less than another, with fewer numbers."""
    gained = [sum(step.chosen.total for step in choice.steps) for choice in (second, first)]
    numbers = [sum(step.chosen.numbers for step in choice.steps) for choice in (second, first)]
    return numbers[0] < numbers[1] and gained[0] > gained[1] - RULES.alike_nats


def add_steps(
    null: Problem,
    catalogue: Sequence[Effect],
    begun: Sequence[FittedStep],
    *,
    ranking: Sequence[Candidate] | None = None,
    bars: Bars,
    refuse: Refuse | None,
    log: Log,
) -> Choice:
    """Effects added one after the other to those of `begun`, until none is accepted; `ranking` is that of the
    candidates beside `begun`, where it is known.

    Where one of them is not needed in the end, what came after it was chosen for what it had left over: all from there
    on is chosen once more without it.
    """
    steps = list(begun)
    problem = with_steps(null, steps) if steps else null
    refused: dict[str, str] = {}
    while True:
        done = {*refused, *(step.chosen.effect.name for step in steps)}
        if ranking is None:
            ranking = rank_effects(problem, [e for e in catalogue if e.name not in done], bar=bars.effect)
        step = None if len(steps) == RULES.most_effects else first_step(problem, ranking, bars)
        # What is refused once stays out: the next best may be another matter altogether.
        while step and refuse and (why := refuse(step, problem)):
            refused[step.chosen.effect.name] = why
            step = first_step(problem, [c for c in ranking if c.effect.name not in refused], bars)
        if step is None:
            k = needless(null, steps, bars, log=log)
            if k is None:
                return Choice(tuple(steps), tuple(ranking), problem, bars, refused)
            gone, rest = steps[k], [e for e in catalogue if e.name != steps[k].chosen.effect.name]
            # Beside nothing the ranking is as it was; else what stands before was fitted beside what is gone.
            known = [candidate for candidate in gone.ranking if candidate is not gone.chosen] if k == 0 else None
            before = together(null, steps[:k]) if k else []
            choice = add_steps(null, rest, before, ranking=known, bars=bars, refuse=refuse, log=log)
            return replace(choice, needless=(gone.chosen.effect.name, *choice.needless))
        log(f"{step.chosen.effect.name}: {step.chosen.total:.0f} nats on scenes that its fit had not seen")
        steps.append(replace(step, ranking=tuple(ranking)))
        if len(steps) > 1:
            steps = together(null, steps)
        # Nuisances stood in for the effect as far as they could: they are fitted again before the next is asked.
        problem, ranking = with_steps(null, steps), None


def first_step(problem: Problem, ranking: Sequence[Candidate], bars: Bars) -> FittedStep | None:
    """The best accepted candidate, or a simpler one that gains as much, fitted; None where none is accepted, or those
    that are are weak."""
    # A weak candidate is not the answer to a strong disagreement on which no candidate is accepted.
    least = RULES.weak_share * ranking[0].total if ranking else 0.0
    good = [candidate for candidate in ranking if candidate.accepted(bars.effect) and candidate.total >= least]
    return fitted_step(problem, simplest(good), ranking=ranking, among=ranking) if good else None


def step_along(choice: Choice, channel: str, covariate: str) -> FittedStep | None:
    """Where nothing is chosen: the best accepted candidate that goes by a covariate in a channel, however much more
    another gains on which the scenes disagree. What a free curve along it says is no stronger answer."""
    likely = [c for c in choice.first_ranking if c.effect.name not in choice.refused]
    along = [c for c in likely if channel in c.effect.channels and covariate in c.effect.covariates]
    good = [c for c in along if c.accepted(choice.bars.effect)]
    if choice.steps or not good:
        return None
    return fitted_step(choice.problem, simplest(good), ranking=choice.first_ranking, among=along)


def simplest(good: Sequence[Candidate]) -> Candidate:
    """The best candidate, or the one with the fewest numbers of those of its channels that gain as much."""
    best = good[0]
    as_good = [c for c in good if too_rich(best, c) and c.effect.channels == best.effect.channels]
    return min(as_good, key=lambda c: c.numbers, default=best)


def fitted_step(
    problem: Problem, best: Candidate, *, ranking: Sequence[Candidate], among: Sequence[Candidate]
) -> FittedStep:
    """A candidate fitted to all find scenes, and its look-alikes `among` those that gain no more, in a channel of its
    own: what others show is something else."""
    own = {*best.effect.channels}
    others = [candidate for candidate in among if candidate is not best and own & {*candidate.effect.channels}]
    # The bar says whether anything is there at all: a look-alike may lie below it where the best hardly passes.
    agreed = [candidate for candidate in others if candidate.accepted(0.0)]
    no_better = [candidate for candidate in agreed if candidate.total <= best.total]
    alike = tuple(c for c in no_better if not worse(c, best) and not much_richer(c, best))
    # The fits of the folds lie near that to all scenes: it need not search the catalogue's starts again.
    result = fit(best.effect, problem, starts=best.fitted_values, fixed=best.effect.name in FINEST)
    return FittedStep(best, alike, tuple(ranking), result)


def needless(null: Problem, steps: Sequence[FittedStep], bars: Bars, *, log: Log = lambda line: None) -> int | None:
    """The first of the steps whose effect is no longer accepted once all others are in place: it stood in for what
    came later. None where all are needed."""
    # The last was accepted with all others in place, fitted beside one another.
    for k, step in enumerate(steps[:-1]):
        rest = [other for other in steps if other is not step]
        [again] = rank_effects(with_steps(null, together(null, rest)), [step.chosen.effect])
        # What gains most of what it did is no stand-in, though its scenes may agree a little less beside others.
        if not again.accepted(bars.effect) and again.total < RULES.weak_share * step.chosen.total:
            log(f"{step.chosen.effect.name} is not needed beside the others: {again.total:.0f} nats")
            return k
    return None


def together(null: Problem, steps: Sequence[FittedStep]) -> list[FittedStep]:
    """The steps with their effects fitted beside one another: what the first took up that is the next one's would
    else be left for a third to mend."""
    again = refit(null, [step.chosen.effect for step in steps], [step.fit.z for step in steps])
    return [replace(step, fit=one.fit) for step, one in zip(steps, again, strict=True)]


def with_steps(null: Problem, steps: Sequence[FittedStep]) -> Problem:
    """The null, refitted on top of the effects of `steps`."""
    return refitted(in_place(null, [step.placed for step in steps]))
