"""Early false returns, as fog, rain and other LiDARs make them."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.edits import either
from jaxsim.effects.rays import Array, Rays


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
