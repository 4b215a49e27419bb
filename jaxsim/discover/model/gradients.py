"""The likelihood with its derivatives in an effect's z and in the noise: what fits climb.

The chain rule in two parts, so that the large one is compiled once for all effects and the small one for each:

    z --effect--> fields of the rays --likelihood--> value        d value / dz = (d fields / dz)^T (d value / d fields)

`effect_with_gradient` gives the fields and a pullback, `value_and_gradient` the value and its gradient in the fields,
`gradient_in_z` pulls that back to z. Effects of geometry share a third program, the recast, between z and fields.
Intensities and returns share neither fields nor noise: each is a program of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.likelihood import intensity_by_block, returns_by_block
from jaxsim.discover.model.noise import Noise
from jaxsim.discover.model.parameters import to_values
from jaxsim.discover.model.random_effects import NormalEquations
from jaxsim.effects import Law
from jaxsim.effects.effect import CHANNELS
from jaxsim.effects.rays import Rays, Scan
from jaxsim.effects.recast import recast
from jaxsim.frame import Array

INTENSITY_FIELDS = ("log_intensity", "intensity_step", "intensity_top")
"""Fields of rays that the likelihood of intensities is differentiated in."""
OF_RETURNS = (
    *("range_m", "log_keep", "column_loss", "reading_m", "noise_m", "between", "between_m", "ghost", "ghost_m"),
    *("clutter", "clutter_power", "clutter_scale_m", "clutter_from_m", "range_step_m"),
)
"""Fields that the likelihood of ranges and of what returned is differentiated in."""
DIFFERENTIATED = (*INTENSITY_FIELDS, *OF_RETURNS)
CONSTANT = ("hit", "beside_m")
"""Fields that it takes as they are: which surface is met has no derivative."""

Z = dict[str, Array]
"""An effect's parameters as they are fitted (`parameters`)."""
Fields = dict[str, Array]
"""Fields of rays by name."""
Pullback = Callable[[Any], Any]
"""What `jax.vjp` gives: a tree of arrays as well as a function."""


class Gradient(NamedTuple):
    """The likelihood and its derivatives."""

    value: Float[Array, ""]
    """Minus the log-likelihood of the counted blocks."""
    blocks: Float[Array, "b 3"]
    """Log-likelihood of all blocks by channel (intensity, range, drop); 0 in channels that are not asked for."""
    by_fields: Fields
    """Derivatives of `value` in the rays' fields."""
    by_noise: Noise


class EffectGradient(NamedTuple):
    """An effect's rays, as the likelihood takes them, and the way back to its z."""

    fields: Fields
    """The rays' fields of DIFFERENTIATED."""
    constant: Fields
    """The rays' fields of CONSTANT."""
    pullbacks: tuple[Pullback, ...]
    """Maps from derivatives in the fields to those in z, last step first."""


def value_and_gradient(
    fields: Fields,
    constant: Fields,
    ev: Evidence,
    *,
    noise: Noise,
    equations: NormalEquations,
    in_fit: Float[Array, " b"],
    counted: Float[Array, " b"],
    channels: tuple[str, ...] = CHANNELS,
    clutter: bool = False,
) -> Gradient:
    """The likelihood of `ev` with its rays' fields replaced. Levels that frames share follow from the blocks with
    `in_fit` > 0; `value` counts those with `counted` > 0."""
    # Two programs, for intensities need levels of all blocks and returns do not.
    parts: list[Gradient] = []
    if "intensity" in channels:
        parts.append(
            _of_intensity(fields, constant, ev, noise=noise, equations=equations, in_fit=in_fit, counted=counted)
        )
    if {"range", "drop"} & set(channels):
        parts.append(
            _of_returns(fields, constant, ev, noise=noise, equations=equations, counted=counted, clutter=clutter)
        )
    # Channels that an effect leaves alone cost nothing to climb.
    if len(parts) == 1:
        return parts[0]
    intensity, returns = parts
    value, blocks, by_noise = _sum(
        (intensity.value, intensity.blocks, intensity.by_noise), (returns.value, returns.blocks, returns.by_noise)
    )
    # Both programs give all fields; those of intensity have no derivative in the returns.
    by_fields = returns.by_fields | {name: intensity.by_fields[name] for name in INTENSITY_FIELDS}
    return Gradient(value, blocks, by_fields, by_noise)


@jax.jit
def _of_intensity(
    fields: Fields,
    constant: Fields,
    ev: Evidence,
    *,
    noise: Noise,
    equations: NormalEquations,
    in_fit: Float[Array, " b"],
    counted: Float[Array, " b"],
) -> Gradient:
    def by_block(rays: Rays, noise: Noise) -> Float[Array, "b 3"]:
        return _in_channel(0, intensity_by_block(rays, ev, noise, equations=equations, in_fit=in_fit))

    return _gradient(by_block, fields, constant, ev=ev, noise=noise, counted=counted)


