"""Residuals of a problem by channel, on a common scale and in their own units."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import Problem
from jaxsim.discover.model.likelihood import CHANNELS, log_lost
from jaxsim.discover.model.nuisance import Noise, intensity_variance, reading_variance
from jaxsim.discover.model.random_effects import left_over
from jaxsim.frame import Array

CLIP = 4.0
"""Standardised residuals are held within this."""


@jax.jit
def spread(ev: Evidence, noise: Noise) -> tuple[Array, Array, Array]:
    """Standard deviations of ln I (nats) and of the range (m); and the probability that a ray does not return."""
    gone = jnp.clip(ev.rays.column_loss, 0, 0.999)
    p = jnp.clip(gone + (1 - gone) * jnp.exp(log_lost(ev.rays, ev, noise)), 1e-4, 1 - 1e-4)
    return jnp.sqrt(intensity_variance(ev, noise)), jnp.sqrt(reading_variance(ev.rays, ev, noise)), p


def residuals(
    problem: Problem, fitted: Float[np.ndarray, " b"]
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """By channel: residuals in their own unit (nats, m, share lost), standardised ones, and where they count."""
    ev = problem.ev
    off_i, off_r = left_over(ev, problem.weights, jnp.asarray(fitted, jnp.float32))
    sd_i, sd_r, p = spread(ev, problem.noise)
    found = {
        "intensity": (off_i, sd_i, ev.compared),
        "range": (off_r, sd_r, ev.rays.hit & ev.returned & ~ev.edge),
        "drop": ((~ev.returned).astype(jnp.float32) - p, jnp.sqrt(p * (1 - p)), ev.rays.hit),
    }
    result = {}
    for name in CHANNELS:
        off, sd, counts = found[name]
        off, sd, counts = np.asarray(off), np.asarray(sd), np.asarray(counts)
        z = off / sd
        if name != "drop":
            z = np.clip(z, -CLIP, CLIP)
        result[name] = (off, z / max(float(z[counts].std()), 1e-3) if counts.any() else z, counts)
    return result


def standardised(
    problem: Problem, fitted: Float[np.ndarray, " b"]
) -> tuple[Any, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Rays on the host; each channel's standardised residuals and where they count."""
    host = jax.tree.map(np.asarray, problem.ev.rays)
    return host, {name: (z, counts) for name, (_, z, counts) in residuals(problem, fitted).items()}
