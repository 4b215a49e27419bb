"""What a sensor reports of rays: one draw of all that effects left to chance."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.effects.rays import CLUTTER_REACH_M, Array, Rays
from jaxsim.frame import PolarImage

_NODES = 48
"""Nodes at which the distribution of clutter is inverted, even in log range."""


@partial(jax.jit, static_argnames="columns")
def sample(
    key: Array, rays: Rays, *, noise_m: float | Array = 0.0, noise: float | Array = 0.0, columns: int = 1
) -> PolarImage:
    """Draws what is reported of whole images (*b, rows, columns) of rays.

    In turn: a group of `columns` columns may be lost with all its returns. Else a ray may return early (clutter),
    else a bright target's glare (ghost), else, if it hits and its echo is kept, the surface; at an edge that reading
    may lie between two surfaces. Glare of rays that hit nothing has the intensity of clutter. Then noise, the
    ceiling, rounding. `noise_m` is the sensor's own standard deviation of range, `noise` that of the log intensity.
    """
    keys = jax.random.split(key, 9)
    shape = rays.range_m.shape

    def chance(k: int) -> Array:
        return jax.random.uniform(keys[k], shape)

    end_m = jnp.where(rays.hit, jnp.minimum(rays.range_m, CLUTTER_REACH_M), CLUTTER_REACH_M)
    # Nine keys, one a draw, so that no draw depends on what another decides.
    early = (chance(0) < rays.clutter) & (end_m > rays.clutter_from_m)
    glare = (chance(1) < rays.ghost) & ~early
    surface = (jnp.log(jnp.maximum(chance(2), 1e-30)) < rays.log_keep) | (rays.log_keep >= 0)
    surface = surface & rays.hit & ~early & ~glare
    mixed = chance(3) < rays.between
    share = jnp.where(mixed, chance(4), jnp.zeros(shape))
    reading = rays.reading_m + share * (rays.between_m - rays.reading_m)
    reading = jnp.where(glare, rays.ghost_m, reading)
    reading = jnp.where(early, clutter_range(chance(5), rays, end_m), reading)
    spread = jnp.sqrt(jnp.square(rays.noise_m) + jnp.square(jnp.asarray(noise_m, jnp.float32)))
    reading = _rounded(reading + spread * jax.random.normal(keys[6], shape), rays.range_step_m)

    # What comes of no surface has no surface's intensity.
    false = early | (glare & ~rays.hit)
    log_intensity = jnp.where(false, rays.clutter_log_intensity, rays.log_intensity)
    log_intensity = log_intensity + jnp.asarray(noise, jnp.float32) * jax.random.normal(keys[7], shape)
    intensity = _rounded(jnp.minimum(jnp.exp(log_intensity), rays.intensity_top), rays.intensity_step)
    intensity = jnp.clip(intensity, 0.0, 1.0)

    groups = -(-shape[-1] // columns)
    luck = jax.random.uniform(keys[8], (*shape[:-2], 1, groups))
    lost = jnp.repeat(luck, columns, axis=-1)[..., : shape[-1]] < rays.column_loss
    valid = (surface | glare | early) & ~lost & (reading > 0)
    return PolarImage(jnp.where(valid, reading, 0.0), jnp.where(valid, intensity, 0.0), valid)


def clutter_range(chance: Float[Array, "*n"], rays: Rays, end_m: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The range below which that share of the rays' clutter lies, of density r**power exp(-r / scale) from
    `clutter_from_m` to `end_m`."""
    start = jnp.log(rays.clutter_from_m)
    width = jnp.maximum(jnp.log(end_m) - start, 1e-6)
    node = jnp.linspace(0.0, 1.0, _NODES).reshape((_NODES,) + (1,) * chance.ndim)
    log_r = start[None] + node * width[None]
    # One power more, since nodes are even in log range. The largest is taken out before the exponential.
    log_density = (rays.clutter_power[None] + 1) * log_r - jnp.exp(log_r) / rays.clutter_scale_m[None]
    density = jnp.exp(log_density - jnp.max(log_density, axis=0, keepdims=True))
    mass = jnp.cumsum((density[1:] + density[:-1]) / 2, axis=0)
    mass = jnp.concatenate([jnp.zeros_like(mass[:1]), mass], axis=0)
    wanted = chance * mass[-1]
    below = jnp.clip(jnp.sum(mass <= wanted[None], axis=0) - 1, 0, _NODES - 2)

    def at(table: Array, index: Array) -> Array:
        return jnp.take_along_axis(table, index[None], axis=0)[0]

    low, high = at(mass, below), at(mass, below + 1)
    part = (wanted - low) / jnp.maximum(high - low, 1e-20)
    return jnp.exp(start + (below.astype(jnp.float32) + part) / (_NODES - 1) * width)


def _rounded(value: Float[Array, "*n"], step: Float[Array, ""]) -> Float[Array, "*n"]:
    """The value rounded to multiples of the step; a step of 0 leaves it."""
    safe = jnp.where(step > 0, step, 1.0)
    return jnp.where(step > 0, jnp.round(value / safe) * safe, value)
