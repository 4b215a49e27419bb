"""Residuals of a problem by channel, on a common scale and in their own units."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import CHANNELS, MOST_LIKELY, log_lost
from jaxsim.discover.model.noise import Noise, intensity_variance, reading_variance
from jaxsim.discover.model.random_effects import conditional_residuals
from jaxsim.effects.rays import Rays
from jaxsim.frame import Array

CLIP = 4.0
"""Standardised residuals are held within this."""


@jax.jit
def spread(ev: Evidence, noise: Noise) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Standard deviations of ln I (nats) and of the range (m); and the probability that a ray does not return."""
    gone = jnp.clip(ev.rays.column_loss, 0, MOST_LIKELY)
    # Lost with its column, or else alone.
    p = jnp.clip(gone + (1 - gone) * jnp.exp(log_lost(ev.rays, ev, noise)), 1e-4, 1 - 1e-4)
    return jnp.sqrt(intensity_variance(ev, noise)), jnp.sqrt(reading_variance(ev.rays, ev, noise)), p


class Residuals(NamedTuple):
    """One channel's residuals, ray by ray."""

    off: Float[np.ndarray, "b c r"]
    """The residual in its own unit: nats, m, or share lost."""
    z: Float[np.ndarray, "b c r"]
    """The residual over its standard deviation; of drops, over that of a coin of its probability."""
    counts: Bool[np.ndarray, "b c r"]
    """Where the two mean something."""


def residuals(problem: Problem, fitted: Float[np.ndarray, " b"]) -> dict[str, Residuals]:
    """The residuals of each channel; shared levels follow from the `fitted` blocks. z has standard deviation 1 where it
    counts."""
    ev = problem.ev
    off_i, off_r = conditional_residuals(ev, problem.equations, jnp.asarray(fitted, jnp.float32))
    sd_i, sd_r, p = spread(ev, problem.noise)
    by_channel = {
        "intensity": (off_i, sd_i, ev.compared),
        "range": (off_r, sd_r, ev.smooth),
        "drop": ((~ev.returned).astype(jnp.float32) - p, jnp.sqrt(p * (1 - p)), ev.rays.hit),
    }
    return {name: _standardised(*map(np.asarray, by_channel[name]), heavy_tails=name != "drop") for name in CHANNELS}


def _standardised(
    off: Float[np.ndarray, "b c r"],
    sd: Float[np.ndarray, "b c r"],
    counts: Bool[np.ndarray, "b c r"],
    *,
    heavy_tails: bool,
) -> Residuals:
    z = off / sd
    # Heavy tails must not decide; a lost ray is as far off as its probability says.
    if heavy_tails:
        z = np.clip(z, -CLIP, CLIP)
    return Residuals(off, z / max(float(z[counts].std()), 1e-3) if counts.any() else z, counts)


def standardised(
    problem: Problem, fitted: Float[np.ndarray, " b"]
) -> tuple[Rays, dict[str, tuple[Float[np.ndarray, "b c r"], Bool[np.ndarray, "b c r"]]]]:
    """Rays on the host; each channel's standardised residuals and where they count."""
    host = jax.tree.map(np.asarray, problem.ev.rays)
    return host, {name: (one.z, one.counts) for name, one in residuals(problem, fitted).items()}
