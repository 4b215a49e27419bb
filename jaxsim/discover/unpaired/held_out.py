"""What terms gain on find scenes that their fit has not seen, the law itself fitted without them.

Letters: f find scenes; t terms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.rules import RULES
from jaxsim.discover.scenes import folds
from jaxsim.discover.unpaired.conditional import Conditional
from jaxsim.discover.unpaired.equations import Block, Pooled, Solution, solve


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
    """The fold of each scene: those of either side are dealt for themselves."""
    fold = np.zeros(len(measured), int)
    for side in (False, True):
        of_side = np.flatnonzero(measured == side)
        fold[of_side] = folds(np.arange(len(of_side)), RULES.unpaired_folds).argmin(0)
    return fold
