"""Residuals of a problem, summed by scene on the polar grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.lattice import FINEST, lattice_step
from jaxsim.discover.model.noise import DEGREES
from jaxsim.discover.model.random_effects import conditional_residuals
from jaxsim.discover.model.residuals import spread
from jaxsim.discover.rules import RULES
from jaxsim.effects.rays import FLOOR

Sums = Float[np.ndarray, "n r c"]
Pattern = Float[np.ndarray, "r c"]
SMALL = 0.1
"""Height of a made pattern, nats and m: far from where levels and poses are clipped."""
COIN = 0.01
"""Variance that every return has at least, so that no ray that surely returns decides."""


@dataclass(frozen=True)
class Maps:
    """One channel of n scenes. Rays that are not looked at count nothing: only some columns of each frame are."""

    weight: Sums
    """Sum over the rays of each cell of 1 / variance in the channel's unit."""
    total: Sums
    """Weight times residual."""
    response: Callable[[Pattern], Sums]
    """What `total` would be if the residuals were a pattern (in the channel's unit) and nothing else, levels and poses
    fitted to it."""
    coarse: Pattern | None = None
    """What rounding may be off by in each cell, in the channel's unit: half a step a side. Where streets are
    alike, on the road, it repeats. None where nothing is rounded."""

    def rounding(self, pattern: Pattern) -> float:
        """How high rounding may make this pattern: `coarse` in its cells, root mean square."""
        if self.coarse is None:
            return 0.0
        counts = self.weight.sum(0) * pattern**2
        return float(np.sqrt((counts * self.coarse**2).sum() / max(counts.sum(), 1e-12)))

    def centred(self, total: Sums) -> Sums:
        """Each scene's weighted mean taken out: a level is no pattern, and would leak between uneven columns."""
        whole = self.weight.sum((1, 2), keepdims=True)
        return total - self.weight * total.sum((1, 2), keepdims=True) / np.maximum(whole, 1e-12)

    @classmethod
    def plain(cls, weight: Sums, residual: Sums) -> Maps:
        """Maps of residuals that no level takes up."""
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
    # Cells of all scenes in one long vector: sums by cell are one pass over the rays.
    cell = np.ravel_multi_index((of_scene, row, column), shape).ravel()
    blocks = np.asarray(fitted, np.float32)

    def summed(values: np.ndarray) -> Sums:
        flat = np.where(np.isfinite(values), values, 0).ravel()
        return np.bincount(cell, flat, minlength=int(np.prod(shape))).reshape(shape)

    sd_i, sd_r, p = spread(ev, problem.noise)
    p = np.asarray(p, np.float64)
    hit = np.asarray(ev.rays.hit)
    weight_i = np.asarray(eq.intensity, np.float64)
    weight_r = np.asarray(eq.range_, np.float64)
    # A lost ray is a coin: residual lost - p, variance p (1 - p).
    weight_d = np.where(hit, 1 / (p * (1 - p) + COIN), 0)
    off_i, off_r = conditional_residuals(ev, eq, blocks)

    def left_of(channel: int, weight: np.ndarray, variance: np.ndarray) -> Callable[[Pattern], Sums]:
        steeper = 1 - robust_slope(weight, variance)

        # Residuals if measured and simulated differed by the pattern alone: what levels and poses leave of it.
        def only(made: np.ndarray) -> np.ndarray:
            shift = made.astype(np.float32)
            alone = replace(ev, log_intensity=ev.rays.log_intensity + shift, range_m=ev.rays.reading_m + shift)
            return np.asarray(conditional_residuals(alone, eq, blocks)[channel], np.float64)

        def response(pattern: Pattern) -> Sums:
            made = SMALL * pattern[row, column]
            # What stays of it in the residuals makes weights smaller, on the side to which it points.
            return summed(weight * only(made - steeper * only(made)) / SMALL)

        return response

    def coarse(weight: np.ndarray, *, half_step: float, value: np.ndarray) -> Pattern | None:
        if half_step == 0:
            return None
        squares = summed(weight * (half_step / value) ** 2).sum(0)
        return np.sqrt(squares / np.maximum(summed(weight).sum(0), 1e-12))

    half = half_steps(ev)
    # Ln I of a reading is off by its rounding over its size: dark cells are coarse.
    light = np.maximum(np.exp(np.asarray(ev.rays.log_intensity, np.float64)), FLOOR)
    lost = ~np.asarray(ev.returned) - p
    return {
        "intensity": Maps(
            summed(weight_i),
            summed(weight_i * np.asarray(off_i, np.float64)),
            left_of(0, weight_i, np.asarray(sd_i, np.float64) ** 2),
            coarse(weight_i, half_step=half["intensity"], value=light),
        ),
        "range": Maps(
            summed(weight_r),
            summed(weight_r * np.asarray(off_r, np.float64)),
            left_of(1, weight_r, np.asarray(sd_r, np.float64) ** 2),
            coarse(weight_r, half_step=half["range"], value=np.ones_like(light)),
        ),
        "drop": Maps(
            summed(weight_d), summed(weight_d * lost), lambda pattern: summed(weight_d * pattern[row, column])
        ),
    }


def half_steps(ev: Evidence) -> dict[str, float]:
    """Half a step of the simulator's lattice plus half a step of the sensor's: of intensities, and of ranges in m; 0
    where neither rounds."""
    returned = np.asarray(ev.returned)
    readings = {"intensity": ev.intensity, "range": np.asarray(ev.range_m)}
    steps = {}
    for own, (channel, values) in zip(np.asarray(ev.own_step).tolist(), readings.items(), strict=True):
        seen = values[returned]
        step = lattice_step(
            seen[:: max(1, len(seen) // RULES.pair_residuals)], finest=FINEST[f"{channel}_quantization"]
        )
        steps[channel] = (own + step) / 2
    return steps


def robust_slope(weight: np.ndarray, variance: np.ndarray) -> float:
    """How much a small shift of all residuals changes weight times residual, over the weight: less than 1, since a
    Student-t's weight (DEGREES + 1) / (DEGREES + z^2) / variance falls with the residual."""
    share = weight * np.broadcast_to(variance, weight.shape)
    slope = 2 * DEGREES / (DEGREES + 1) * share - 1
    return float((weight * slope).sum() / max(weight.sum(), 1e-12))
