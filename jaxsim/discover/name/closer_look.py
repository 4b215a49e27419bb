"""A closer look, at more columns of the same frames, where the first look names no law and leaves effects undecided.

Fits look at a few columns of each frame (`cast.RAYS`), which is enough for what is clear. What gains a few nats there
may be chance, or a small effect: other columns see other surfaces, each with a reflectance of its own, so that three
times the columns tell nearly three times as much. So candidates that are left with some hope are asked once more; the
rest of the catalogue is not, for it gained next to nothing.

With more rays, small errors of the model count for more as well. So an effect that the closer look names is believed
where nothing else is left over of its channels there. And beside what the first look names none is looked for: no law
is the catalogue's to the last nat, and what it leaves would have a name of its own. A lattice of readings is no such
law: it is read off, and leaves nothing, so that effects beside it are asked as they would be alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise_levels import FINEST
from jaxsim.discover.name.answer import Answer
from jaxsim.discover.name.candidates import Candidate, rank_effects
from jaxsim.discover.name.other_sides import goes_by_steps
from jaxsim.discover.rules import RULES
from jaxsim.effects import Effect, Law


def undecided(answer: Answer) -> tuple[str, ...]:
    """Names of the candidates that a closer look shall ask, best first; none where none has hope, or where any but
    lattices was chosen. Those that were refused stay so; and beams that point elsewhere by a hundredth of a degree do
    at depth steps what looks like an effect of these, the more clearly the more rays there are."""
    if laws_named(answer):
        return ()
    refused = answer.choice.refused
    left = [c for c in answer.choice.last if c.effect.name not in refused and not goes_by_steps(c.effect)]
    left = [c for c in left if hope(c) > 0]
    left.sort(key=hope, reverse=True)
    # What looks alike may gain next to nothing beside it as yet, and is asked with it.
    hopeful = left and hope(left[0]) > RULES.closer_nats
    return tuple(c.effect.name for c in left[: RULES.closer_most]) if hopeful else ()


def hope(candidate: Candidate) -> float:
    """What a candidate gains by what is its own, nats."""
    return min(candidate.total, candidate.rough_nats)


def fulfilled(effects: Sequence[Effect], null: Problem, *, bar: float) -> bool:
    """Whether any of the effects is accepted on the closer look's null: all else that naming asks takes far longer."""
    return any(candidate.accepted(bar) for candidate in rank_effects(null, effects, bar=bar))


def believed(closer: Answer, first: Answer) -> bool:
    """Whether a closer look names effects, leaves nothing over of their channels, and loses nothing that was named."""
    named = laws_named(closer)
    left_over = closer.curve[0].channel if closer.curve else None
    whole = lattices_of(first) <= lattices_of(closer)
    return whole and bool(named) and all(left_over not in effect.channels for effect in named)


def laws_named(answer: Answer) -> list[Law]:
    """The effects that are named, but lattices."""
    return [step.chosen.effect for step in answer.choice.steps if step.chosen.effect.name not in FINEST]


def lattices_of(answer: Answer) -> set[str]:
    """The lattices that are named."""
    return {step.chosen.effect.name for step in answer.choice.steps} & FINEST.keys()


def told_whole(closer: Answer, first: Answer) -> Answer:
    """The closer answer with what only the first look asked in its first ranking, and with what that refused."""
    choice = closer.choice
    asked = {candidate.effect.name for candidate in choice.first_ranking}
    others = [candidate for candidate in first.choice.first_ranking if candidate.effect.name not in asked]
    ranking = sorted((*choice.first_ranking, *others), key=lambda candidate: -candidate.total)
    steps = (replace(choice.steps[0], ranking=tuple(ranking)), *choice.steps[1:])
    choice = replace(
        choice,
        steps=steps,
        refused={**first.choice.refused, **choice.refused},
        needless=(*first.choice.needless, *choice.needless),
    )
    return replace(closer, choice=choice, elsewhere=tuple(dict.fromkeys((*first.elsewhere, *closer.elsewhere))))
