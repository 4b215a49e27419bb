"""Name: which of the three answers it is, and for which effects: named, none, or not in the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from jaxsim.discover.find.covariates import Dependence, parts_of, spelled
from jaxsim.discover.find.dependences import dependences_of
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.doubts import (
    BY_MATERIAL,
    DENIED,
    NO_DOUBTS,
    OUTDONE,
    SHOWN_BY,
    SHOWN_ELSEWHERE,
    Doubts,
    goes_by,
)
from jaxsim.discover.name.null_draws import draw_nulls
from jaxsim.discover.name.other_sides import CONTROL
from jaxsim.discover.name.select import Bars, Choice, FittedStep, add_steps, choose, step_along, with_steps
from jaxsim.discover.name.unexplained import agreed, curve_numbers, describe_curve, free_curves
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.verdict import NullDraws, Unexplained
from jaxsim.effects import Effect, Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.progress import Log

Along = tuple[str, str]
"""A free curve's channel and covariate."""

FreeCurve = tuple[Dependence, Candidate]
"""A free curve, and along what it runs."""
Beside = Callable[[FreeCurve, Sequence[Law], float], Sequence[Candidate]]
"""What effects still gain with the law of a free curve in place, ranked with a bar."""


@dataclass(frozen=True)
class Answer:
    """What naming says."""

    verdict: str
    """named, none or not_in_catalogue."""
    choice: Choice
    unexplained: Unexplained | None
    """What a free curve still finds."""
    nulls: NullDraws | None = None
    """Where the bar was set on nulls of these very data."""
    curve: FreeCurve | None = None
    """The free curve behind `unexplained`, fitted on top of what is chosen."""
    unasked: tuple[Along, ...] = ()
    """Free curves that are not asked: those that nobody should ask of these sides, and those that are found on
    other sides as well."""
    elsewhere: tuple[tuple[str, str], ...] = ()
    """All that was found, and is not said for one of SHOWN_ELSEWHERE, in words, and why."""
    unconfirmed: tuple[str, ...] = ()
    """Free curves that scenes to which they were not fitted do not gain by, in words."""

    def refused_for(self, reason: str) -> tuple[str, ...]:
        """The effects that were found, and are not said for this one of `doubts`."""
        return tuple(name for name, why in self.choice.refused.items() if why == reason)

    @property
    def denied(self) -> tuple[tuple[str, str], ...]:
        """The effects that were found, and are not said for what classes show of them alone, and why."""
        of_classes = (DENIED, SHOWN_BY, OUTDONE)
        return tuple((name, why) for name, why in self.choice.refused.items() if why.startswith(of_classes))


