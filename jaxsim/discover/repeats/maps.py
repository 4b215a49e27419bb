"""Residuals of a problem, summed by scene on the polar grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.noise import DEGREES
from jaxsim.discover.model.random_effects import conditional_residuals
from jaxsim.discover.model.residuals import spread

Sums = Float[np.ndarray, "n r c"]
Pattern = Float[np.ndarray, "r c"]
SMALL = 0.1
"""Of a made pattern, nats and m: far from where levels and poses are clipped."""
COIN = 0.01
"""Variance that every return has at least, so that no ray that surely returns decides."""


@dataclass(frozen=True)
class Maps:
    """One channel of n scenes. Rays that are not looked at count nothing: only some columns of each frame are."""

    weight: Sums
    """Of the rays of each cell, 1 / variance in the channel's unit."""
    total: Sums
    """Weight times residual."""
    left: Callable[[Pattern], Sums]
    """What `total` would be if the residuals were a pattern (in the channel's unit) and nothing else, levels and poses
    fitted to it."""

    def centred(self, total: Sums) -> Sums:
        """Each scene's weighted mean taken out: a level is no pattern, and would leak between uneven columns."""
        whole = self.weight.sum((1, 2), keepdims=True)
        return total - self.weight * total.sum((1, 2), keepdims=True) / np.maximum(whole, 1e-12)

    @classmethod
    def plain(cls, weight: Sums, residual: Sums) -> Maps:
        """Of residuals that no level takes up."""
        return cls(weight, weight * residual, lambda pattern: weight * pattern)


def maps_of(
    problem: Problem, fitted: Float[np.ndarray, " b"], scene: Int[np.ndarray, " b"], *, columns: int
) -> dict[str, Maps]:
    """The maps of each channel: ln I in nats, range in m, and share of rays lost minus expected; shared levels follow
    from the `fitted` blocks. `scene` is that of each block, `columns` the grid's."""
    ev, eq = problem.ev, problem.equations
    row, column = np.asarray(ev.rays.row), np.asarray(ev.rays.column)
    of_scene = np.broadcast_to(scene[:, None, None], row.shape)
    shape = (int(scene.max()) + 1, row.shape[-1], columns)
    cell = np.ravel_multi_index((of_scene, row, column), shape).ravel()
    blocks = jnp.asarray(fitted, jnp.float32)

    def summed(values: np.ndarray) -> Sums:
        flat = np.where(np.isfinite(values), values, 0).ravel()
        return np.bincount(cell, flat, minlength=int(np.prod(shape))).reshape(shape)

    sd_i, sd_r, p = (np.asarray(one, np.float64) for one in spread(ev, problem.noise))
    hit = np.asarray(ev.rays.hit)
    weight_i = np.asarray(eq.intensity, np.float64)
    weight_r = np.asarray(eq.range_, np.float64)
    weight_d = np.where(hit, 1 / (p * (1 - p) + COIN), 0)
    off_i, off_r = (np.asarray(off, np.float64) for off in conditional_residuals(ev, eq, blocks))

    def left_of(channel: int, weight: np.ndarray, variance: np.ndarray) -> Callable[[Pattern], Sums]:
        steeper = 1 - robust_slope(weight, variance)

        def only(made: np.ndarray) -> np.ndarray:
            shift = jnp.asarray(made, jnp.float32)
            alone = replace(ev, log_intensity=ev.rays.log_intensity + shift, range_m=ev.rays.reading_m + shift)
            return np.asarray(conditional_residuals(alone, eq, blocks)[channel], np.float64)

        def left(pattern: Pattern) -> Sums:
            made = SMALL * pattern[row, column]
            # What stays of it in the residuals makes weights smaller, on the side to which it points.
            return summed(weight * only(made - steeper * only(made)) / SMALL)

        return left

    lost = ~np.asarray(ev.returned) - p
    return {
        "intensity": Maps(summed(weight_i), summed(weight_i * off_i), left_of(0, weight_i, sd_i**2)),
        "range": Maps(summed(weight_r), summed(weight_r * off_r), left_of(1, weight_r, sd_r**2)),
        "drop": Maps(
            summed(weight_d), summed(weight_d * lost), lambda pattern: summed(weight_d * pattern[row, column])
        ),
    }


def robust_slope(weight: np.ndarray, variance: np.ndarray) -> float:
    """By how much a small shift of all residuals changes weight times residual, over the weight: less than 1, since a
    Student-t's weight (DEGREES + 1) / (DEGREES + z^2) / variance falls with the residual."""
    share = weight * np.broadcast_to(variance, weight.shape)
    slope = 2 * DEGREES / (DEGREES + 1) * share - 1
    return float((weight * slope).sum() / max(weight.sum(), 1e-12))
