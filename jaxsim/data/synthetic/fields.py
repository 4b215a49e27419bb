"""Fields over the rays of a raster: vectors, and noise that belongs to a place.

A vector field is a triple of rasters, one a component. Joined into one array they would cost several times as much: XLA
on a CPU works out number by number, without vector instructions, what it joins or gathers together. Noise is hashed
from integer lattice cells: the same place always looks the same, from whichever sensor it is seen, with no memory and
no state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array

BLOCK = 2048
"""Rays that are worked on at a time."""
Triple = tuple[Float[Array, "*r"], Float[Array, "*r"], Float[Array, "*r"]]
"""Components of a vector at every ray."""

Starts = tuple[Float[Array, "*o"], Float[Array, "*o"], Float[Array, "*o"]]
"""The same, where one number may stand for many rays: of their origins."""


def each(component: Callable[[int], Float[Array, "*r"]]) -> Triple:
    """The vector field of which `component(i)` is the i-th component."""
    return component(0), component(1), component(2)


def dot(a: Triple, b: Triple | Float[Array, "3"]) -> Float[Array, "*r"]:
    """Scalar product; b may be a single vector."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def unit_vector(v: Triple) -> Triple:
    """The direction of v; zero stays zero."""
    size = jnp.maximum(jnp.sqrt(dot(v, v)), 1e-9)
    return each(lambda i: v[i] / size)


def rotate(rotation: Float[Array, "3 3"], v: Triple) -> Triple:
    """Rotates v; written out, because a matrix product may round coarsely on an accelerator."""
    return each(lambda i: rotation[i, 0] * v[0] + rotation[i, 1] * v[1] + rotation[i, 2] * v[2])


def at_once(of: int, most: int) -> int:
    """How many of so many are worked on at a time: a CPU's cache holds `most`, other devices take all."""
    return min(most, of) if jax.default_backend() == "cpu" else of


def in_blocks(work: Callable[..., Any], *fields: Any) -> Any:
    """`work` of fields over rays (trees of rasters of one shape) by blocks, so that `when` can pass over blocks."""
    shape = jax.tree.leaves(fields)[0].shape
    count = math.prod(shape)
    block = at_once(count, BLOCK)

    def cut(raster: Array) -> Array:
        return jnp.pad(raster.reshape(-1), (0, -count % block), mode="edge").reshape(-1, block)

    done = jax.lax.map(lambda some: work(*some), jax.tree.map(cut, fields))
    return jax.tree.map(lambda raster: raster.reshape(-1)[:count].reshape(shape), done)


def when(mask: Bool[Array, "..."], work: Callable[..., Any], *fields: Any) -> Any:
    """`work` of the fields where the mask holds anywhere, otherwise zeros of its answer's shapes.

    What it gives is also kept once, where XLA on a CPU would work it out anew for whatever reads it.
    """

    def nothing(*fields: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(work, *fields))

    return jax.lax.cond(mask.any(), work, nothing, *fields)


def cell_hash(x: Int[Array, "..."], y: Int[Array, "..."], z: Int[Array, "..."]) -> Float[Array, "..."]:
    """A number in [0, 1) for each integer cell, uniform and without visible pattern."""
    # The coordinates are mixed by xxHash's primes; the end is Wellons' lowbias32.
    h = x.astype(jnp.uint32) * jnp.uint32(0x9E3779B1)
    h = (h ^ (h >> 15)) + y.astype(jnp.uint32) * jnp.uint32(0x85EBCA77)
    h = (h ^ (h >> 13)) + z.astype(jnp.uint32) * jnp.uint32(0xC2B2AE3D)
    h = (h ^ (h >> 16)) * jnp.uint32(0x7FEB352D)
    h = (h ^ (h >> 15)) * jnp.uint32(0x846CA68B)
    # 24 bits: as many as a float32 holds.
    return (h >> 8).astype(jnp.float32) * jnp.float32(2.0**-24)


def cell(x: Float[Array, "..."]) -> Int[Array, "..."]:
    """Number of the unit cell that holds x."""
    return jnp.floor(x).astype(jnp.int32)


def smooth_noise(x: Float[Array, "..."], y: Float[Array, "..."], seed: Int[Array, "..."]) -> Float[Array, "..."]:
    """Value noise on the unit lattice of the plane, 0..1 with mean 1/2."""
    i, j = cell(x), cell(y)
    u, v = _ease(x - i.astype(jnp.float32)), _ease(y - j.astype(jnp.float32))
    low = _mix(cell_hash(i, j, seed), cell_hash(i + 1, j, seed), u)
    high = _mix(cell_hash(i, j + 1, seed), cell_hash(i + 1, j + 1, seed), u)
    return _mix(low, high, v)


def smooth_noise3(x: Float[Array, "..."], y: Float[Array, "..."], z: Float[Array, "..."]) -> Float[Array, "..."]:
    """Value noise on the unit lattice of space, 0..1 with mean 1/2."""
    k = cell(z)
    below = smooth_noise(x, y, k)
    above = smooth_noise(x, y, k + 1)
    return _mix(below, above, _ease(z - k.astype(jnp.float32)))


def _ease(t: Float[Array, "..."]) -> Float[Array, "..."]:
    # Smoothstep: no slope where two cells meet.
    return t * t * (3.0 - 2.0 * t)


def _mix(a: Float[Array, "..."], b: Float[Array, "..."], weight: Float[Array, "..."]) -> Float[Array, "..."]:
    return a + (b - a) * weight