def name_effects(
    null: Problem,
    catalogue: Sequence[Effect],
    dependences: Sequence[Dependence],
    *,
    nulls: int = 0,
    without: Sequence[str] = (),
    unasked: Sequence[Along] = (),
    doubts: Doubts = NO_DOUBTS,
    beside: Beside = lambda curve, effects, bar: (),
    log: Log = lambda line: None,
) -> Answer:
    """Chooses effects of the catalogue one after another, then asks whether free curves along `dependences`, the null's
    dependences, say more.

    With `nulls` the bar is set on so many measurements in which nothing is missing, drawn from what the first choice
    left unexplained; the choice is made again where that raises it. No free curve is asked of the channels `without`,
    and none of `unasked`.
    What was found and `doubts` speak against is not said. `beside` tells what effects say beside a free curve's law.
    """

    def refuse(step: FittedStep, beside: Problem) -> str:
        why = doubts.against(step, beside, null=null)
        if why:
            log(f"{step.chosen.effect.name}: {step.chosen.total:.0f} nats, not said: {why}")
        return why

    choice = choose(null, catalogue, refuse=refuse, log=log)
    drawn = None
    if nulls:
        drawn = draw_nulls(null, choice.problem, catalogue, count=nulls, log=log)
        scenes = len(np.unique(null.ev.scene))
        # Nulls give their bars a scene; a choice sums over scenes.
        bars = Bars(drawn.bar * scenes, drawn.free_bar * scenes)
        log(f"the bar of these data: {bars.effect:.1f} nats, of free curves {bars.free:.1f}")
        raised = bars.effect > RULES.bar_nats
        choice = choose(null, catalogue, bars=bars, refuse=refuse, log=log) if raised else replace(choice, bars=bars)
    passed: list[tuple[Along, str]] = []
    decided = partial(decide, null, dependences=dependences, without=without, beside=beside)
    answer = decided(choice, but=unasked)
    # A weak effect is no answer beside a strong one that the scenes dispute; nor is a curve that says no more.
    step = step_along(choice, answer.curve[0].channel, answer.curve[0].covariate) if answer.curve else None
    if step and not refuse(step, null):
        log(f"{step.chosen.effect.name}: {step.chosen.total:.0f} nats, beside a free curve along what it goes by")
        choice = add_steps(null, catalogue, (step,), bars=choice.bars, refuse=refuse, log=log)
        answer = decided(choice, but=unasked)
    # The strongest may be found elsewhere and the next one not: curves are struck off one by one.
    while answer.curve and (why := doubts.against_curve(*answer.curve, answer.choice.problem)):
        passed.append(((answer.curve[0].channel, answer.curve[0].covariate), why))
        log(f"{curve_in_words(passed[-1][0])}, not said: {why}")
        # Effects that say less than what the simulator lacks by itself are part of that.
        choice = answer.choice if why == CONTROL else choice
        answer = decided(choice, but=(*unasked, *(along for along, _ in passed)))
    effects = [(name, why) for name, why in choice.refused.items() if why in SHOWN_ELSEWHERE]
    return replace(
        answer,
        nulls=drawn,
        unasked=(*unasked, *(along for along, _ in passed)),
        elsewhere=(*effects, *((curve_in_words(along), why) for along, why in passed)),
    )


def without_curve(answer: Answer) -> Answer:
    """The answer without its free curve, which is not confirmed: what is named stays, and beside it there is none."""
    if answer.curve is None:
        return answer
    along = answer.curve[0].channel, answer.curve[0].covariate
    return replace(
        answer,
        verdict="named" if answer.choice.steps else "none",
        unexplained=None,
        curve=None,
        unconfirmed=(*answer.unconfirmed, curve_in_words(along)),
    )


def curve_in_words(along: Along) -> str:
    """A channel and the covariate that its curve runs along, as reports say it."""
    return f"{along[0]} along {spelled(along[1])}"


def decide(
    null: Problem,
    choice: Choice,
    dependences: Sequence[Dependence],
    *,
    without: Sequence[str] = (),
    but: Sequence[Along] = (),
    beside: Beside = lambda curve, effects, bar: (),
) -> Answer:
    """The answer, what is named in it, and what a free curve still finds.

    Where a free curve explains clearly more of its channel than the effects that were chosen for it, these are not
    named: what is there is not in the catalogue. Effects of other channels stay, and so do those that the curve says
    nothing of (`untouched`), and a lattice, which was read off the readings and is there whatever else is. Curves of
    the channels `without`, and those of `but`, are not asked.
    """
    free = without_unasked(free_curves(null, dependences, without, bar=choice.bars.free), but)
    curves = [(along, curve) for along, curve in free if agreed(curve, choice.bars.free)]
    outside, more = None, False
    if curves:
        more = outdone(choice, *curves[0], numbers=curve_numbers(null, curves[0][0]))
        outside = curves[0] if more or pieced(choice, curves[0], beside) else None
    if outside:
        # Pieces of a curve were asked already, and have nothing to say beside it.
        own = untouched(choice, outside, beside) if more else []
        steps = tuple(step for step in choice.steps if step in own or stands(step, outside[0].channel))
        if not steps:
            # With nothing left that is named, the problem is the null as it was.
            nothing = Choice((), choice.first_ranking, null, choice.bars, choice.refused)
            return Answer("not_in_catalogue", nothing, describe_curve(null, *outside), curve=outside)
        if len(steps) < len(choice.steps):
            choice = replace(choice, steps=steps, problem=with_steps(null, steps))
    if not choice.steps:
        return Answer("none", choice, None)
    return named_answer(choice, without=without, but=but)


