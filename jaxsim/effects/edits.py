"""The few ways in which effects change rays, and the safe functions that their formulas share.

Everything here has finite derivatives for every ray, also where nothing is hit or the surface is seen edge on.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.effects.rays import Array, Rays

LEAST_COSINE = 0.02
# ln(1 - p) and its slope stay finite.
MOST_PROBABLE = 0.999


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


def brighten(rays: Rays, nats: Float[Array, "*n"]) -> Rays:
    """Multiplies the light that comes back by exp(nats): power and intensity alike."""
    return replace(rays, log_intensity=rays.log_intensity + nats, log_power=rays.log_power + nats)


def add_intensity(rays: Rays, added: Float[Array, "*n"], floor: float) -> Rays:
    """Adds to the reported intensity, in its units; it stays above `floor`, or what it was if that is less."""
    # ln(I + added) = ln I + log1p(added / I), with a derivative also where I is next to nothing.
    inverse = jnp.exp(jnp.minimum(-rays.log_intensity, 40.0))
    least = jnp.minimum(floor * inverse, 1.0) - 1.0
    return replace(rays, log_intensity=rays.log_intensity + jnp.log1p(jnp.maximum(added * inverse, least)))


def lose(rays: Rays, probability: Float[Array, "*n"]) -> Rays:
    """Loses the surface's echo with a probability, independently of other losses."""
    # Probabilities of staying multiply, so their logarithms add up.
    return replace(rays, log_keep=rays.log_keep + jnp.log1p(-jnp.clip(probability, 0.0, MOST_PROBABLE)))


def misread(rays: Rays, error_m: Float[Array, "*n"]) -> Rays:
    """Adds an error to the reading of rays that hit something."""
    return replace(rays, reading_m=rays.reading_m + jnp.where(rays.hit, error_m, jnp.zeros_like(error_m)))


def either(first: Float[Array, "*n"], second: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The probability of one or the other of two independent events."""
    return first + second - first * second


def of_class(values: Float[Array, " classes"], rays: Rays) -> Float[Array, "*n"]:
    """Each ray's entry of a table over Cityscapes ids."""
    return values[jnp.clip(rays.semantic, 0, values.shape[0] - 1)]


def is_one_of(rays: Rays, classes: tuple[int, ...]) -> Float[Array, "*n"]:
    """1 where the ray meets one of these classes, else 0."""
    table = jnp.zeros(34, jnp.float32).at[jnp.asarray(classes)].set(1.0)
    return of_class(table, rays)
