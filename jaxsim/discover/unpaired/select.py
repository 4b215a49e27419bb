"""Which effect the measured side has: forward selection, calibrated by exchanging sides between scenes.

If nothing but the streets differed, any scene could as well have been of the other side. A candidate is accepted
where it lowers the loss by more than it does, with any candidate, when scenes are exchanged at random (max-T, Westfall
& Young 1993), and where it gains on scenes that its fit has not seen. A free curve that gains clearly more than any
effect says that what is there is not in the catalogue.

Letters: d draws of which scenes count as measured, the true one first; f find scenes; t terms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.covariates import Dependence
from jaxsim.discover.name.select import Selection, Step, worse
from jaxsim.discover.name.unexplained import X_WORDS, shape_of
from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.unpaired.conditional import Conditional, Term
from jaxsim.discover.unpaired.law import Block, Pooled, Solution, lowered, solve
from jaxsim.discover.verdict import Unexplained

CURVES_ALONG = ("range", "incidence", "azimuth")
"""Free curves that are no effect of the catalogue; one along the row is beam_gain."""
BAND_DRAWS = 100
"""Draws of the bootstrap over scenes that a curve's band is taken from, the curve itself included."""
NORMAL_REACH = 1.645
"""Standard deviations to either side within which a normal number lies with 90 %."""


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
        """Whether it passes both tests."""
        return (
            self.chance <= RULES.unpaired_level and self.total > 0 and self.agreement <= RULES.unpaired_agreement_level
        )


UnpairedChoice = Selection[UnpairedCandidate]
"""The effects added."""


def choose_unpaired(problem: Conditional, draws: Float[np.ndarray, "d s"]) -> UnpairedChoice:
    """Adds the best accepted effect, and again, until none is accepted."""
    steps: list[Step[UnpairedCandidate]] = []
    rest = list(problem.terms)
    while True:
        ranking = rank_terms(problem, rest, draws, added=[step.chosen.term.block for step in steps])
        good = [candidate for candidate in ranking if candidate.accepted]
        if not good or len(steps) == RULES.unpaired_most_effects:
            return UnpairedChoice(tuple(steps), tuple(ranking))
        best = good[0]
        alike = tuple(candidate for candidate in ranking if candidate is not best and _alike(candidate, best))
        steps.append(Step(best, alike, tuple(ranking)))
        # All starts of the effect are done with, not the best alone.
        rest = [term for term in rest if term.name != best.name]


def _alike(candidate: UnpairedCandidate, best: UnpairedCandidate) -> bool:
    """Whether the scenes do not tell it from the best; it need not be accepted itself."""
    share = RULES.unpaired_alike_share
    if candidate.chance > RULES.unpaired_agreement_level or candidate.total < share * best.total:
        return False
    return not worse(candidate, best, share=share, nats=0.0)


def rank_terms(
    problem: Conditional, terms: Sequence[Term], draws: Float[np.ndarray, "d s"], *, added: Sequence[Block] = ()
) -> list[UnpairedCandidate]:
    """Every term tested on the find scenes with `added` blocks in place; largest held-out gain first. Of an effect with
    several starts the best is kept."""
    beside = [problem.nuisance, *added]
    near = Block(
        np.concatenate([block.columns for block in beside]), np.concatenate([block.precision for block in beside])
    )
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


def held_out(problem: Conditional, near: Block, blocks: Sequence[Block]) -> Float[np.ndarray, "t f"]:
    """Gain of each find scene, nats, by fits on the others with `near` in place; 0 where a coefficient has the wrong
    sign."""
    gains = np.zeros((len(blocks), problem.find.sum()))
    wrong = np.zeros(len(blocks), bool)
    for out, pooled in _without_each(problem):
        before = _losses(problem, solve(pooled, [near]))[out]
        for b, block in enumerate(blocks):
            solution = solve(pooled, [near, block])
            wrong[b] |= bool(block.sign) and solution.side[len(near.columns)] * block.sign <= 0
            gains[b, out] = before - _losses(problem, solution)[out]
    # An effect that helps with its sign turned is another effect.
    gains[wrong] = 0
    return gains


def held_out_losses(problem: Conditional, near: Block) -> Float[np.ndarray, " f"]:
    """Loss of each find scene, nats, by fits of `near` on the others: what a gain of `held_out` is a share of."""
    losses = np.zeros(problem.find.sum())
    for out, pooled in _without_each(problem):
        losses[out] = _losses(problem, solve(pooled, [near]))[out]
    return losses


def _losses(problem: Conditional, solution: Solution) -> Float[np.ndarray, " f"]:
    """The loss of each find scene, nats."""
    return problem.equations.losses(solution, problem.measured)[problem.find]


def _without_each(problem: Conditional) -> Iterator[tuple[Bool[np.ndarray, " f"], Pooled]]:
    """For each fold, which find scenes it holds out, and the equations of the others."""
    index = np.flatnonzero(problem.find)
    fold = _folds(problem.comparison.measured[index])
    for k in range(RULES.unpaired_folds):
        weight = np.zeros(len(problem.find))
        # Whole scenes are held out, of both sides: the law itself is fitted without them.
        weight[index[fold != k]] = 1
        yield fold == k, problem.equations.pooled(weight, problem.measured)


def _folds(measured: np.ndarray) -> np.ndarray:
    """The fold of each scene: scenes of either side are dealt in turn."""
    fold = np.zeros(len(measured), int)
    for side in (False, True):
        fold[measured == side] = np.arange((measured == side).sum()) % RULES.unpaired_folds
    return fold


def outside_catalogue(
    problem: Conditional, choice: UnpairedChoice, curves: Sequence[UnpairedCandidate], *, fitted: float
) -> Unexplained | None:
    """The best free curve if it gains so much more than the best effect that it is none of them. That may gain more
    with parameters `fitted` (nats of all find scenes) than where its column was taken: a window's place and width."""
    good = [curve for curve in curves if curve.accepted and curve.name in CURVES_ALONG]
    best = max(choice.steps[0].chosen.total, fitted) if choice.steps else 0.0
    if good and good[0].total > RULES.unpaired_curve_factor * best + RULES.curve_margin_nats:
        return _described(problem, good[0])
    return None


def _described(problem: Conditional, curve: UnpairedCandidate) -> Unexplained:
    """The curve on the find scenes, at its knots."""
    name = curve.name
    basis = curve.term.columns.columns
    scenes = np.flatnonzero(problem.find)
    rng = np.random.default_rng(0)

    def heights(weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, " k"]:
        return problem.solved([curve.term.block], weight=weight).side[len(problem.nuisance.columns) :]

    fits = [heights(problem.weight)]
    # Scenes are drawn with replacement: rays of one scene are no independent witnesses.
    for _ in range(BAND_DRAWS - 1):
        drawn = rng.choice(scenes, len(scenes))
        fits.append(heights(np.bincount(drawn, minlength=len(problem.find)).astype(float)))
    # A knot lies where its hat function is high.
    x = problem.comparison.covariates[name]
    knots = np.array([np.average(x, weights=basis[:, k] ** 4 + 1e-12) for k in range(basis.shape[1])])
    order = np.argsort(knots)
    y = fits[0][order]
    band = NORMAL_REACH * np.std(fits[1:], axis=0)[order]
    dependence = Dependence("intensity", name, curve.chance, 0.0, curve.total)
    character, formula = shape_of(knots[order], y, basis.sum(0)[order], dependence=dependence)
    formula += f" (x: {X_WORDS.get(name, name)})"
    return Unexplained("intensity", name, character, formula, tuple(knots[order]), tuple(y), tuple(band))
