"""How strongly every scene and sector asks for an effect.

Let the effect be applied by a share k, 0 none of it and 1 as it was fitted: fields of the rays go along a line. The
slope of the log-likelihood in k is a sum over rays, for the gradient in their fields is at hand and already knows what
levels and poses would take up. Its change from k = 0 to 1 is the curvature. So any part of the rays has a size of its
own, 1 + slope(1) / curvature, at the price of two gradients, where the likelihood is close to a parabola (`sizes` has
those that hold where it is none).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.fit import Fit, Objective, Problem
from jaxsim.discover.model.gradients import EffectGradient, Fields, effect_with_gradient
from jaxsim.discover.model.noise import Noise
from jaxsim.effects import Law
from jaxsim.frame import Array

LEAST_CURVATURE = 0.01
"""Share of the mean curvature that every cell has at least."""


@dataclass(frozen=True)
class Shares:
    """An effect on its way from none of it (before) to what was fitted (after)."""

    objective: Objective
    before: EffectGradient
    after: EffectGradient
    noise: Noise
    """That of the fit."""

    @classmethod
    def of(cls, effect: Law, problem: Problem, result: Fit) -> Shares:
        """The way of an effect that was fitted on top of `problem`."""
        objective = Objective(effect, problem)
        neutral, _ = objective.restore(objective.first)
        before = effect_with_gradient(effect, neutral, objective.rays, scan=problem.scan)
        after = effect_with_gradient(effect, result.z, objective.rays, scan=problem.scan)
        return cls(objective, before, after, result.noise)

    def slope(self, share: float) -> Float[np.ndarray, "b c r"]:
        """The slope of the log-likelihood in the share, ray by ray, where so much of the effect is in place."""
        # Of rays that meet another surface there is no share.
        same = self.before.constant["hit"] == self.after.constant["hit"]
        fields, constant = self._at(share, same)
        by_fields = self.objective.gradient_at(fields, constant, self.noise).by_fields
        # In float64: cells are differences of sums over thousands of rays.
        return np.asarray(_slope(by_fields, self.before.fields, self.after.fields, same=same), np.float64)

    def _at(self, share: float, same: Array) -> tuple[Fields, Fields]:
        if share in (0.0, 1.0):
            state = self.after if share else self.before
            return state.fields, state.constant
        return _between(self.before.fields, self.after.fields, same=same, share=jnp.float32(share)), self.after.constant


@dataclass(frozen=True)
class Cells:
    """Rays of each block (b) and sector (a) together."""

    slope: Float[np.ndarray, "b a"]
    """Slope of the log-likelihood in the effect's share, where it is in place: nats. Positive asks for more of it."""
    curvature: Float[np.ndarray, "b a"]
    """What the slope falls by from none of the effect to all of it."""
    squares: Float[np.ndarray, "b a"]
    """Sum of squares of the rays' own slopes: how far the slope may be by chance. The curvature says as much where the
    size fits; where it is far off, readings lie on the tails of the noise, which hardly bend."""

    @property
    def excess(self) -> Float[np.ndarray, "b a"]:
        """The slope, less what all cells would have if one size served them all."""
        return self.slope - self.curvature * self.slope.sum() / max(self.curvature.sum(), 1e-9)

    def folded(self) -> Cells:
        """Neighbouring pairs of sectors as one."""

        def pairs(part: Float[np.ndarray, "b a"]) -> Float[np.ndarray, "b h"]:
            return part[:, ::2] + part[:, 1::2]

        return Cells(pairs(self.slope), pairs(self.curvature), pairs(self.squares))


def cells_of(effect: Law, problem: Problem, result: Fit, *, sector: Int[np.ndarray, "b c"], sectors: int) -> Cells:
    """The cells of an effect that was fitted on top of `problem`; `sector`, of so many, is that of blocks' columns."""
    shares = Shares.of(effect, problem, result)
    of_rays = shares.slope(1.0)
    slope = summed(of_rays, sector, sectors)
    # Two gradients stand for a second derivative.
    curvature = summed(shares.slope(0.0), sector, sectors) - slope
    # A cell of few rays may bend upwards by chance; it then counts for next to nothing.
    least = LEAST_CURVATURE * max(float(curvature.mean()), 1e-6)
    return Cells(slope, np.maximum(curvature, least), summed(of_rays**2, sector, sectors))


def summed(
    of_rays: Float[np.ndarray, "b c r"], sector: Int[np.ndarray, "b c"], sectors: int
) -> Float[np.ndarray, "b a"]:
    """Sums over the rays of each block and sector."""
    total = np.zeros((len(sector), sectors))
    np.add.at(total, (np.arange(len(sector))[:, None], sector), of_rays.sum(-1))
    return total


@jax.jit
def _between(before: Fields, after: Fields, *, same: Array, share: Float[Array, ""]) -> Fields:
    """The rays' fields with a share of an effect; of rays without one, those with all of it."""

    def mixed(name: str) -> Array:
        change = after[name] - before[name]
        has = jnp.isfinite(change) & (same if jnp.ndim(change) == same.ndim else True)
        return jnp.where(has, before[name] + share * change, after[name])

    return {name: mixed(name) for name in after}


@jax.jit
def _slope(by_fields: Fields, before: Fields, after: Fields, *, same: Array) -> Float[Array, "b c r"]:
    """The log-likelihood's slope along the way between two states of the rays, ray by ray."""
    total = jnp.zeros(same.shape)
    for name, gradient in by_fields.items():
        change = after[name] - before[name]
        # Numbers of all rays together belong to no cell.
        if jnp.ndim(change) == same.ndim:
            total = total - jnp.where(same & jnp.isfinite(change) & (change != 0), gradient * change, 0.0)
    return total
