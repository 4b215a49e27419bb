"""How strongly scenes and sectors ask for an effect: slope and curvature of their likelihood along the fitted one.

Let the effect be applied by a share k, 0 none of it and 1 as it was fitted: fields of the rays go along a line. The
slope of the log-likelihood in k is a sum over rays, for the gradient in their fields is at hand and already knows what
levels and poses would take up. Its change from k = 0 to 1 is the curvature. So any part of the rays has a size of its
own, 1 + slope(1) / curvature, at the price of two gradients.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.fit import Objective, Problem
from jaxsim.discover.model.gradients import EffectGradient, Fields, effect_with_gradient
from jaxsim.discover.model.noise import Noise
from jaxsim.effects import Law
from jaxsim.frame import Array


@dataclass(frozen=True)
class Cells:
    """Rays of each block (b) and sector (a) together."""

    slope: Float[np.ndarray, "b a"]
    """Slope of the log-likelihood in the effect's share, where it is in place: nats. Positive asks for more of it."""
    curvature: Float[np.ndarray, "b a"]
    """What the slope falls by from none of the effect to all of it."""

    @property
    def excess(self) -> Float[np.ndarray, "b a"]:
        """The slope, less what all cells would have if one size served them all."""
        return self.slope - self.curvature * self.slope.sum() / max(self.curvature.sum(), 1e-9)

    def folded(self) -> Cells:
        """Neighbouring pairs of sectors as one."""
        return Cells(self.slope[:, ::2] + self.slope[:, 1::2], self.curvature[:, ::2] + self.curvature[:, 1::2])


def cells(
    effect: Law,
    problem: Problem,
    *,
    z: dict[str, np.ndarray],
    noise: Noise,
    sector: Int[np.ndarray, "b c"],
    sectors: int,
) -> Cells:
    """The cells of an effect, fitted as `z` on top of `problem`; `sector`, of so many, is that of blocks' columns."""
    objective = Objective(effect, problem, problem.ev.all_blocks)
    neutral, _ = objective.restore(objective.first)
    before = effect_with_gradient(effect, neutral, objective.rays, scan=problem.scan)
    after = effect_with_gradient(effect, z, objective.rays, scan=problem.scan)
    # Of rays that meet another surface there is no share.
    same = before.constant["hit"] == after.constant["hit"]

    def slope_at(state: EffectGradient) -> Float[np.ndarray, "b a"]:
        by_fields = objective.gradient_at(state.fields, state.constant, noise).by_fields
        of_rays = _slope(by_fields, before.fields, after.fields, same=same)
        # In float64: cells are differences of sums over thousands of rays.
        total = np.zeros((len(sector), sectors))
        np.add.at(total, (np.arange(len(sector))[:, None], sector), np.asarray(of_rays, np.float64).sum(-1))
        return total

    # Two gradients stand for a second derivative: along the line the likelihood is close to a parabola.
    slope = slope_at(after)
    curvature = slope_at(before) - slope
    # A cell of few rays may bend upwards by chance; it then counts for next to nothing.
    least = 0.01 * max(float(curvature.mean()), 1e-6)
    return Cells(slope, np.maximum(curvature, least))


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