def untouched(choice: Choice, curve: FreeCurve, beside: Beside) -> list[FittedStep]:
    """The effects of a curve's channel that have nothing to do with it: they do not go by its covariate, nor by what
    materials differ by, and gain with its law in place most of what they did."""
    dependence, _ = curve
    others = {
        step.chosen.effect.name: step
        for step in choice.steps
        if dependence.channel in step.chosen.effect.channels
        and {*parts_of(dependence.covariate)}.isdisjoint(step.chosen.effect.covariates)
        and not goes_by(step.chosen.effect, BY_MATERIAL)
        and step.chosen.effect.name not in FINEST
    }
    if not others:
        return []
    bar = choice.bars.effect
    again = beside(curve, [step.chosen.effect for step in others.values()], bar)
    of_name = [(candidate, others[candidate.effect.name]) for candidate in again]
    return [
        step
        for candidate, step in of_name
        if candidate.accepted(bar) and candidate.total >= RULES.weak_share * step.chosen.total
    ]


def pieced(choice: Choice, curve: FreeCurve, beside: Beside) -> bool:
    """Whether several effects of a channel piece together what a free curve says alone: with its law in place none of
    them is accepted any more."""
    dependence, fit = curve
    of_channel = [step.chosen.effect for step in choice.steps if dependence.channel in step.chosen.effect.channels]
    pieces = [effect for effect in of_channel if effect.name not in FINEST]
    # To fit the law costs seconds: not where the curve says little of what they do.
    much = fit.total >= RULES.weak_share * sum(step.chosen.total for step in choice.steps)
    if len(pieces) < RULES.curve_pieces or not much:
        return False
    bar = choice.bars.effect
    return not any(candidate.accepted(bar) for candidate in beside(curve, pieces, bar))


def without_unasked(curves: Sequence[FreeCurve], but: Sequence[Along]) -> list[FreeCurve]:
    """The curves less those that are not to be asked."""
    return [(along, curve) for along, curve in curves if (along.channel, along.covariate) not in but]


def stands(step: FittedStep, channel: str) -> bool:
    """Whether an effect stays named where a free curve explains more of a channel: one that leaves the channel alone,
    or says most of what it says in others."""
    effect, gain = step.chosen.effect, step.chosen.gain
    elsewhere = clipped(np.delete(gain, CHANNELS.index(channel), axis=1).sum(1)).sum()
    mostly = bool(elsewhere > max(RULES.bar_nats, RULES.weak_share * step.chosen.total))
    return channel not in effect.channels or mostly or effect.name in FINEST


def named_answer(choice: Choice, *, without: Sequence[str] = (), but: Sequence[Along] = ()) -> Answer:
    """What is chosen, and what a free curve still finds beside it, of other channels than those `without`, and none of
    `but`."""
    after = dependences_of(choice.problem)
    # What effects explain is gone from these residuals, so that a curve here is none of them.
    free = without_unasked(free_curves(choice.problem, after, without, bar=choice.bars.free), but)
    rest = [(along, curve) for along, curve in free if agreed(curve, choice.bars.free)]
    if not rest:
        return Answer("named", choice, None)
    return Answer("named", choice, describe_curve(choice.problem, *rest[0]), curve=rest[0])


def outdone(choice: Choice, dependence: Dependence, curve: Candidate, *, numbers: int) -> bool:
    """Whether a free curve of so many numbers gains clearly more in its own channel (an effect may show in others
    besides) than the effects that were chosen. What a lattice of readings gains does not count: it is no dependence on
    anything."""
    k = CHANNELS.index(dependence.channel)
    free = curve.gain[:, k]
    steps = [step for step in choice.steps if step.chosen.effect.name not in FINEST]
    named = sum((step.chosen.gain[:, k] for step in steps), np.zeros(len(free)))
    simpler = numbers < RULES.curve_simpler * sum(step.chosen.numbers for step in steps)
    least = (1.0 if simpler else RULES.curve_factor) * max(clipped(named).sum(), 0.0) + RULES.curve_margin_nats
    much = clipped(free).sum() > least
    return bool(much and (not steps or p_value(clipped(free - named)) <= RULES.alike_level))
