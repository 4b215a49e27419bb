"""The null model: the simulation as it is, with its nuisances fitted."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.echo_power import implied_level, with_spread
from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.fit import NOTHING, Fit, Problem, fit
from jaxsim.discover.model.nuisance import START, weights
from jaxsim.discover.model.random_effects import left_over
from jaxsim.effects.rays import Scan
from jaxsim.frame import Array

ROUNDS = 2
"""Of noise given weights and weights given noise."""


@jax.jit
def first_residuals(ev: Evidence) -> tuple[Array, Array]:
    """Residuals of ln I less their median, and of the range (m), before any nuisance; 0 where not compared."""
    off = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, jnp.nan)
    smooth = ev.rays.hit & ev.returned & ~ev.edge
    return jnp.where(ev.compared, off - jnp.nanmedian(off), 0), jnp.where(smooth, ev.range_m - ev.rays.reading_m, 0)


def fit_null(
    scan: Scan, ev: Evidence, fitted: Float[np.ndarray, " b"], *, clutter: bool = False
) -> tuple[Problem, Fit]:
    """Fits noise scales, rates, reflectances and poses of the rays as they stand."""
    noise, off = START, first_residuals(ev)
    for _ in range(ROUNDS):
        w = weights(ev, noise, *off)
        problem = Problem(scan, ev, w, noise, clutter)
        found = fit(NOTHING, problem, fitted, steps=100, enough=1e-3)
        noise = found.noise
        off = left_over(ev, w, jnp.asarray(fitted, jnp.float32))
    w = weights(ev, noise, *off)
    problem = Problem(scan, ev, w, noise, clutter)
    found = fit(NOTHING, problem, fitted, steps=100, enough=1e-3)
    ev = with_spread(ev, found.noise, implied_level(ev, w))
    return replace(problem, ev=ev, noise=found.noise, loss=found.loss), found
