"""The law of a reading given what a range image says of the ray, common to two sets of streets, and what one side
adds to it.

    y = law(x) + [measured] (nuisance(x) + effect(x)) + what is the scene's own + noise

Letters: n rays, s scenes, l columns of the law, k columns of the measured side, p = l + k, c columns of some blocks,
d draws of which scenes count as measured. All is linear in its coefficients, so that a scene is its normal equations,
and sides can be exchanged between scenes at the price of a small solve. What is a scene's own (levels and slopes of its
surfaces) is a random effect, taken out of its normal equations as in Henderson's mixed-model equations (1975, doi
10.2307/2529430).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

LAW_PULL = 1.0
"""Rays' worth of pull of the law's coefficients to 0."""


@dataclass(frozen=True)
class Block:
    """Columns of the measured side that stand for one thing, and how firmly each is held to 0."""

    columns: Int[np.ndarray, " c"]
    precision: Float[np.ndarray, " c"]
    sign: int = 0
    """The first coefficient must have it; 0: any."""


class Pooled(NamedTuple):
    """Normal equations of the measured side's columns with the law eliminated (Schur complement)."""

    inner: Float[np.ndarray, "k k"]
    right: Float[np.ndarray, " k"]
    cross: Float[np.ndarray, "l k"]
    base: Float[np.ndarray, " l"]
    """The law's coefficients are `base - cross @ side`."""


class Solution(NamedTuple):
    """Coefficients of the law, and of the columns of the measured side that were fitted; the others are 0."""

    law: Float[np.ndarray, " l"]
    side: Float[np.ndarray, " c"]
    columns: Int[np.ndarray, " c"]


