"""Rays through an effect, and slopes back to its parameters, compiled.

Each effect is a program of its own, but casting displaced rays again takes longer to compile than all else together:
the effects of geometry share it.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp

from jaxsim.discover.likelihood import SEEN, TAKEN
from jaxsim.discover.parameters import to_values
from jaxsim.effects import Effect
from jaxsim.effects.rays import Rays, Scan
from jaxsim.effects.recast import Displaced, Displacement, recast
from jaxsim.frame import Array

Z = dict[str, Array]
Fields = dict[str, Array]


def seen_through(effect: Effect, z: Z, rays: Rays, scan: Scan) -> tuple[Fields, Fields]:
    """Of the rays with an effect: the fields that the likelihood is differentiated in, and those that it takes."""
    if isinstance(effect.apply, Displaced):
        return _seen_again(_displaced(effect, z, rays), effect.apply.passes, rays, scan)
    return _seen(effect, z, rays, scan)


def slopes_back(effect: Effect, z: Z, rays: Rays, scan: Scan, slopes: Fields) -> Z:
    """Slopes in z, of those in the fields that `seen_through` gives."""
    if isinstance(effect.apply, Displaced):
        by = _back_again(_displaced(effect, z, rays), effect.apply.passes, rays, scan, slopes)
        return _displaced_back(effect, z, rays, by)
    return _back(effect, z, rays, scan, slopes)


def placed(effect: Effect, z: Z, rays: Rays, scan: Scan) -> Rays:
    """The rays with an effect."""
    if isinstance(effect.apply, Displaced):
        return _again(_displaced(effect, z, rays), effect.apply.passes, rays, scan)
    return _placed(effect, z, rays, scan)


def _fields(rays: Rays) -> tuple[Fields, Fields]:
    seen = {name: jnp.asarray(getattr(rays, name), jnp.float32) for name in SEEN}
    return seen, {name: getattr(rays, name) for name in TAKEN}


@partial(jax.jit, static_argnames="effect")
def _placed(effect: Effect, z: Z, rays: Rays, scan: Scan) -> Rays:
    return effect.apply(to_values(effect, z), rays, scan)


@partial(jax.jit, static_argnames="effect")
def _seen(effect: Effect, z: Z, rays: Rays, scan: Scan) -> tuple[Fields, Fields]:
    return _fields(effect.apply(to_values(effect, z), rays, scan))


@partial(jax.jit, static_argnames="effect")
def _back(effect: Effect, z: Z, rays: Rays, scan: Scan, slopes: Fields) -> Z:
    return jax.vjp(lambda z: _seen(effect, z, rays, scan), z, has_aux=True)[1](slopes)[0]


@partial(jax.jit, static_argnames="effect")
def _displaced(effect: Effect, z: Z, rays: Rays) -> Displacement:
    assert isinstance(effect.apply, Displaced)
    return effect.apply.displace(to_values(effect, z), rays)


@partial(jax.jit, static_argnames="effect")
def _displaced_back(effect: Effect, z: Z, rays: Rays, slopes: Displacement) -> Z:
    return jax.vjp(lambda z: _displaced(effect, z, rays), z)[1](slopes)[0]


_again = jax.jit(lambda by, passes, rays, scan: recast(rays, scan, by, passes))


@jax.jit
def _seen_again(by: Displacement, passes: Array, rays: Rays, scan: Scan) -> tuple[Fields, Fields]:
    return _fields(recast(rays, scan, by, passes))


@jax.jit
def _back_again(by: Displacement, passes: Array, rays: Rays, scan: Scan, slopes: Fields) -> Displacement:
    return jax.vjp(lambda by: _seen_again(by, passes, rays, scan), by, has_aux=True)[1](slopes)[0]
