"""Log-likelihood of measured frames under a simulation, by block and channel.

Intensity: Student-t in its logarithm. Return and range: one mixture a ray: lost, clutter, ghost, or the surface's
echo, whose range is the predicted one (normal), one between two surfaces, a neighbour's, or far off (Cauchy).
The drop channel is the part of it that says whether a ray returned; the rest is the range channel.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.nuisance import Noise, Weights, intensity_variance, reading_variance
from jaxsim.discover.model.random_effects import pose_shift, reflectance
from jaxsim.effects.rays import CLUTTER_REACH_M, FLOOR, NEVER, Rays
from jaxsim.frame import Array

CHANNELS = ("intensity", "range", "drop")
DEGREES = 4.0
"""Of freedom of the Student-t."""
_T = float(np.log(3 / 8))  # log of the density of Student-t with 4 degrees at 0, scale 1
_PILE = 0.01
"""Intensities within this (nats) of the sensor's top count as at the top."""
_EDGE_SD_M = 0.05


def log_normal(d: Array, sd: Array) -> Array:
    return -0.5 * (d / sd) ** 2 - jnp.log(sd) - 0.5 * np.log(2 * np.pi)


def log_student(d: Array, sd: Array) -> Array:
    """With DEGREES degrees of freedom."""
    return _T - 0.5 * (DEGREES + 1) * jnp.log1p((d / sd) ** 2 / DEGREES) - jnp.log(sd)


def log_below(t: Array) -> Array:
    """Logarithm of the probability that a Student-t of 4 degrees of freedom and scale 1 lies below t."""
    square = t**2 / DEGREES
    share = 0.5 + 0.375 * t / jnp.sqrt(1 + square) * (1 - t**2 / 12 / (1 + square))
    # Far below 0 the sum cancels; the tail falls with the fourth power.
    return jnp.log(jnp.where(t < -6, 3 / 16 / (1 + square) ** 2, jnp.maximum(share, 1e-4)))


def log_cauchy(d: Array, scale: float) -> Array:
    return -jnp.log(np.pi * scale * (1 + (d / scale) ** 2))


def intensity_terms(
    rays: Rays, ev: Evidence, noise: Noise, w: Weights, fitted: Float[Array, " b"]
) -> tuple[Float[Array, "b c r"], Float[Array, " b"]]:
    """Of each compared ray, 0 elsewhere; and what their surfaces' reflectances cost each block."""
    residual = ev.log_intensity - rays.log_intensity
    explained, cost = reflectance(ev, w, fitted, residual)
    left = residual - explained
    rounding = rays.intensity_step / np.sqrt(12) * jnp.exp(-jnp.clip(ev.log_intensity, -7.0, 0.0))
    variance = intensity_variance(ev, noise) + rounding**2
    sd = jnp.sqrt(variance)
    density = log_student(left, sd)
    # A reading of 0 says no more than that the intensity lies below all others.
    nothing = ev.log_intensity <= np.log(FLOOR) + 1e-3
    density = jnp.where(nothing, log_below((ev.lowest - (ev.log_intensity - left)) / sd), density)
    # At the sensor's top: all that would be brighter piles up there.
    top = jnp.log(rays.intensity_top)
    over = (ev.log_intensity - left - top) / sd
    gap = ev.log_intensity - top
    piled = jax.nn.log_sigmoid(1.6 * over) - np.log(2 * _PILE)
    clipped = rays.intensity_top < 0.9999
    density = jnp.where(clipped & (jnp.abs(gap) <= _PILE), piled, density)
    density = jnp.where(clipped & (gap > _PILE), density - 10.0, density)
    return jnp.where(ev.compared, density, 0.0), cost


def log_clutter(rays: Rays, at_m: Float[Array, "b c r"]) -> Float[Array, "b c r"]:
    """Of the range of a false return."""
    end = jnp.where(rays.hit, jnp.maximum(rays.range_m, rays.clutter_from_m + 0.1), CLUTTER_REACH_M)
    start = rays.clutter_from_m

    def log_shape(r: Array) -> Array:
        return rays.clutter_power * jnp.log(r) - r / rays.clutter_scale_m

    # Midpoint rule on a logarithmic scale: the densities are broad on it.
    nodes, length = 16, jnp.log(end / start)
    mass = jnp.zeros_like(end)
    for k in range(nodes):
        r = start * jnp.exp(length * ((k + 0.5) / nodes))
        mass = mass + jnp.exp(log_shape(r)) * r * length / nodes
    inside = (at_m > start) & (at_m < end + 1.0)
    r = jnp.clip(at_m, start, end)
    return jnp.where(inside, log_shape(r) - jnp.log(mass + 1e-30), NEVER)


def near_sd(range_m: Array) -> Array:
    """Standard deviation of a neighbour's reading, m."""
    return _EDGE_SD_M + 0.02 * range_m


def log_stray(ev: Evidence, noise: Noise) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"]]:
    """Of the probabilities that a surface's echo reads a neighbour's range, and one far off."""
    switch = jnp.where(ev.edge, jax.nn.log_sigmoid(noise.switch_edge), NEVER)
    return switch, jnp.where(ev.edge, jax.nn.log_sigmoid(noise.wide_edge), jax.nn.log_sigmoid(noise.wide))


def log_reported(rays: Rays, ev: Evidence, noise: Noise) -> Float[Array, "b c r"]:
    """Of the probability that a ray returns: the surface's echo, or a false one where nothing is hit."""
    stepped = jnp.logical_or(ev.edge, ev.step)
    missed = jnp.where(stepped, jax.nn.log_sigmoid(-noise.drop_edge), jax.nn.log_sigmoid(-noise.drop))
    sky = ~jnp.isfinite(rays.beside_m).all(-1)
    missed = jnp.where(sky, jax.nn.log_sigmoid(-noise.drop_sky), missed)
    false = jnp.where(ev.edge, jax.nn.log_sigmoid(noise.false_edge), jax.nn.log_sigmoid(noise.false))
    return jnp.clip(jnp.where(rays.hit, rays.log_keep + missed, false), NEVER, -1e-6)


