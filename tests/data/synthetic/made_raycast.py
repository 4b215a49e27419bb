"""What tests of raycast are made of."""

import jax.numpy as jnp
import numpy as np


def slow_noise(x: np.ndarray) -> float:
    """Value noise of a point in space, from the lattice's hashes in Python integers."""

    def hashed(i: int, j: int, k: int) -> float:
        mask = 0xFFFFFFFF
        h = (i & mask) * 0x9E3779B1 & mask
        h = ((h ^ h >> 15) + (j & mask) * 0x85EBCA77) & mask
        h = ((h ^ h >> 13) + (k & mask) * 0xC2B2AE3D) & mask
        h = (h ^ h >> 16) * 0x7FEB352D & mask
        h = (h ^ h >> 15) * 0x846CA68B & mask
        return (h >> 8) / 2**24

    corner = np.floor(x).astype(int)

    t = x - corner
    ease = t * t * (3 - 2 * t)
    total = 0.0
    for step in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(step, ease, 1 - ease))
        total += weight * hashed(*(corner + step).tolist())
    return total


def bundle(eye: np.ndarray, aim: np.ndarray) -> tuple:
    """The kernel's layout: one tile of rays, component by component."""
    return tuple(jnp.asarray(eye[:, None, None], jnp.float32)), tuple(jnp.asarray(aim.T[:, None, :], jnp.float32))
