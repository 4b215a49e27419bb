"""How far simulation and measurement are apart, scene by scene: what `gap` holds before and after against each other.

Each channel has an error that an engineer reads off: the mean absolute error of ln I (nats) and of the range (m, at
most 1) on the rays that both sides compare, and the log loss of return (nats a ray). And it has a log-likelihood, in
which effects are named: it also knows scatter, lattices and rare readings, that a mean error does not see.
Nuisances that frames share come from the find scenes; a frame's own (objects, pose) are fitted before and after alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import log_likelihood, log_lost
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.random_effects import NormalEquations, conditional_residuals
from jaxsim.discover.model.rounding import rounding_gain
from jaxsim.frame import Array

UNITS = {
    "intensity": "mean absolute error of ln I",
    "range": "mean absolute error, m",
    "drop": "log loss of return, nats a ray",
}
CLIP_M = 1.0


@dataclass(frozen=True)
class Distance:
    """Of each judge scene (u) and channel."""

    error: Float[np.ndarray, "u 3"]
    """In UNITS; NaN where nothing is compared."""
    log_likelihood: Float[np.ndarray, "u 3"]
    """Nats."""


def distance(
    problem: Problem, fitted: Float[np.ndarray, " b"], equations: NormalEquations, unit: np.ndarray
) -> Distance:
    """Of the units of those blocks that are not fitted. Likelihoods are to be held against each other at the same
    `equations`, as in naming: a problem's own would price reflectances and poses differently."""
    judged = np.asarray(fitted) == 0
    shared = jnp.asarray(fitted, jnp.float32)
    off = conditional_residuals(problem.ev, problem.equations, shared)
    errors = np.asarray(_errors(problem.ev, problem.noise, *off))
    score = np.asarray(
        log_likelihood(problem.ev, problem.noise, equations=equations, fitted=shared, clutter=problem.clutter)
    )
    rays = problem.ev.rays
    steps = {"intensity_quantization": float(rays.intensity_step), "range_quantization": float(rays.range_step_m)}
    score = score + rounding_gain(problem.ev, steps)
    units, place = np.unique(unit[judged], return_inverse=True)
    total, scores = np.zeros((len(units), 3, 2)), np.zeros((len(units), 3))
    np.add.at(total, place, errors[judged])
    np.add.at(scores, place, score[judged])
    with np.errstate(invalid="ignore"):
        return Distance(np.where(total[..., 1] > 0, total[..., 0] / np.maximum(total[..., 1], 1), np.nan), scores)


@jax.jit
def _errors(
    ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]
) -> Float[Array, "b 3 2"]:
    """Sums and counts of each block's errors by channel."""
    rays, smooth = ev.rays, ev.rays.hit & ev.returned & ~ev.edge
    gone = jnp.clip(rays.column_loss, 0, 0.999)
    lost = jnp.logaddexp(jnp.log1p(-gone) + log_lost(rays, ev, noise), jnp.log(gone + 1e-9))
    lost = jnp.clip(lost, -30.0, -1e-7)
    miss = -jnp.where(ev.returned, jnp.log(-jnp.expm1(lost)), lost)
    wrong = jnp.minimum(jnp.abs(off_r), CLIP_M)
    pairs = ((jnp.abs(off_i), ev.compared), (wrong, smooth), (miss, rays.hit))
    sums = [jnp.where(counts, x, 0).sum((1, 2)) for x, counts in pairs]
    counts = [counts.sum((1, 2)).astype(jnp.float32) for _, counts in pairs]
    return jnp.stack([jnp.stack(sums, -1), jnp.stack(counts, -1)], axis=-1)
