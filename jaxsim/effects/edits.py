"""The few ways in which effects change rays, and the safe functions that their formulas share; among them early false
returns, as fog, rain and other LiDARs make them: their law, and draws of it.

Everything here has finite derivatives for every ray, also where nothing is hit or the surface is seen edge on.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.effects.rays import Array, Rays
from jaxsim.frame import CLASSES

LEAST_COSINE = 0.02
# ln(1 - p) and its slope stay finite.
MOST_PROBABLE = 0.999
_LEAST_ADDED = 1e-12
_NODES = 48
"""Nodes at which the distribution of clutter is inverted, even in log range."""


def cosine(rays: Rays) -> Float[Array, "*n"]:
    """The cosine of the incidence angle, kept above 0.02 so that its logarithm and slope stay finite."""
    return jnp.maximum(jnp.cos(rays.incidence_rad), LEAST_COSINE)


def tangent(rays: Rays) -> Float[Array, "*n"]:
    """The tangent of the incidence angle, at most 50."""
    return jnp.sin(rays.incidence_rad) / cosine(rays)


def wrapped(angle_rad: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The angle brought to -pi..pi."""
    # By rounding, not by a remainder: the derivative is 1 everywhere.
    return angle_rad - 2 * jnp.pi * jnp.round(angle_rad / (2 * jnp.pi))


def bump(angle_rad: Float[Array, "*n"], width_rad: Float[Array, ""]) -> Float[Array, "*n"]:
    """exp(-(angle / width)**2 / 2) of an angle taken modulo a turn."""
    return jnp.exp(-0.5 * jnp.square(wrapped(angle_rad) / width_rad))


def displace(
    rays: Rays,
    *,
    turn_rad: tuple[Float[Array, "*n"], Float[Array, "*n"]] | None = None,
    move_m: tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]] | None = None,
) -> Rays:
    """Turns rays further (azimuth, elevation) and moves their origins (x, y, z in `velo`); what they then meet is
    for `recast` to say."""
    turned, moved = rays.turned_rad, rays.moved_m
    if turn_rad is not None:
        turned = turned + jnp.stack(turn_rad, axis=-1)
    if move_m is not None:
        moved = moved + jnp.stack(move_m, axis=-1)
    return replace(rays, turned_rad=turned, moved_m=moved)


def move_sensor(rays: Rays, to_m: tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]) -> Rays:
    """Moves the sensor as a whole (x, y, z in `velo`, of all rays or of each frame): each ray slides along its plane
    where `Rays.origin_slope` says how, else it is cast again (`displace`)."""
    x, y, z = to_m
    if rays.origin_slope is not None:
        along_x, along_y, along_z = jnp.moveaxis(rays.origin_slope, -1, 0)
        return misread(rays, x * along_x + y * along_y + z * along_z)
    one = jnp.ones_like(rays.range_m)
    return displace(rays, move_m=(x * one, y * one, z * one))


def brighten(rays: Rays, nats: Float[Array, "*n"]) -> Rays:
    """Multiplies the light that comes back by exp(nats): power and intensity alike."""
    return replace(rays, log_intensity=rays.log_intensity + nats, log_power=rays.log_power + nats)


def add_intensity(rays: Rays, added: Float[Array, "*n"], floor: float) -> Rays:
    """Adds to the reported intensity, in its units; it stays above `floor`, or what it was if that is less."""
    # ln(I + added) = ln I + log1p(added / I), with a derivative also where I is next to nothing.
    inverse = jnp.exp(jnp.minimum(-rays.log_intensity, 40.0))
    least = jnp.minimum(floor * inverse, 1.0) - 1.0
    less = rays.log_intensity + jnp.log1p(jnp.clip(added * inverse, least, 0.0))
    # What is added to next to nothing is all that there is.
    more = jnp.logaddexp(rays.log_intensity, jnp.log(jnp.maximum(added, _LEAST_ADDED)))
    return replace(rays, log_intensity=jnp.where(added > 0, more, less))


def lose(rays: Rays, probability: Float[Array, "*n"]) -> Rays:
    """Loses the surface's echo with a probability, independently of other losses."""
    # Probabilities of staying multiply, so their logarithms add up.
    return replace(rays, log_keep=rays.log_keep + jnp.log1p(-jnp.clip(probability, 0.0, MOST_PROBABLE)))


def misread(rays: Rays, error_m: Float[Array, "*n"]) -> Rays:
    """Adds an error to the reading of rays that hit something; glare and clutter keep the ranges they come from."""
    return replace(rays, reading_m=rays.reading_m + jnp.where(rays.hit, error_m, jnp.zeros_like(error_m)))


def either(first: Float[Array, "*n"], second: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The probability of one or the other of two independent events."""
    return first + second - first * second


def of_class(values: Float[Array, " classes"], rays: Rays) -> Float[Array, "*n"]:
    """Each ray's entry of a table over Cityscapes ids."""
    return values[jnp.clip(rays.semantic, 0, values.shape[0] - 1)]


def is_one_of(rays: Rays, classes: tuple[int, ...]) -> Float[Array, "*n"]:
    """1 where the ray meets one of these classes, else 0."""
    table = jnp.zeros(CLASSES, jnp.float32).at[jnp.asarray(classes)].set(1.0)
    return of_class(table, rays)


def add_clutter(
    rays: Rays, probability: Array, *, power: float | Array, scale_m: Array, from_m: float, intensity: Array
) -> Rays:
    """Adds a false return with a probability, at a range of density r**power exp(-r / scale) from `from_m` on.

    A ray keeps one law of ranges, where several effects make clutter: that of one that is likelier than all before it
    together.
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
