"""The law of a reading given what a range image says of the ray, common to two sets of streets, and what one side
adds to it.

    y = law(x) + [measured] (nuisance(x) + effect(x)) + what is the scene's own + noise

Letters: n rays, s scenes, l columns of the law, k columns of the measured side. All is linear in its coefficients,
so that a scene is its normal equations, and sides can be exchanged between scenes at the price of a small solve.
What is a scene's own (levels and slopes of its surfaces) is a random effect, taken out of its normal equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

RIDGE = 1.0
"""Rays' worth of pull of the law's coefficients to 0."""


def hats(x: np.ndarray, count: int, *, low: float = 0.01, high: float = 0.99) -> Float[np.ndarray, "n k"]:
    """Hat functions between quantiles of x; one column of ones where x does not vary."""
    knots = np.unique(np.quantile(x, np.linspace(low, high, count)))
    if len(knots) < 2:
        return np.ones((len(x), 1), np.float32)
    place = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((x - knots[place]) / (knots[place + 1] - knots[place]), 0, 1)
    result = np.zeros((len(x), len(knots)), np.float32)
    rows = np.arange(len(x))
    result[rows, place], result[rows, place + 1] = 1 - share, share
    return result


def one_hot(x: np.ndarray, values: np.ndarray | None = None) -> Float[np.ndarray, "n k"]:
    """A column for each value."""
    return (x[:, None] == (np.unique(x) if values is None else values)).astype(np.float32)


def each(parts: np.ndarray, of: np.ndarray) -> Float[np.ndarray, "n k"]:
    """Products of all columns of the two."""
    return (parts[:, :, None] * of[:, None, :]).reshape(len(parts), -1)


@dataclass(frozen=True)
class Equations:
    """Normal equations of every scene, with its random effects taken out, in units of the noise's variance."""

    gram: Float[np.ndarray, "s p p"]
    """p = l + k columns: the law's, then those of the measured side."""
    right: Float[np.ndarray, "s p"]
    square: Float[np.ndarray, " s"]
    law: int
    """Columns of the law, l."""

    def pooled(
        self, weight: Float[np.ndarray, " s"], measured: Float[np.ndarray, " s"]
    ) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, " k"], Float[np.ndarray, "l k"], Float[np.ndarray, " l"]]:
        """Equations of the measured side's columns with the law eliminated, and what gives the law back: its
        coefficients are `base - cross @ side`."""
        n = self.law
        own = weight * measured
        inner = np.einsum("s,spq->pq", weight, self.gram[:, :n, :n]) + RIDGE * np.eye(n)
        between = np.einsum("s,spq->pq", own, self.gram[:, :n, n:])
        side = np.einsum("s,spq->pq", own, self.gram[:, n:, n:])
        solved = np.linalg.solve(inner, np.concatenate([between, (weight @ self.right[:, :n])[:, None]], axis=1))
        cross, base = solved[:, :-1], solved[:, -1]
        return side - between.T @ cross, own @ self.right[:, n:] - between.T @ base, cross, base

    def losses(
        self, law: np.ndarray, side: np.ndarray, columns: np.ndarray, measured: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, " s"]:
        """Half the sum of squares of each scene with these coefficients, nats."""
        n = self.law
        whole = np.zeros((len(self.square), self.gram.shape[-1]))
        whole[:, :n] = law
        whole[:, n + columns] = measured[:, None] * side
        fitted = np.einsum("spq,sq->sp", self.gram, whole)
        return 0.5 * (self.square + np.einsum("sp,sp->s", whole, fitted - 2 * self.right))


