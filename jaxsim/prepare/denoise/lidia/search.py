"""For every patch of an image, the patches around it that look most alike.

The distance is the sum of squared differences. Where the image has cells without a measurement, only cells that both
patches measured are compared, and the sum is scaled to the whole patch.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

Array = Any

RADIUS = 14
"""Shifts of up to this many (dilated) cells are looked at: a window of 29 x 29."""
NEIGHBOURS = 14
"""The patch itself and the 13 nearest others."""
UNLIKE = 1e6
"""Distance of patches that share fewer measured cells than a patch is wide: nothing is known of their likeness."""


def box_sum(x: Float[Array, "h w"], p: int, d: int) -> Float[Array, "rows columns"]:
    """Sum over the p x p cells (d apart) of every patch."""
    rows, columns = x.shape[0] - d * (p - 1), x.shape[1] - d * (p - 1)
    x = sum(x[d * i : d * i + rows] for i in range(1, p)) + x[:rows]
    x = jax.lax.optimization_barrier(x)  # else the row sums are taken once for each of the p columns
    return sum(x[:, d * j : d * j + columns] for j in range(1, p)) + x[:, :columns]


@partial(jax.jit, static_argnames=("p", "d"))
def nearest_patches(
    image: Float[Array, "h w"], measured: Bool[Array, "h w"] | None, *, p: int, d: int
) -> tuple[Float[Array, "rows columns 14"], Int[Array, "rows columns 14"]]:
    """Distances of the 14 nearest patches, ascending, and their numbers among all patches of `image`, row by row.

    The first is the patch itself. `image` has a margin of 14 d cells around the patches that ask. `measured=None`:
    every cell is.
    """
    margin, side = RADIUS * d, 2 * RADIUS + 1
    h, w = image.shape[0] - 2 * margin, image.shape[1] - 2 * margin
    rows, columns = h - d * (p - 1), w - d * (p - 1)
    here = image[margin : margin + h, margin : margin + w]
    if measured is not None:
        mask = measured.astype(image.dtype)
        image = jnp.where(measured, image, 0.0)
        here = image[margin : margin + h, margin : margin + w]
        mask_here = mask[margin : margin + h, margin : margin + w]

    def distance(shift: Array) -> Array:
        corner = (d * (shift // side), d * (shift % side))
        there = jax.lax.dynamic_slice(image, corner, (h, w))
        if measured is None:
            return box_sum((there - here) ** 2, p, d)
        mask_there = jax.lax.dynamic_slice(mask, corner, (h, w))
        squares = box_sum((there * mask_here - here * mask_there) ** 2, p, d)
        shared = box_sum(mask_here * mask_there, p, d)
        return jnp.where(shared >= p, squares * (p * p / jnp.maximum(shared, 1.0)), UNLIKE)

    middle = side * RADIUS + RADIUS
    distances = jax.lax.map(distance, jnp.arange(side * side))
    # Below all others: an equal patch elsewhere may lie on other unmeasured cells.
    distances = distances.at[middle].set(-1.0)
    negative, shift = jax.lax.top_k(-distances.reshape(side * side, -1).T, NEIGHBOURS)
    found = (-negative).at[:, 0].set(0.0).reshape(rows, columns, NEIGHBOURS)
    shift = shift.reshape(rows, columns, NEIGHBOURS).astype(jnp.int32)
    row = jnp.arange(rows)[:, None, None] + d * (shift // side)
    column = jnp.arange(columns)[None, :, None] + d * (shift % side)
    return found, row * (image.shape[1] - d * (p - 1)) + column