@dataclass(frozen=True)
class Equations:
    """Normal equations of every scene, with its random effects taken out, in units of the noise's variance."""

    gram: Float[np.ndarray, "s p p"]
    """The law's columns, then those of the measured side."""
    right: Float[np.ndarray, "s p"]
    square: Float[np.ndarray, " s"]
    law: int
    """Columns of the law, l."""

    def scaled(self, inflation: float) -> Equations:
        """The same with a variance of the noise that is larger by this factor."""
        return Equations(self.gram / inflation, self.right / inflation, self.square / inflation, self.law)

    def of_law(self, weight: Float[np.ndarray, " s"]) -> Float[np.ndarray, "l l"]:
        """The law's part of the matrix, pulled to 0. Normal equations add up over scenes: any choice of them is a
        weighted sum."""
        n = self.law
        return np.einsum("s,spq->pq", weight, self.gram[:, :n, :n]) + LAW_PULL * np.eye(n)

    def pooled(self, weight: Float[np.ndarray, " s"], measured: Float[np.ndarray, " s"]) -> Pooled:
        """The sum over scenes, each counted `weight` times; `measured` is 1 of those of the measured side, else 0."""
        n = self.law
        # Simulated scenes say what the law is; the columns of the measured side are 0 there.
        weight_measured = weight * measured
        between = np.einsum("s,spq->pq", weight_measured, self.gram[:, :n, n:])
        of_side = np.einsum("s,spq->pq", weight_measured, self.gram[:, n:, n:])
        # Schur complement: the law is solved for given the side, for all right-hand sides at once.
        solved = np.linalg.solve(
            self.of_law(weight), np.concatenate([between, (weight @ self.right[:, :n])[:, None]], axis=1)
        )
        cross = solved[:, :-1]
        base = solved[:, -1]
        right = weight_measured @ self.right[:, n:] - between.T @ base
        return Pooled(of_side - between.T @ cross, right, cross, base)

    def losses(self, solution: Solution, measured: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
        """Half the sum of squares of each scene with these coefficients, nats."""
        n = self.law
        coefficients = np.zeros((len(self.square), self.gram.shape[-1]))
        coefficients[:, :n] = solution.law
        coefficients[:, n + solution.columns] = measured[:, None] * solution.side
        predicted = np.einsum("spq,sq->sp", self.gram, coefficients)
        # |y - X b|² = y'y - 2 b'X'y + b'X'X b.
        return 0.5 * (self.square + np.einsum("sp,sp->s", coefficients, predicted - 2 * self.right))


class RandomEffects(NamedTuple):
    """What differs between scenes without meaning anything: columns whose coefficients are each scene's own, and a
    level of each patch (a number; a patch lies in one scene), with their standard deviations."""

    columns: Float[np.ndarray, "n o"]
    sd: Float[np.ndarray, " o"]
    patch: Int[np.ndarray, " n"]
    patch_sd: float


def equations(
    y: Float[np.ndarray, " n"],
    law: Float[np.ndarray, "n l"],
    side: Float[np.ndarray, "n k"],
    *,
    random: RandomEffects,
    scene: Int[np.ndarray, " n"],
    scenes: int,
    variance: float,
) -> Equations:
    """The scenes of rays y with columns of the law and of the measured side; `variance` is the noise's."""
    size = law.shape[1] + side.shape[1]
    gram = np.zeros((scenes, size, size))
    right = np.zeros((scenes, size))
    square = np.zeros(scenes)
    for s in range(scenes):
        at = scene == s
        patch = random.patch[at]
        x = np.concatenate([law[at], side[at]], axis=1).astype(np.float64)
        # Readings beside the columns, so that one product gives X'X, X'y and y'y.
        columns = np.concatenate([x, y[at][:, None], random.columns[at].astype(np.float64)], axis=1)
        # A patch's level takes the mean of its rays out, shrunk by the prior's worth of rays.
        order = np.argsort(patch, kind="stable")
        _, first, count = np.unique(patch[order], return_index=True, return_counts=True)
        # Woodbury: sum over a patch's rays, over sqrt(count + variance / patch_sd^2); its square is what the level
        # explains.
        sums = np.add.reduceat(columns[order], first, axis=0)
        sums /= np.sqrt(count + variance / random.patch_sd**2)[:, None]
        products = columns.T @ columns - sums.T @ sums
        # The scene's own columns, the last, are eliminated.
        cut = size + 1
        inner = products[cut:, cut:] + variance * np.diag(1 / random.sd**2)
        products = products[:cut, :cut] - products[:cut, cut:] @ np.linalg.solve(inner, products[cut:, :cut])
        products /= variance
        gram[s] = products[:size, :size]
        right[s] = products[:size, size]
        square[s] = products[size, size]
    return Equations(gram, right, square, law.shape[1])


class Patches(NamedTuple):
    """The patches of a scene's rays, and how far the mean of each one's rays is its level."""

    of_ray: Int[np.ndarray, " n"]
    shrinkage: Float[np.ndarray, " q"]
    """Of the sum of a patch's rays: one over their number and the prior's worth of rays."""

    @classmethod
    def of(cls, patch: Int[np.ndarray, " n"], prior_rays: float) -> Patches:
        _, of_ray, count = np.unique(patch, return_inverse=True, return_counts=True)
        return cls(of_ray, 1 / (count + prior_rays))

    def levelled(self, values: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
        """Gives the values less their patches' levels."""
        sums = np.zeros((len(self.shrinkage), values.shape[1]))
        np.add.at(sums, self.of_ray, values)
        return values - (self.shrinkage[:, None] * sums)[self.of_ray]


def without_random(
    off: Float[np.ndarray, " n"], random: RandomEffects, *, scene: Int[np.ndarray, " n"], variance: float
) -> Float[np.ndarray, " n"]:
    """Gives what is left of the rays' residuals once the random effects of each scene are estimated (best linear
    unbiased predictors) and taken out, as its normal equations do."""
    left = off.astype(float)
    for s in np.unique(scene):
        at = scene == s
        patches = Patches.of(random.patch[at], variance / random.patch_sd**2)
        columns = random.columns[at].astype(np.float64)
        near = patches.levelled(columns)
        own = np.linalg.solve(columns.T @ near + variance * np.diag(1 / random.sd**2), near.T @ left[at])
        left[at] = patches.levelled((left[at] - columns @ own)[:, None])[:, 0]
    return left


def solve(pooled: Pooled, blocks: Sequence[Block]) -> Solution:
    """Blocks fitted together, with the law beside them."""
    columns = np.concatenate([block.columns for block in blocks])
    precision = np.concatenate([block.precision for block in blocks])
    matrix = pooled.inner[np.ix_(columns, columns)] + np.diag(precision)
    side = np.linalg.solve(matrix, pooled.right[columns])
    return Solution(pooled.base - pooled.cross[:, columns] @ side, side, columns)


def exchanged(measured: Bool[np.ndarray, " s"], count: int) -> Float[np.ndarray, "d s"]:
    """Which scenes count as measured: as many as there are, in all ways there are, or if these are more than `count`,
    in so many at random; the first is the true one, and none of the others is."""
    scenes, chosen = len(measured), int(measured.sum())
    if math.comb(scenes, chosen) <= count:
        others = [np.isin(np.arange(scenes), which) for which in combinations(range(scenes), chosen)]
    else:
        rng = np.random.default_rng(0)
        # Of more than `count` ways, as many draws again hardly all meet the true one.
        others = [rng.permutation(measured) for _ in range(2 * count)]
    differ = [one for one in others if (one != measured).any()]
    return np.stack([measured, *differ[: count - 1]]).astype(float)


def lowered(
    eq: Equations,
    draws: Float[np.ndarray, "d s"],
    blocks: Sequence[Block],
    *,
    weight: Float[np.ndarray, " s"],
    nuisance: Block,
) -> Float[np.ndarray, "d b"]:
    """How much each block lowers the loss beyond law and nuisance, nats, for every draw of the sides."""
    n = eq.law
    near = nuisance.columns
    # The law's part is the same for all draws: it is factored once. With it = L L', half = L^-1 makes the
    # elimination of the law a plain product.
    half = np.linalg.inv(np.linalg.cholesky(eq.of_law(weight)))
    base = half @ (weight @ eq.right[:, :n])
    across = np.stack([half @ g for g in eq.gram[:, :n, n:]])
    drops = np.zeros((len(draws), len(blocks)))
    for d, measured in enumerate(draws):
        weight_measured = weight * measured
        between = np.tensordot(weight_measured, across, 1)
        side = np.tensordot(weight_measured, eq.gram[:, n:, n:], 1) - between.T @ between
        right = weight_measured @ eq.right[:, n:] - between.T @ base
        # Then the nuisances are eliminated in the same way; each block is judged on what is left.
        nuisances = np.linalg.solve(
            side[np.ix_(near, near)] + np.diag(nuisance.precision),
            np.concatenate([side[near], right[near][:, None]], axis=1),
        )
        right = right - side[:, near] @ nuisances[:, -1]
        side = side - side[:, near] @ nuisances[:, :-1]
        for b, block in enumerate(blocks):
            at = block.columns
            coefficients = np.linalg.solve(side[np.ix_(at, at)] + np.diag(block.precision), right[at])
            # Half of c'r: what a least-squares fit with coefficients c lowers half the sum of squares by.
            drops[d, b] = 0.5 * float(coefficients @ right[at])
    return drops


def freedom(
    eq: Equations, block: Block, *, weight: Float[np.ndarray, " s"], measured: Float[np.ndarray, " s"]
) -> float:
    """Degrees of freedom of a block, shrunk by its prior: the trace of its hat matrix."""
    side = eq.pooled(weight, measured).inner[np.ix_(block.columns, block.columns)]
    return float(np.trace(np.linalg.solve(side + np.diag(block.precision), side)))