def equations(
    law: Float[np.ndarray, "n l"],
    side: Float[np.ndarray, "n k"],
    own: Float[np.ndarray, "n o"],
    own_sd: Float[np.ndarray, " o"],
    patch_sd: float,
    y: Float[np.ndarray, " n"],
    scene: Int[np.ndarray, " n"],
    patch: Int[np.ndarray, " n"],
    *,
    scenes: int,
    variance: float,
) -> Equations:
    """Of rays y with columns of the law and of the measured side. Random effects are those of a scene, `own`, and
    a level of each patch (numbers; a patch lies in one scene), with their standard deviations."""
    size = law.shape[1] + side.shape[1]
    gram, right, square = np.zeros((scenes, size, size)), np.zeros((scenes, size)), np.zeros(scenes)
    for s in range(scenes):
        at = scene == s
        x = np.concatenate([law[at], side[at]], axis=1).astype(np.float64)
        whole = np.concatenate([x, y[at][:, None], own[at].astype(np.float64)], axis=1)
        order = np.argsort(patch[at], kind="stable")
        _, first, count = np.unique(patch[at][order], return_index=True, return_counts=True)
        sums = np.add.reduceat(whole[order], first, axis=0)
        sums /= np.sqrt(count + variance / patch_sd**2)[:, None]
        products = whole.T @ whole - sums.T @ sums
        cut = size + 1
        inner = products[cut:, cut:] + variance * np.diag(1 / own_sd**2)
        products = products[:cut, :cut] - products[:cut, cut:] @ np.linalg.solve(inner, products[cut:, :cut])
        products /= variance
        gram[s], right[s], square[s] = products[:size, :size], products[:size, size], products[size, size]
    return Equations(gram, right, square, law.shape[1])


@dataclass(frozen=True)
class Block:
    """Columns of the measured side that stand for one thing, and how firmly each is held to 0."""

    columns: Int[np.ndarray, " c"]
    precision: Float[np.ndarray, " c"]
    sign: int = 0
    """The first coefficient must have it; 0: any."""


def solve(
    inner: np.ndarray, right: np.ndarray, blocks: Sequence[Block]
) -> tuple[Float[np.ndarray, " c"], Int[np.ndarray, " c"], float]:
    """Coefficients of blocks fitted together, their columns, and by how much they lower the loss, nats."""
    columns = np.concatenate([block.columns for block in blocks])
    held = np.concatenate([block.precision for block in blocks])
    matrix = inner[np.ix_(columns, columns)] + np.diag(held)
    found = np.linalg.solve(matrix, right[columns])
    return found, columns, 0.5 * float(found @ right[columns])


def exchanged(measured: Bool[np.ndarray, " s"], count: int, seed: int = 0) -> Float[np.ndarray, "d s"]:
    """Draws of which scenes count as measured: as many as there are, at random; the first draw is the true one."""
    rng = np.random.default_rng(seed)
    draws = np.stack([measured, *(rng.permutation(measured) for _ in range(count - 1))])
    return draws.astype(float)


def lowered(
    eq: Equations,
    weight: Float[np.ndarray, " s"],
    draws: Float[np.ndarray, "d s"],
    nuisance: Block,
    blocks: Sequence[Block],
) -> Float[np.ndarray, "d b"]:
    """By how much each block lowers the loss beyond law and nuisance, nats, for every draw of the sides."""
    n, near = eq.law, nuisance.columns
    inner = np.einsum("s,spq->pq", weight, eq.gram[:, :n, :n]) + RIDGE * np.eye(n)
    half = np.linalg.inv(np.linalg.cholesky(inner))
    base = half @ (weight @ eq.right[:, :n])
    result = np.zeros((len(draws), len(blocks)))
    across = np.stack([half @ g for g in eq.gram[:, :n, n:]])
    for d, measured in enumerate(draws):
        own = weight * measured
        between = np.tensordot(own, across, 1)
        side = np.tensordot(own, eq.gram[:, n:, n:], 1) - between.T @ between
        right = own @ eq.right[:, n:] - between.T @ base
        first = np.linalg.solve(
            side[np.ix_(near, near)] + np.diag(nuisance.precision),
            np.concatenate([side[near], right[near][:, None]], axis=1),
        )
        left = side - side[:, near] @ first[:, :-1]
        right = right - side[:, near] @ first[:, -1]
        for b, block in enumerate(blocks):
            at = block.columns
            found = np.linalg.solve(left[np.ix_(at, at)] + np.diag(block.precision), right[at])
            result[d, b] = 0.5 * float(found @ right[at])
    return result


def freedom(eq: Equations, weight: np.ndarray, measured: np.ndarray, block: Block) -> float:
    """Degrees of freedom of a block, shrunk by its prior."""
    side = eq.pooled(weight, measured)[0][np.ix_(block.columns, block.columns)]
    return float(np.trace(np.linalg.solve(side + np.diag(block.precision), side)))