@partial(jax.jit, static_argnames="clutter")
def _of_returns(
    fields: Fields,
    constant: Fields,
    ev: Evidence,
    *,
    noise: Noise,
    equations: NormalEquations,
    counted: Float[Array, " b"],
    clutter: bool,
) -> Gradient:
    def by_block(rays: Rays, noise: Noise) -> Float[Array, "b 3"]:
        range_, drop = returns_by_block(rays, ev, noise, equations=equations, clutter=clutter)
        return _in_channel(1, range_) + _in_channel(2, drop)

    return _gradient(by_block, fields, constant, ev=ev, noise=noise, counted=counted)


def _in_channel(number: int, block: Float[Array, " b"]) -> Float[Array, "b 3"]:
    return jnp.outer(block, jnp.eye(len(CHANNELS))[number])


def _gradient(
    by_block: Callable[[Rays, Noise], Array],
    fields: Fields,
    constant: Fields,
    *,
    ev: Evidence,
    noise: Noise,
    counted: Float[Array, " b"],
) -> Gradient:
    def loss(fields: Fields, noise: Noise) -> tuple[Array, Array]:
        blocks = by_block(replace(ev.rays, **fields, **constant), noise)
        # Held-out blocks are scored, not climbed; a block without a number there must not spoil the sum.
        return -jnp.where(counted > 0, blocks.sum(-1), 0).sum(), blocks

    (value, blocks), (by_fields, by_noise) = jax.value_and_grad(loss, argnums=(0, 1), has_aux=True)(fields, noise)
    return Gradient(value, blocks, by_fields, by_noise)


_sum = jax.jit(lambda a, b: jax.tree.map(jnp.add, a, b))


def effect_with_gradient(effect: Law, z: Z, rays: Rays, *, scan: Scan) -> EffectGradient:
    """The rays with an effect, and the pullback of derivatives in their fields."""
    if _casts_again(effect, rays):
        # In two steps: casting again knows no effect, and is compiled once for all that turn or move rays.
        by, to_z = _displaced(effect, z, rays)
        fields, constant, to_by = _recast_fields(by, effect.casts, rays, scan=scan)
        return EffectGradient(fields, constant, (to_by, to_z))
    fields, constant, to_z = _effect_fields(effect, z, rays)
    return EffectGradient(fields, constant, (to_z,))


def gradient_in_z(pullbacks: tuple[Pullback, ...], by_fields: Fields) -> Z:
    """Derivatives in z, of those in the fields of the `EffectGradient` that holds `pullbacks`."""
    # Reverse mode by hand: the chain rule's factors, last step first.
    gradient: Any = by_fields
    for pullback in pullbacks:
        gradient = _pulled_back(pullback, gradient)
    return gradient


def with_effect(effect: Law, z: Z, rays: Rays, *, scan: Scan) -> Rays:
    """The rays with an effect."""
    if _casts_again(effect, rays):
        return _recast(_displaced(effect, z, rays)[0], effect.casts, rays, scan=scan)
    return _applied(effect, z, rays)


def _casts_again(effect: Law, rays: Rays) -> bool:
    """Whether rays meet other surfaces by the effect, and do not slide along their planes."""
    return effect.casts > 0 and rays.origin_slope is None


def _fields(rays: Rays) -> tuple[Fields, Fields]:
    differentiated = {name: jnp.asarray(getattr(rays, name), jnp.float32) for name in DIFFERENTIATED}
    return differentiated, {name: getattr(rays, name) for name in CONSTANT}


@partial(jax.jit, static_argnames="effect")
def _applied(effect: Law, z: Z, rays: Rays) -> Rays:
    return effect.apply(to_values(effect, z), rays)


@partial(jax.jit, static_argnames="effect")
def _effect_fields(effect: Law, z: Z, rays: Rays) -> tuple[Fields, Fields, Pullback]:
    fields, back, constant = jax.vjp(lambda z: _fields(effect.apply(to_values(effect, z), rays)), z, has_aux=True)
    return fields, constant, back


@partial(jax.jit, static_argnames="effect")
def _displaced(effect: Law, z: Z, rays: Rays) -> tuple[Fields, Pullback]:
    """How far an effect turns and moves rays, whatever was done to them before."""
    straight = replace(rays, turned_rad=jnp.zeros_like(rays.turned_rad), moved_m=jnp.zeros_like(rays.moved_m))

    def by(z: Z) -> Fields:
        after = effect.apply(to_values(effect, z), straight)
        return {"turned_rad": after.turned_rad, "moved_m": after.moved_m}

    return jax.vjp(by, z)


def _cast_again(by: Fields, passes: Array, rays: Rays, *, scan: Scan) -> Rays:
    # On top of what effects before it have turned and moved.
    displaced = {name: getattr(rays, name) + change for name, change in by.items()}
    return recast(replace(rays, **displaced), scan, passes)


# The number of passes is traced: effects that differ in it alone share the program.
_recast = jax.jit(_cast_again)


@jax.jit
def _recast_fields(by: Fields, passes: Array, rays: Rays, *, scan: Scan) -> tuple[Fields, Fields, Pullback]:
    fields, back, constant = jax.vjp(lambda by: _fields(_cast_again(by, passes, rays, scan=scan)), by, has_aux=True)
    return fields, constant, back


@jax.jit
def _pulled_back(pullback: Pullback, gradient: Any) -> Any:
    return pullback(gradient)[0]
