"""The likelihood with its derivatives in what effects do to rays, and in the noise: what fits climb.

Intensities and returns share neither fields nor noise: each is a program of its own, compiled once for all effects.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.discover.model.evidence import Evidence
from jaxsim.discover.model.likelihood import CHANNELS, intensity_by_block, returns_by_block
from jaxsim.discover.model.nuisance import Noise, Weights
from jaxsim.discover.model.parameters import to_values
from jaxsim.effects import Law
from jaxsim.effects.rays import Rays, Scan
from jaxsim.effects.recast import recast
from jaxsim.frame import Array

OF_INTENSITY = ("log_intensity", "intensity_step", "intensity_top")
SEEN = (*OF_INTENSITY, "range_m", "log_keep", "column_loss", "reading_m", "noise_m", "between", "between_m")
SEEN += ("ghost", "ghost_m", "clutter", "clutter_power", "clutter_scale_m", "clutter_from_m", "range_step_m")
"""Fields of rays that the likelihood is differentiated in; the first three matter to intensities, the others to
returns."""
TAKEN = ("hit", "beside_m")
"""Fields that it takes as they are."""
Fields = dict[str, Array]
Slopes = tuple[Array, Array, Fields, Noise]


def value_and_slopes(
    seen: Fields,
    taken: Fields,
    ev: Evidence,
    noise: Noise,
    w: Weights,
    fitted: Float[Array, " b"],
    counted: Float[Array, " b"],
    *,
    channels: tuple[str, ...] = CHANNELS,
    clutter: bool = False,
) -> Slopes:
    """Minus the log-likelihood of the counted blocks; that of all by block and channel (b, 3: intensity, range, drop),
    0 in channels that are not asked for; and the derivatives of the first in the rays' fields and in the noise.
    Nuisances shared by frames follow from the blocks with `fitted` > 0.
    """
    parts: list[Slopes] = []
    if "intensity" in channels:
        parts.append(_of_intensity(seen, taken, ev, noise, w, fitted, counted))
    if {"range", "drop"} & set(channels):
        parts.append(_of_returns(seen, taken, ev, noise, w, counted, clutter=clutter))
    if len(parts) == 1:
        return parts[0]
    (value, blocks, by_seen, by_noise), (*more, by_returns, by_others) = parts
    value, blocks, by_noise = _sum((value, blocks, by_noise), (*more, by_others))
    return value, blocks, by_returns | {name: by_seen[name] for name in OF_INTENSITY}, by_noise


@jax.jit
def _of_intensity(
    seen: Fields, taken: Fields, ev: Evidence, noise: Noise, w: Weights, fitted: Array, counted: Array
) -> Slopes:
    def by_block(rays: Rays, noise: Noise) -> Float[Array, "b 3"]:
        return _in_channel(0, intensity_by_block(rays, ev, noise, w, fitted))

    return _slopes(by_block, seen, taken, ev, noise, counted)


@partial(jax.jit, static_argnames="clutter")
def _of_returns(
    seen: Fields, taken: Fields, ev: Evidence, noise: Noise, w: Weights, counted: Array, *, clutter: bool
) -> Slopes:
    def by_block(rays: Rays, noise: Noise) -> Float[Array, "b 3"]:
        range_, drop = returns_by_block(rays, ev, noise, w, clutter=clutter)
        return _in_channel(1, range_) + _in_channel(2, drop)

    return _slopes(by_block, seen, taken, ev, noise, counted)


def _in_channel(number: int, block: Float[Array, " b"]) -> Float[Array, "b 3"]:
    return jnp.outer(block, jnp.eye(len(CHANNELS))[number])


def _slopes(
    by_block: Callable[[Rays, Noise], Array], seen: Fields, taken: Fields, ev: Evidence, noise: Noise, counted: Array
) -> Slopes:
    def loss(seen: Fields, noise: Noise) -> tuple[Array, Array]:
        blocks = by_block(replace(ev.rays, **seen, **taken), noise)
        return -jnp.where(counted > 0, blocks.sum(-1), 0).sum(), blocks

    (value, blocks), (by_seen, by_noise) = jax.value_and_grad(loss, argnums=(0, 1), has_aux=True)(seen, noise)
    return value, blocks, by_seen, by_noise


_sum = jax.jit(lambda a, b: jax.tree.map(jnp.add, a, b))


Z = dict[str, Array]
Step = Callable[[Any], Any]
"""Of the chain rule: what `jax.vjp` gives, a tree of arrays as well as a function."""
Back = tuple[Step, ...]


def seen_through(effect: Law, z: Z, rays: Rays, scan: Scan) -> tuple[Fields, Fields, Back]:
    """Of the rays with an effect: the fields that the likelihood is differentiated in, those that it takes, and what
    makes of slopes in the former (`slopes_back`) those in z."""
    if effect.casts:
        by, to_z = _displaced(effect, z, rays)
        seen, taken, to_by = _seen_again(by, effect.casts, rays, scan)
        return seen, taken, (to_by, to_z)
    seen, taken, to_z = _seen(effect, z, rays)
    return seen, taken, (to_z,)


def slopes_back(back: Back, slopes: Fields) -> Z:
    """Slopes in z, of those in the fields that `seen_through` gives beside `back`."""
    for step in back:
        slopes = _back(step, slopes)
    return slopes


def placed(effect: Law, z: Z, rays: Rays, scan: Scan) -> Rays:
    """The rays with an effect."""
    if effect.casts:
        return _again(_displaced(effect, z, rays)[0], effect.casts, rays, scan)
    return _placed(effect, z, rays)


def _fields(rays: Rays) -> tuple[Fields, Fields]:
    seen = {name: jnp.asarray(getattr(rays, name), jnp.float32) for name in SEEN}
    return seen, {name: getattr(rays, name) for name in TAKEN}


@partial(jax.jit, static_argnames="effect")
def _placed(effect: Law, z: Z, rays: Rays) -> Rays:
    return effect.apply(to_values(effect, z), rays)


@partial(jax.jit, static_argnames="effect")
def _seen(effect: Law, z: Z, rays: Rays) -> tuple[Fields, Fields, Step]:
    seen, back, taken = jax.vjp(lambda z: _fields(effect.apply(to_values(effect, z), rays)), z, has_aux=True)
    return seen, taken, back


@partial(jax.jit, static_argnames="effect")
def _displaced(effect: Law, z: Z, rays: Rays) -> tuple[Fields, Step]:
    """By how much an effect turns and moves rays, whatever was done to them before."""
    straight = replace(rays, turned_rad=jnp.zeros_like(rays.turned_rad), moved_m=jnp.zeros_like(rays.moved_m))

    def by(z: Z) -> Fields:
        after = effect.apply(to_values(effect, z), straight)
        return {"turned_rad": after.turned_rad, "moved_m": after.moved_m}

    return jax.vjp(by, z)


def _cast_again(by: Fields, passes: Array, rays: Rays, scan: Scan) -> Rays:
    displaced = {name: getattr(rays, name) + more for name, more in by.items()}
    return recast(replace(rays, **displaced), scan, passes)


_again = jax.jit(_cast_again)


@jax.jit
def _seen_again(by: Fields, passes: Array, rays: Rays, scan: Scan) -> tuple[Fields, Fields, Step]:
    seen, back, taken = jax.vjp(lambda by: _fields(_cast_again(by, passes, rays, scan)), by, has_aux=True)
    return seen, taken, back


@jax.jit
def _back(step: Step, slopes: Any) -> Any:
    return step(slopes)[0]
