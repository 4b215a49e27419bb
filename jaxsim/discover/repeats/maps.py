"""Residuals of a problem, summed by scene on the polar grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.fit import Problem
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

    p = np.asarray(spread(ev, problem.noise)[2], np.float64)
    hit = np.asarray(ev.rays.hit)
    weight_i = np.asarray(eq.intensity, np.float64)
    weight_r = np.asarray(eq.range_, np.float64)
    weight_d = np.where(hit, 1 / (p * (1 - p) + COIN), 0)
    off_i, off_r = (np.asarray(off, np.float64) for off in conditional_residuals(ev, eq, blocks))

    def left_of(channel: int, weight: np.ndarray) -> Callable[[Pattern], Sums]:
        def left(pattern: Pattern) -> Sums:
            made = jnp.asarray(SMALL * pattern[row, column], jnp.float32)
            only = replace(ev, log_intensity=ev.rays.log_intensity + made, range_m=ev.rays.reading_m + made)
            off = conditional_residuals(only, eq, blocks)[channel]
            return summed(weight * np.asarray(off, np.float64) / SMALL)

        return left

    lost = ~np.asarray(ev.returned) - p
    return {
        "intensity": Maps(summed(weight_i), summed(weight_i * off_i), left_of(0, weight_i)),
        "range": Maps(summed(weight_r), summed(weight_r * off_r), left_of(1, weight_r)),
        "drop": Maps(
            summed(weight_d), summed(weight_d * lost), lambda pattern: summed(weight_d * pattern[row, column])
        ),
    }