def log_lost(rays: Rays, ev: Evidence, noise: Noise, *, clutter: bool = True) -> Float[Array, "b c r"]:
    """Of the probability that a ray that is not lost with its column does not return."""
    lost = jnp.log(-jnp.expm1(log_reported(rays, ev, noise))) + jnp.log1p(-jnp.clip(rays.ghost, 0, 0.999))
    return lost + jnp.log1p(-jnp.clip(rays.clutter, 0, 0.999)) if clutter else lost


def return_terms(
    rays: Rays, ev: Evidence, noise: Noise, w: Weights, *, clutter: bool
) -> tuple[Float[Array, "b c r"], Float[Array, "b c r"], Float[Array, " b"]]:
    """`log_lost`; the logarithm of the density with which a ray returns where it did; and what each block's pose
    costs."""
    hit = rays.hit
    off = ev.range_m - rays.reading_m
    shift, cost = pose_shift(ev, w, rays.reading_m, ev.returned & hit)
    off = off - shift

    sd = jnp.sqrt(reading_variance(rays, ev, noise))
    core = log_student(off, sd)
    beside = jnp.where(jnp.isfinite(rays.beside_m), rays.beside_m, 1e4)
    near = log_normal(ev.range_m[..., None] - beside, near_sd(ev.range_m[..., None]))
    near = jax.nn.logsumexp(near, axis=-1) - np.log(4)
    wide = log_cauchy(off, 1.0)
    switch, rate = log_stray(ev, noise)
    usual = jnp.log1p(-jnp.clip(jnp.exp(rate) + jnp.exp(switch), 0, 0.98))
    surface = jax.nn.logsumexp(jnp.stack([usual + core, rate + wide, switch + near], axis=-1), axis=-1)

    low, high = jnp.minimum(rays.reading_m, rays.between_m), jnp.maximum(rays.reading_m, rays.between_m)
    spread = 0.05
    inside = jax.nn.sigmoid((ev.range_m - low) / spread) * jax.nn.sigmoid((high - ev.range_m) / spread)
    between = jnp.log(inside + 1e-9) - jnp.log(high - low + spread)
    mixed = jnp.clip(rays.between, 0, 0.999)
    surface = jnp.logaddexp(jnp.log1p(-mixed) + surface, jnp.log(mixed + 1e-12) + between)
    nothing = jnp.logaddexp(near, -np.log(CLUTTER_REACH_M)) - np.log(2)
    surface = jnp.where(hit, surface, nothing)

    seen = log_reported(rays, ev, noise) + surface
    ghost = jnp.clip(rays.ghost, 0, 0.999)
    doubled = log_normal(ev.range_m - rays.ghost_m, jnp.exp(noise.range_) + 0.1)
    seen = jnp.logaddexp(jnp.log1p(-ghost) + seen, jnp.log(ghost + 1e-12) + doubled)
    if clutter:
        early = jnp.clip(rays.clutter, 0, 0.999)
        seen = jnp.logaddexp(jnp.log1p(-early) + seen, jnp.log(early + 1e-12) + log_clutter(rays, ev.range_m))
    return log_lost(rays, ev, noise, clutter=clutter), jnp.where(ev.returned, seen, 0.0), cost


def of_columns(rays: Rays, ev: Evidence, lost: Array, seen: Array) -> Float[Array, "b c"]:
    """Log-likelihood of whole columns, which may be lost together."""
    terms = jnp.where(ev.returned, seen, lost).sum(-1)
    gone = jnp.clip(rays.column_loss.mean(-1), 0, 0.999)
    empty = ~ev.returned.any(-1)
    return jnp.logaddexp(jnp.log1p(-gone) + terms, jnp.where(empty, jnp.log(gone + 1e-9), NEVER * 10))


def intensity_by_block(
    rays: Rays, ev: Evidence, noise: Noise, w: Weights, fitted: Float[Array, " b"]
) -> Float[Array, " b"]:
    """Log-likelihood of the intensities, what surfaces' reflectances cost taken off."""
    terms, cost = intensity_terms(rays, ev, noise, w, fitted)
    return terms.sum((1, 2)) - cost


def returns_by_block(
    rays: Rays, ev: Evidence, noise: Noise, w: Weights, *, clutter: bool
) -> tuple[Float[Array, " b"], Float[Array, " b"]]:
    """Log-likelihood of the ranges, what the pose costs taken off, and of what returned."""
    lost, seen, cost = return_terms(rays, ev, noise, w, clutter=clutter)
    total = of_columns(rays, ev, lost, seen).sum(-1)
    back = jnp.log(-jnp.expm1(jnp.minimum(lost, -1e-7)))
    drop = of_columns(rays, ev, lost, back).sum(-1)
    return total - drop - cost, drop


@partial(jax.jit, static_argnames="clutter")
def log_likelihood(
    ev: Evidence, noise: Noise, w: Weights, fitted: Float[Array, " b"], *, clutter: bool
) -> Float[Array, "b 3"]:
    """Of every block by channel (intensity, range, drop), of the rays as they stand; `value_and_slopes` without
    slopes."""
    returns = returns_by_block(ev.rays, ev, noise, w, clutter=clutter)
    return jnp.stack([intensity_by_block(ev.rays, ev, noise, w, fitted), *returns], axis=-1)
