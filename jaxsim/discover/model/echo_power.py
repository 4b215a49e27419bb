"""What the measured intensities say of the power of echoes, which no file holds.

The simulator's power rests on its table of reflectances, and on its angles. How far it is off, the intensities tell:
surface by surface on average, and ray by ray as a spread.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.nuisance import Noise, Weights, intensity_variance
from jaxsim.discover.model.random_effects import left_over

FEW = 5.0
"""Compared rays up to which a surface is thought to be like its class, and a class like all."""


def implied_level(ev: Evidence, w: Weights) -> Float[np.ndarray, "b c r"]:
    """Nats by which each ray's surface is brighter than simulated: of its compared rays, its class's where it has few,
    all rays' where the class has few. 0 where nothing is hit."""
    off = jnp.where(ev.compared, ev.log_intensity - ev.rays.log_intensity, 0)
    explained = np.asarray(off - left_over(ev, w, jnp.ones(len(ev.unit), jnp.float32))[0], float)
    hit, compared = np.asarray(ev.rays.hit), np.asarray(ev.compared)
    level = np.full(hit.shape, explained[compared].mean() if compared.any() else 0.0)
    for group in (np.asarray(ev.rays.semantic), np.asarray(ev.surface)[np.asarray(ev.strip)]):
        _, of = np.unique(group, return_inverse=True)
        of = of.reshape(-1)
        own, count = (np.bincount(of, x.reshape(-1)) for x in (np.where(compared, explained, 0), compared))
        beyond = np.bincount(of, np.where(compared, level, 0).reshape(-1)) / np.maximum(count, 1)
        # FEW rays' worth of what is known already holds a group of few rays there.
        level = level + ((own - count * beyond) / (count + FEW))[of].reshape(hit.shape)
    return np.where(hit, level, 0)


def with_spread(ev: Evidence, noise: Noise, level: Float[np.ndarray, "b c r"] | None = None) -> Evidence:
    """Rays that know how uncertain their power is: what intensities scatter by, ray by ray, and, where `level` is given
    and stays uncorrected, what surfaces differ by."""
    variance, hit = intensity_variance(ev, noise), np.asarray(ev.rays.hit)
    if level is not None and hit.any():
        variance = variance + float(np.var(level[hit]))
    return replace(ev, rays=replace(ev.rays, log_power_sd=jnp.sqrt(variance).astype(jnp.float32)))


def as_implied(ev: Evidence, noise: Noise, w: Weights) -> Evidence:
    """Rays as bright as the measured intensities say that their surfaces are."""
    level = jnp.asarray(implied_level(ev, w), jnp.float32)
    rays = replace(ev.rays, log_power=ev.rays.log_power + level, log_intensity=ev.rays.log_intensity + level)
    return with_spread(replace(ev, rays=rays), noise)
