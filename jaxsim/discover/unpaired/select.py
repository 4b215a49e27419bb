"""Which effect the measured side has: forward selection, calibrated by exchanging sides between scenes.

If nothing but the streets differed, any scene could as well have been of the other side. A candidate is accepted
where it lowers the loss by more than it does, with any candidate, when scenes are exchanged at random (max-T, Westfall
& Young 1993), and where it gains on scenes that its fit has not seen. A free curve that gains clearly more than any
effect says that what is there is not in the catalogue.

Letters: d draws of which scenes count as measured, the true one first; f find scenes; t terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxsim.discover.find.covariates import Dependence
from jaxsim.discover.name.select import Selection, Step, worse
from jaxsim.discover.name.unexplained import X_WORDS, shape_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.unpaired.besides_ground import shown_by_ground_alone
from jaxsim.discover.unpaired.conditional import Conditional, Term
from jaxsim.discover.unpaired.equations import lowered
from jaxsim.discover.unpaired.held_out import held_out
from jaxsim.discover.unpaired.refine import beside
from jaxsim.discover.verdict import Unexplained

CURVES_ALONG = ("range", "incidence", "azimuth")
"""Free curves that are no effect of the catalogue; one along the row is beam_gain."""


@dataclass(frozen=True)
class UnpairedCandidate:
    """A term with what the tests say of it."""

    term: Term
    score: float
    """Standard deviations above exchanged scenes, of the root of the loss."""
    chance: float
    """Probability that exchanged scenes reach as much with any candidate."""
    by_scene: Float[np.ndarray, " f"]
    """Held-out nats of each find scene."""
    of_ground: bool = False
    """Whether the ground alone shows it; of those that nobody asked it is not said."""

    @property
    def effect(self) -> Any:
        """The effect; None of a free curve."""
        return self.term.columns.effect

    @property
    def name(self) -> str:
        """The effect's, or the free curve's covariate."""
        return self.term.name

    @property
    def total(self) -> float:
        """Gain of all scenes, none of which decides alone."""
        return float(clipped(self.by_scene).sum())

    @property
    def agreement(self) -> float:
        """Probability that held-out scenes agree so well by chance."""
        return p_value(clipped(self.by_scene))

    @property
    def accepted(self) -> bool:
        """Whether it passes both tests, and more than the ground shows it."""
        return (
            self.chance <= RULES.unpaired_level
            and self.total > 0
            and self.agreement <= RULES.unpaired_agreement_level
            and not self.of_ground
        )


UnpairedChoice = Selection[UnpairedCandidate]
"""The effects added."""


def choose_unpaired(problem: Conditional, draws: Float[np.ndarray, "d s"]) -> UnpairedChoice:
    """Adds the best accepted effect, and again beside what was added, until none is accepted or the best is shown by
    the ground alone: what is no effect would be named as its next of kin."""
    steps: list[Step[UnpairedCandidate]] = []
    rest = list(problem.terms)
    left = problem
    while True:
        ranking = rank_terms(left, rest, draws)
        least = RULES.unpaired_least_share * steps[0].chosen.total if steps else 0.0
        good = [candidate for candidate in ranking if candidate.accepted and candidate.total >= least]
        if not good or len(steps) == RULES.unpaired_most_effects:
            return UnpairedChoice(tuple(steps), tuple(ranking))
        best = good[0]
        if shown_by_ground_alone(left, best.term):
            last = (replace(one, of_ground=one is best) for one in ranking)
            return UnpairedChoice(tuple(steps), tuple(last))
        alike = tuple(candidate for candidate in ranking if candidate is not best and _alike(candidate, best))
        steps.append(Step(best, alike, tuple(ranking)))
        # All starts of the effect are done with, not the best alone.
        rest = [term for term in rest if term.name != best.name]
        # Where its column was taken is not where it lies: what is left there would be named as another effect.
        left = beside(problem, [step.chosen.term.columns for step in steps])


def _alike(candidate: UnpairedCandidate, best: UnpairedCandidate) -> bool:
    """Whether the scenes do not tell it from the best; it need not be accepted itself."""
    share = RULES.unpaired_alike_share
    if candidate.chance > RULES.unpaired_agreement_level or candidate.total < share * best.total:
        return False
    return not worse(candidate, best, share=share, nats=0.0)


def rank_terms(problem: Conditional, terms: Sequence[Term], draws: Float[np.ndarray, "d s"]) -> list[UnpairedCandidate]:
    """Every term tested on the find scenes; largest held-out gain first. Of an effect with several starts the best is
    kept."""
    near = problem.nuisance
    blocks = [term.block for term in terms]
    drops = lowered(problem.equations, draws, blocks, weight=problem.weight, nuisance=near)
    # The root of the loss is near normal, so that terms of more and fewer columns can be held against each other.
    root = np.sqrt(np.maximum(drops, 0))
    spread = np.maximum(root[1:].std(0), 1e-3)
    # The first draw is the true one; the others say what no effect looks like.
    score = (root - root[1:].mean(0)) / spread
    # Max-T: the best of all candidates in each exchange pays for having tried them all.
    highest = score[1:].max(1)
    gains = held_out(problem, near, blocks)
    tested = [
        UnpairedCandidate(
            term,
            score=float(score[0, k]),
            chance=float((1 + (highest >= score[0, k]).sum()) / len(draws)) if gains[k].any() else 1.0,
            by_scene=gains[k],
        )
        for k, term in enumerate(terms)
    ]
    best = [
        max((c for c in tested if c.name == name), key=lambda c: (c.accepted, c.total))
        for name in dict.fromkeys(term.name for term in terms)
    ]
    return sorted(best, key=lambda candidate: -candidate.total)


def outside_catalogue(
    problem: Conditional, choice: UnpairedChoice, curves: Sequence[UnpairedCandidate], *, strongest_nats: float
) -> Unexplained | None:
    """The best free curve if it gains so much more than the best effect that it is none of them. That may gain more
    with its parameters fitted (`strongest_nats`, of all find scenes) than where its column was taken: a window's place
    and width."""
    good = [curve for curve in curves if curve.accepted and curve.name in CURVES_ALONG]
    best = max(choice.steps[0].chosen.total, strongest_nats) if choice.steps else 0.0
    enough = RULES.unpaired_curve_factor * best + RULES.curve_margin_nats
    if good and good[0].total > enough and not shown_by_ground_alone(problem, good[0].term):
        return _described(problem, good[0])
    return None


def _described(problem: Conditional, curve: UnpairedCandidate) -> Unexplained:
    """The curve on the find scenes, at its knots."""
    name = curve.name
    basis = curve.term.columns.columns

    def heights(weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, " k"]:
        return problem.solved([curve.term.block], weight=weight).side[len(problem.nuisance.columns) :]

    drawn = [heights(weight) for weight in problem.resampled()]
    # A knot lies where its hat function is high.
    x = problem.comparison.covariates[name]
    knots = np.array([np.average(x, weights=basis[:, k] ** 4 + 1e-12) for k in range(basis.shape[1])])
    order = np.argsort(knots)
    y = heights(problem.weight)[order]
    band = problem.reach * np.std(drawn, axis=0)[order]
    dependence = Dependence("intensity", name, curve.chance, 0.0, curve.total)
    character, formula = shape_of(knots[order], y, basis.sum(0)[order], dependence=dependence)
    formula += f" (x: {X_WORDS.get(name, name)})"
    return Unexplained("intensity", name, character, formula, tuple(knots[order]), tuple(y), tuple(band))
