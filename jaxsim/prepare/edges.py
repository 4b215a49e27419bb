"""Borders between classes and between instances, as pix2pixHD gives them to its generator."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int

from jaxsim.frame import Array


@jax.jit
def edge_map(semantic: Int[Array, "*b h w"], instance: Int[Array, "*b h w"]) -> Bool[Array, "*b h w"]:
    """Cells whose class or instance differs from that of a neighbour above, below, left or right.

    Both sides of a border are marked; the raster's own border is none. Comparing the pair is the published
    comparison of `semantic * 1000 + instance` for fewer than 1000 instances, and holds beyond.
    """
    down = (semantic[..., 1:, :] != semantic[..., :-1, :]) | (instance[..., 1:, :] != instance[..., :-1, :])
    right = (semantic[..., 1:] != semantic[..., :-1]) | (instance[..., 1:] != instance[..., :-1])
    batch = [(0, 0)] * (semantic.ndim - 2)
    above = [*batch, (1, 0), (0, 0)]
    below = [*batch, (0, 1), (0, 0)]
    before = [*batch, (0, 0), (1, 0)]
    after = [*batch, (0, 0), (0, 1)]
    return jnp.pad(down, above) | jnp.pad(down, below) | jnp.pad(right, before) | jnp.pad(right, after)
