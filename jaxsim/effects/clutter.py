"""Early false returns, as fog, rain and other LiDARs make them: their law, and draws of it."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.effects.edits import either
from jaxsim.effects.rays import Array, Rays

_NODES = 48
"""Nodes at which the distribution of clutter is inverted, even in log range."""


def add_clutter(
    rays: Rays, probability: Array, *, power: float, scale_m: Array, from_m: float, intensity: Array
) -> Rays:
    """Adds a false return with a probability, at a range of density r**power exp(-r / scale) from `from_m` on.

    A ray keeps one law of ranges: the likelier one, where several effects make clutter.
    """
    likelier = probability >= rays.clutter

    def chosen(new: Array, old: Array) -> Array:
        return jnp.where(likelier, jnp.broadcast_to(jnp.asarray(new, old.dtype), old.shape), old)

    return replace(
        rays,
        clutter=either(rays.clutter, jnp.broadcast_to(probability, rays.clutter.shape)),
        clutter_power=chosen(power, rays.clutter_power),
        clutter_scale_m=chosen(scale_m, rays.clutter_scale_m),
        clutter_from_m=chosen(from_m, rays.clutter_from_m),
        clutter_log_intensity=chosen(jnp.log(intensity), rays.clutter_log_intensity),
    )


def clutter_range(chance: Float[Array, "*n"], rays: Rays, end_m: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The range below which that share of the rays' clutter lies, of density r**power exp(-r / scale) from
    `clutter_from_m` to `end_m`."""
    # No closed form inverts this density: the integral is taken at nodes, once for all rays.
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
    # The last node that the wanted mass has passed; between it and the next the mass grows evenly.
    below = jnp.clip(jnp.sum(mass <= wanted[None], axis=0) - 1, 0, _NODES - 2)

    def at(table: Array, index: Array) -> Array:
        return jnp.take_along_axis(table, index[None], axis=0)[0]

    low, high = at(mass, below), at(mass, below + 1)
    part = (wanted - low) / jnp.maximum(high - low, 1e-20)
    return jnp.exp(start + (below.astype(jnp.float32) + part) / (_NODES - 1) * width)
