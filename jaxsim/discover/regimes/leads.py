"""Regions worth looking at: what divides an effect that is named, or candidates of which none is, and how sure that is.

of_named       every named effect, by its cells
of_candidates  where nothing is named, or what is may stand in for another in a part: all candidates at once, by what
               scenes say of their directions; and the strongest by their cells
ranked         all of them by q-values
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxsim.discover.model.fit import Fit, Problem
from jaxsim.discover.name.candidates import Candidate
from jaxsim.discover.name.select import Choice, with_steps
from jaxsim.discover.regimes.cells import cells_of
from jaxsim.discover.regimes.chance import FoundRegion, best_region, disputed, scenes_by_size
from jaxsim.discover.regimes.questions import Facts, Question
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import false_discovery_rates
from jaxsim.effects import Law


@dataclass(frozen=True)
class Lead:
    """A region to look at: of an effect that is named, or of candidates of which none is."""

    finding: FoundRegion
    candidates: tuple[Candidate, ...]
    """The effect first, then all others that were asked about, the strongest first."""
    step: int | None
    """The choice's step that it is, or takes the place of; None where nothing is named."""
    fit: Fit | None = None
    """The effect everywhere, where it was asked about by its cells."""
    named: bool = False
    """Whether the effect is that of the step."""
    exists: bool = True
    """Whether there is an effect at all, which naming has shown of those that it names."""
    q_value: float = 1.0


def of_named(null: Problem, choice: Choice, *, facts: Facts, asked: Sequence[Question]) -> list[Lead]:
    """What divides every named effect."""
    leads: list[Lead] = []
    for k, step in enumerate(choice.steps):
        effect = step.chosen.effect
        if effect.of_recording:
            continue
        rest = [c for c in step.ranking if c.effect is not effect and c.effect.name not in choice.refused]
        for division in _divisions(
            effect, step.fit, without_step(null, choice, k), facts=facts, asked=asked, facts_asked=asked
        ):
            leads.append(Lead(division, (step.chosen, *rest), k, step.fit, named=True))
    return leads


def of_candidates(null: Problem, choice: Choice, *, facts: Facts, asked: Sequence[Question]) -> list[Lead]:
    """Where nothing is named, or one effect that nothing divides and that may stand in for another in a part: what
    divides the scenes of any candidate; and, where nothing is named, the sectors of the strongest, and of all that only
    the scenes' dispute kept from being named these scenes and the sectors."""
    # What noise of both sides does, it does in every part.
    possible = [candidate for candidate in choice.first_ranking if candidate.effect.name not in choice.refused]
    tried = [candidate for candidate in possible if not candidate.effect.of_recording]
    if len(choice.steps) > 1 or not tried:
        return []
    step = 0 if choice.steps else None
    disputes = disputed(tried, asked, facts)
    leads = [Lead(found.finding, found.candidates, step, exists=found.exists) for found in disputes]
    if choice.steps:
        return leads
    # Beams that change smoothly along the rows are not what is missing, nor what would be divided. Whether scenes agree
    # that they do not is no question where they may dispute it.
    likely = [candidate for candidate in tried if candidate.rough_nats > RULES.bar_nats] or tried
    arcs = [question for question in asked if question.between_scenes(facts.scene) is None]
    for k, candidate in enumerate(likely[: 1 + RULES.regime_rivals]):
        # The strongest may stand in for another in a part, and scenes' disputes make any of them look weak; what they
        # do not show at all they do not dispute. What all of them show in an arc alone may be weak in the whole.
        shown = not k or candidate.total > choice.bars.effect
        result = candidate.fits[0]
        for division in _divisions(candidate.effect, result, null, facts=facts, asked=arcs, facts_asked=asked):
            # What divides whole scenes may be anything that they differ in; all have a part of a sector, or of a moment
            # of their one drive.
            of_scenes = division.question.between_scenes(facts.scene) is not None
            if of_scenes and not shown:
                continue
            exists = not of_scenes or candidate.total > choice.bars.effect
            others = [other for other in (tried if of_scenes else likely) if other is not candidate]
            leads.append(Lead(division, (candidate, *others), None, result, exists=exists))
    return leads


def ranked(leads: list[Lead]) -> list[Lead]:
    """The leads with q-values over all of them, least probable by chance first; what divides drives by a fact before
    what divides them by their readings alone."""
    rates = false_discovery_rates(np.array([lead.finding.p_value for lead in leads]))
    rated = [replace(lead, q_value=float(q)) for lead, q in zip(leads, rates, strict=True)]
    return sorted(rated, key=lambda lead: (lead.finding.question.divides == "scene", lead.finding.p_value))


def rivals(lead: Lead, problem: Problem, facts: Facts) -> tuple[Candidate, ...]:
    """The candidates that may be the better name in a region: the strongest of a sector; of whole scenes those that
    gain most there on the way to their fits, forwards or back. What some drives have may be nothing to all of them
    together, or its opposite to a fold."""
    others, question = lead.candidates[1:], lead.finding.question
    if question.between_scenes(facts.scene) is not None:
        inside = question.inside[lead.finding.k]

        def gain(candidate: Candidate) -> float:
            of = cells_of(candidate.effect, problem, candidate.fits[0], sector=facts.sector, sectors=facts.sectors)
            curvature = (of.curvature * inside).sum()
            at_none = (of.slope * inside).sum() + curvature
            return float(at_none**2 / curvature)

        others = sorted(others, key=gain, reverse=True)
    return tuple(others[: RULES.regime_rivals])


def _divisions(
    effect: Law,
    result: Fit,
    problem: Problem,
    *,
    facts: Facts,
    asked: Sequence[Question],
    facts_asked: Sequence[Question],
) -> list[FoundRegion]:
    """What divides an effect that was fitted on top of `problem`: the best region of every question, and scenes by
    their own sizes; these by what frames say of them (`facts_asked`), where that is the same."""
    # Even and odd columns apart: noise does not agree between them, what a scene shows does.
    halves = 2 * facts.sector + np.arange(facts.sector.shape[1]) % 2
    both = cells_of(effect, problem, result, sector=halves, sectors=2 * facts.sectors)
    by_size = scenes_by_size(both, facts)
    whole = both.folded()
    found = [best_region(question, whole, facts.scene) for question in asked]
    return [*found, _as_frames_say(by_size, facts_asked, facts)] if by_size else found


def _as_frames_say(by_size: FoundRegion, facts_asked: Sequence[Question], facts: Facts) -> FoundRegion:
    """The scenes by what frames say of them, where a moment or a tag divides them just so."""
    own = by_size.question.between_scenes(facts.scene)
    for question in facts_asked:
        whole = question.between_scenes(facts.scene)
        alike = np.flatnonzero((whole == own).all(1)) if whole is not None and own is not None else []
        if len(alike):
            return FoundRegion(question, int(alike[0]), by_size.p_value)
    return by_size


def without_step(null: Problem, choice: Choice, step: int | None) -> Problem:
    """The null with all steps but one in place."""
    rest = [other for k, other in enumerate(choice.steps) if k != step]
    return with_steps(null, rest) if rest else null
