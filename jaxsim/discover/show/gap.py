"""How far simulation and measurement are apart on judge scenes, which nothing was fitted to, before and after.

Each channel has an error that an engineer reads off: the mean absolute error of ln I (nats) and of the range (m, at
most 1) on the rays that both sides compare, and the log loss of return (nats a ray). And it has a log-likelihood, in
which effects are named: it also knows scatter, lattices and rare readings, that a mean error does not see.
Nuisances that frames share come from the find scenes; a frame's own (objects, pose) are fitted before and after alike.

Each scene is its own pair: intervals are those of its differences (`scenes`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import CHANNELS, log_likelihood, log_lost
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.random_effects import NormalEquations, conditional_residuals
from jaxsim.discover.model.rounding import rounding_gain
from jaxsim.discover.scenes import mean_interval, ratio_interval
from jaxsim.discover.verdict import Gained, Gap, Interval
from jaxsim.frame import Array

UNITS = {
    "intensity": "mean absolute error of ln I",
    "range": "mean absolute error, m",
    "drop": "log loss of return, nats a ray",
}
CLIP_M = 1.0
"""Error of a range that counts at most: a reading of another surface is as wrong as any."""


@dataclass(frozen=True)
class Distance:
    """The distance of each judge scene (s) in each channel."""

    error: Float[np.ndarray, "s 3"]
    """In UNITS; NaN where nothing is compared."""
    log_likelihood: Float[np.ndarray, "s 3"]
    """Nats."""


def distance(
    problem: Problem, fitted: Float[np.ndarray, " b"], eq: NormalEquations, *, scene: Int[np.ndarray, " b"]
) -> Distance:
    """The distance of the scenes of those blocks that are not fitted. Likelihoods are to be held against each other at
    the same weights `eq`, as in naming: a problem's own would price reflectances and poses differently."""
    judged = np.asarray(fitted) == 0
    shared = jnp.asarray(fitted, jnp.float32)
    off = conditional_residuals(problem.ev, problem.equations, shared)
    errors = np.asarray(_errors(problem.ev, problem.noise, *off))
    score = np.asarray(log_likelihood(problem.ev, problem.noise, equations=eq, fitted=shared, clutter=problem.clutter))
    rays = problem.ev.rays
    steps = {"intensity_quantization": float(rays.intensity_step), "range_quantization": float(rays.range_step_m)}
    score = score + rounding_gain(problem.ev, steps)
    scenes, index = np.unique(scene[judged], return_inverse=True)
    total = np.zeros((len(scenes), 3, 2))
    scores = np.zeros((len(scenes), 3))
    np.add.at(total, index, errors[judged])
    np.add.at(scores, index, score[judged])
    with np.errstate(invalid="ignore"):
        return Distance(np.where(total[..., 1] > 0, total[..., 0] / np.maximum(total[..., 1], 1), np.nan), scores)


@jax.jit
def _errors(
    ev: Evidence, noise: Noise, off_i: Float[Array, "b c r"], off_r: Float[Array, "b c r"]
) -> Float[Array, "b 3 2"]:
    """Sums and counts of each block's errors by channel."""
    rays, smooth = ev.rays, ev.rays.hit & ev.returned & ~ev.edge
    # A ray does not return where its whole packet is lost, or of its own.
    gone = jnp.clip(rays.column_loss, 0, 0.999)
    lost = jnp.logaddexp(jnp.log1p(-gone) + log_lost(rays, ev, noise), jnp.log(gone + 1e-9))
    lost = jnp.clip(lost, -30.0, -1e-7)
    miss = -jnp.where(ev.returned, jnp.log(-jnp.expm1(lost)), lost)
    wrong = jnp.minimum(jnp.abs(off_r), CLIP_M)
    pairs = ((jnp.abs(off_i), ev.compared), (wrong, smooth), (miss, rays.hit))
    sums = [jnp.where(counts, x, 0).sum((1, 2)) for x, counts in pairs]
    counts = [counts.sum((1, 2)).astype(jnp.float32) for _, counts in pairs]
    return jnp.stack([jnp.stack(sums, -1), jnp.stack(counts, -1)], axis=-1)


def gaps(before: Distance, after: Distance, *, placebo: Distance, floor: Distance) -> dict[str, Gap]:
    """By channel: mean errors, and what the log-likelihood gains."""
    result = {}
    for k, name in enumerate(CHANNELS):
        shrunk = before.error[:, k] - after.error[:, k]
        gain = _gain(before, after)[:, k]
        gained = Gained(
            float(gain.mean()),
            *mean_interval(gain),
            floor=float(_gain(before, floor)[:, k].mean()),
            placebo=float(_gain(before, placebo)[:, k].mean()),
            win_rate=float((gain > 0).mean()),
        )
        result[name] = Gap(
            float(np.nanmean(before.error[:, k])),
            float(np.nanmean(after.error[:, k])),
            *mean_interval(shrunk),
            unit=UNITS[name],
            floor=float(np.nanmean(floor.error[:, k])),
            placebo=float(np.nanmean(placebo.error[:, k])),
            win_rate=float(np.nanmean(shrunk > 0)),
            gained=gained,
        )
    return result


def closure(before: Distance, after: Distance, *, floor: Distance, channels: Iterable[str]) -> Interval | None:
    """What the log-likelihood of the named effects' channels gains, as a share of what it gains with free curves (the
    floor); none where the scenes do not agree that these gain anything."""
    used = [k for k, name in enumerate(CHANNELS) if name in set(channels)]
    gain = _gain(before, after)[:, used].sum(1)
    room = _gain(before, floor)[:, used].sum(1)
    if not used or not mean_interval(room)[0] > 0:
        return None
    ends = ratio_interval(gain, room)
    return Interval(float(gain.sum() / room.sum()), *ends, "share of what free curves gain")


def _gain(before: Distance, after: Distance) -> Float[np.ndarray, "s 3"]:
    return after.log_likelihood - before.log_likelihood
