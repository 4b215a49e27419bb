"""Procedural randomness: the same place always looks the same, from whichever sensor it is seen.

Values are hashes of integer lattice cells, so a texture needs no memory and no state.
"""

import jax.numpy as jnp
from jaxtyping import Float, Int

from jaxsim.frame import Array


def cell_hash(x: Int[Array, "..."], y: Int[Array, "..."], z: Int[Array, "..."]) -> Float[Array, "..."]:
    """A number in [0, 1) for each integer cell, uniform and without visible pattern."""
    h = x.astype(jnp.uint32) * jnp.uint32(0x9E3779B1)
    h = (h ^ (h >> 15)) + y.astype(jnp.uint32) * jnp.uint32(0x85EBCA77)
    h = (h ^ (h >> 13)) + z.astype(jnp.uint32) * jnp.uint32(0xC2B2AE3D)
    h = (h ^ (h >> 16)) * jnp.uint32(0x7FEB352D)
    h = (h ^ (h >> 15)) * jnp.uint32(0x846CA68B)
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
    return t * t * (3.0 - 2.0 * t)


def _mix(a: Float[Array, "..."], b: Float[Array, "..."], weight: Float[Array, "..."]) -> Float[Array, "..."]:
    return a + (b - a) * weight
