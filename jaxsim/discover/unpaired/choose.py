"""Which effect the measured side has: forward selection, calibrated by exchanging sides between scenes.

If nothing but the streets differed, any scene could as well have been of the other side. A candidate is accepted
where it lowers the loss by more than it does, with any candidate, when scenes are exchanged at random, and where it
gains on scenes that its fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxsim.discover.scenes import clipped, p_value
from jaxsim.discover.unpaired.conditional import Candidate, Conditional
from jaxsim.discover.unpaired.law import Block, lowered, solve

DRAWS = 400
"""Exchanges of scenes, the true one included."""
LEVEL = 0.01
"""Share of exchanges that may reach what an accepted candidate reaches, over all candidates."""
AGREE = 0.05
"""Of the sign-flip test over scenes that held-out gains must pass."""
ALIKE, CLEARLY = 0.10, 0.5
"""A look-alike gains at least CLEARLY of what the best does, and the paired test does not fall below ALIKE."""
FOLDS = 4
MOST = 3


@dataclass(frozen=True)
class Tested:
    """A candidate with what the tests say of it."""

    candidate: Candidate
    score: float
    """Standard deviations above exchanged scenes, of the root of the loss."""
    p_value: float
    """Over all candidates."""
    gain: Float[np.ndarray, " f"]
    """Held-out nats of each find scene."""

    @property
    def total(self) -> float:
        return float(clipped(self.gain).sum())

    @property
    def accepted(self) -> bool:
        return self.p_value <= LEVEL and self.total > 0 and p_value(clipped(self.gain)) <= AGREE


@dataclass(frozen=True)
class Step:
    """One effect added, and what stood beside it."""

    chosen: Tested
    alike: tuple[Tested, ...]
    ranking: tuple[Tested, ...]


def tested(
    problem: Conditional, draws: Float[np.ndarray, "d s"], added: Sequence[Block], candidates: Sequence[Candidate]
) -> list[Tested]:
    """Every candidate tested on the find scenes with `added` blocks in place; largest held-out gain first. Of an
    effect with several starts the best is kept."""
    near = _joined([problem.nuisance, *added])
    weight = problem.find.astype(float)
    blocks = [candidate.block for candidate in candidates]
    root = np.sqrt(np.maximum(lowered(problem.equations, weight, draws, near, blocks), 0))
    spread = np.maximum(root[1:].std(0), 1e-3)
    z = (root - root[1:].mean(0)) / spread
    highest = z[1:].max(1)
    gains = held_out(problem, near, candidates)
    found: dict[str, Tested] = {}
    for k, candidate in enumerate(candidates):
        p = float((1 + (highest >= z[0, k]).sum()) / len(draws))
        one = Tested(candidate, float(z[0, k]), p if gains[k].any() else 1.0, gains[k])
        if candidate.name not in found or _rank(one) > _rank(found[candidate.name]):
            found[candidate.name] = one
    return sorted(found.values(), key=lambda one: -one.total)


def _rank(one: Tested) -> tuple[bool, float]:
    return one.accepted, one.total


def held_out(problem: Conditional, near: Block, candidates: Sequence[Candidate]) -> Float[np.ndarray, "c f"]:
    """Gain of each find scene, nats, by fits on the others; 0 where a coefficient has the wrong sign."""
    eq, places = problem.equations, np.flatnonzero(problem.find)
    sensed = problem.streets.measured.astype(float)
    # Scenes of either side are dealt to the folds in turn.
    fold = np.zeros(len(places), int)
    for side in (0, 1):
        own = sensed[places] == side
        fold[own] = np.arange(own.sum()) % FOLDS
    gains, wrong = np.zeros((len(candidates), len(places))), np.zeros(len(candidates), bool)
    for k in range(FOLDS):
        weight = np.zeros(len(sensed))
        weight[places[fold != k]] = 1
        inner, right, cross, base = eq.pooled(weight, sensed)
        held = places[fold == k]

        def losses(blocks: Sequence[Block], inner=inner, right=right, cross=cross, base=base, held=held) -> tuple:
            side, columns, _ = solve(inner, right, blocks)
            return eq.losses(base - cross[:, columns] @ side, side, columns, sensed)[held], side

        before, _ = losses([near])
        for c, candidate in enumerate(candidates):
            after, side = losses([near, candidate.block])
            wrong[c] |= bool(candidate.block.sign) and side[len(near.columns)] * candidate.block.sign <= 0
            gains[c, fold == k] = before - after
    gains[wrong] = 0
    return gains


def worse(one: Tested, best: Tested) -> bool:
    """Whether the scenes say that it explains clearly less than the best."""
    difference = clipped(best.gain - one.gain)
    return one.total < CLEARLY * best.total or (p_value(difference) <= ALIKE and difference.sum() > 0)


def choose(problem: Conditional, draws: Float[np.ndarray, "d s"]) -> tuple[list[Step], list[Tested]]:
    """Adds the best accepted candidate, and again; gives the steps and the last, empty-handed ranking."""
    steps: list[Step] = []
    left = list(problem.candidates)
    while True:
        ranking = tested(problem, draws, [step.chosen.candidate.block for step in steps], left)
        good = [one for one in ranking if one.accepted]
        if not good or len(steps) == MOST:
            return steps, ranking
        best = good[0]
        near = tuple(one for one in ranking if one is not best and one.p_value <= AGREE and not worse(one, best))
        steps.append(Step(best, near, tuple(ranking)))
        left = [candidate for candidate in left if candidate.name != best.candidate.name]


def _joined(blocks: Sequence[Block]) -> Block:
    return Block(np.concatenate([b.columns for b in blocks]), np.concatenate([b.precision for b in blocks]))
