"""Rays through an effect, and slopes back to its parameters, compiled.

Each effect is a program of its own, but casting displaced rays again takes longer to compile than all else together:
the effects of geometry share it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxsim.discover.parameters import to_values
from jaxsim.discover.slopes import SEEN, TAKEN, Fields
from jaxsim.effects import Effect
from jaxsim.effects.rays import Rays, Scan
from jaxsim.effects.recast import Displaced, Displacement, recast
from jaxsim.frame import Array

Z = dict[str, Array]
Step = Callable[[Any], Any]
"""Of the chain rule: what `jax.vjp` gives, a tree of arrays as well as a function."""
Back = tuple[Step, ...]


def seen_through(effect: Effect, z: Z, rays: Rays, scan: Scan) -> tuple[Fields, Fields, Back]:
    """Of the rays with an effect: the fields that the likelihood is differentiated in, those that it takes, and what
    makes of slopes in the former (`slopes_back`) those in z."""
    if isinstance(effect.apply, Displaced):
        by, to_z = _displaced(effect, z, rays)
        seen, taken, to_by = _seen_again(by, effect.apply.passes, rays, scan)
        return seen, taken, (to_by, to_z)
    seen, taken, to_z = _seen(effect, z, rays, scan)
    return seen, taken, (to_z,)


def slopes_back(back: Back, slopes: Fields) -> Z:
    """Slopes in z, of those in the fields that `seen_through` gives beside `back`."""
    for step in back:
        slopes = _back(step, slopes)
    return slopes


def placed(effect: Effect, z: Z, rays: Rays, scan: Scan) -> Rays:
    """The rays with an effect."""
    if isinstance(effect.apply, Displaced):
        return _again(_displaced(effect, z, rays)[0], effect.apply.passes, rays, scan)
    return _placed(effect, z, rays, scan)


def _fields(rays: Rays) -> tuple[Fields, Fields]:
    seen = {name: jnp.asarray(getattr(rays, name), jnp.float32) for name in SEEN}
    return seen, {name: getattr(rays, name) for name in TAKEN}


@partial(jax.jit, static_argnames="effect")
def _placed(effect: Effect, z: Z, rays: Rays, scan: Scan) -> Rays:
    return effect.apply(to_values(effect, z), rays, scan)


@partial(jax.jit, static_argnames="effect")
def _seen(effect: Effect, z: Z, rays: Rays, scan: Scan) -> tuple[Fields, Fields, Step]:
    seen, back, taken = jax.vjp(lambda z: _fields(effect.apply(to_values(effect, z), rays, scan)), z, has_aux=True)
    return seen, taken, back


@partial(jax.jit, static_argnames="effect")
def _displaced(effect: Effect, z: Z, rays: Rays) -> tuple[Displacement, Step]:
    assert isinstance(effect.apply, Displaced)
    return jax.vjp(lambda z: effect.apply.displace(to_values(effect, z), rays), z)


_again = jax.jit(lambda by, passes, rays, scan: recast(rays, scan, by, passes))


@jax.jit
def _seen_again(by: Displacement, passes: Array, rays: Rays, scan: Scan) -> tuple[Fields, Fields, Step]:
    seen, back, taken = jax.vjp(lambda by: _fields(recast(rays, scan, by, passes)), by, has_aux=True)
    return seen, taken, back


@jax.jit
def _back(step: Step, slopes: Any) -> Any:
    return step(slopes)[0]
