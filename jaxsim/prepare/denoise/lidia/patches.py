"""Patches of an image, and back; and for every patch the patches around it that look most alike.

p patch width, d dilation (1 at the fine scale, 2 at the coarse one). A patch is the vector of its p x p cells, channel
by channel and row by row; the image of a (rows, columns) array of patches has rows + d (p - 1) rows.

The distance of two patches is the sum of squared differences. Where the image has cells without a measurement, only
cells that both patches measured are compared, and the sum is scaled to the whole patch.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array
from jaxsim.native import call, floats, integers, takes

RADIUS = 14
"""Shifts of up to this many (dilated) cells are looked at: a window of 29 x 29."""
NEIGHBOURS = 14
"""The patch itself and the 13 nearest others."""
UNLIKE = 1e6
"""Distance of patches that share fewer measured cells than a patch is wide: nothing is known of their likeness."""


def pad(
    image: Float[Array, "b h w c"], margin: int, mode: Literal["reflect", "constant"], *, value: float = 0.0
) -> Float[Array, "b _h _w c"]:
    """The image with a margin of mirrored cells (the border's own is not repeated) or of `value` on all sides."""
    around = ((0, 0), (margin, margin), (margin, margin), (0, 0))
    return jnp.pad(image, around, mode, **({"constant_values": value} if mode == "constant" else {}))


def unfold(image: Float[Array, "b h w c"], p: int, d: int = 1) -> Float[Array, "b rows columns numel"]:
    """Every patch of the image."""
    rows, columns = image.shape[1] - d * (p - 1), image.shape[2] - d * (p - 1)
    row = jnp.arange(rows)[:, None, None, None] + d * jnp.arange(p)[None, None, :, None]
    column = jnp.arange(columns)[None, :, None, None] + d * jnp.arange(p)[None, None, None, :]
    # Channels come before cells in a patch's values, as in PyTorch's unfold.
    cells = jnp.moveaxis(image[:, row, column], -1, 3)
    return cells.reshape(*cells.shape[:3], -1)


def fold(patches: Float[Array, "b rows columns numel"], p: int, d: int = 1) -> Float[Array, "b h w c"]:
    """Sum of overlapping patches in every cell of their image."""
    b, rows, columns, numel = patches.shape
    x = jnp.moveaxis(patches.reshape(b, rows, columns, numel // (p * p), p, p), (3, 4, 5), (0, 1, 2))
    # Along columns, then along rows: 2 p shifted sums instead of p^2.
    x = _overlap([x[:, :, j] for j in range(p)], d)  # c i b rows w
    return jnp.moveaxis(_overlap([x[:, i] for i in range(p)], d, axis=-2), 0, -1)


def _overlap(parts: Sequence[Array], d: int, axis: int = -1) -> Array:
    """Sum of equal parts, each d cells farther along the axis than the one before."""
    total, last = None, d * (len(parts) - 1)
    for k, part in enumerate(parts):
        around = [(0, 0)] * part.ndim
        around[axis] = (d * k, last - d * k)
        shifted = jnp.pad(part, around)
        total = shifted if total is None else total + shifted
    return total


def patch_counts(rows: int, columns: int, p: int, *, d: int) -> Float[Array, "1 h w 1"]:
    """How many patches of such an array cover each cell of their image."""
    return fold(jnp.ones((1, rows, columns, p * p), jnp.float32), p, d)


def blur(image: Float[Array, "b h w c"]) -> Float[Array, "b _h _w c"]:
    """Weighted mean of the 3 x 3 around each cell, 1/4 1/2 1/4 both ways; loses one cell on every side."""
    rows = 0.25 * image[:, :-2] + 0.5 * image[:, 1:-1] + 0.25 * image[:, 2:]
    return 0.25 * rows[:, :, :-2] + 0.5 * rows[:, :, 1:-1] + 0.25 * rows[:, :, 2:]


def _box_sum(x: Float[Array, "h w"], p: int, d: int) -> Float[Array, "rows columns"]:
    """Sum over the p x p cells (d apart) of every patch."""
    rows, columns = x.shape[0] - d * (p - 1), x.shape[1] - d * (p - 1)
    x = sum(x[d * i : d * i + rows] for i in range(1, p)) + x[:rows]
    return sum(x[:, d * j : d * j + columns] for j in range(1, p)) + x[:, :columns]


@partial(jax.jit, static_argnames=("p", "d"))
def nearest_patches(
    image: Float[Array, "h w"], measured: Bool[Array, "h w"] | None, *, p: int, d: int
) -> tuple[Float[Array, "rows columns 14"], Int[Array, "rows columns 14"]]:
    """Distances of the 14 nearest patches, ascending, and their numbers among all patches of `image`, row by row.

    The first is the patch itself. `image` has a margin of 14 d cells around the patches that ask. `measured=None`:
    every cell is.
    """
    if takes(image):
        return _in_cpp(image, measured, p=p, d=d)
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
            return _box_sum((there - here) ** 2, p, d)
        mask_there = jax.lax.dynamic_slice(mask, corner, (h, w))
        # Each side times the other's mask: cells that only one measured are equal, and add nothing.
        squares = _box_sum((there * mask_here - here * mask_there) ** 2, p, d)
        shared = _box_sum(mask_here * mask_there, p, d)
        return jnp.where(shared >= p, squares * (p * p / jnp.maximum(shared, 1.0)), UNLIKE)

    middle = side * RADIUS + RADIUS
    # One shift after the other: all 841 at once would hold as many copies of the image.
    distances = jax.lax.map(distance, jnp.arange(side * side))
    # Below all others: an equal patch elsewhere may lie on other unmeasured cells.
    distances = distances.at[middle].set(-1.0)
    negative, shift = jax.lax.top_k(-distances.reshape(side * side, -1).T, NEIGHBOURS)
    nearest = (-negative).at[:, 0].set(0.0).reshape(rows, columns, NEIGHBOURS)
    shift = shift.reshape(rows, columns, NEIGHBOURS).astype(jnp.int32)
    row = jnp.arange(rows)[:, None, None] + d * (shift // side)
    column = jnp.arange(columns)[None, :, None] + d * (shift % side)
    return nearest, row * (image.shape[1] - d * (p - 1)) + column


def _in_cpp(
    image: Float[Array, "h w"], measured: Bool[Array, "h w"] | None, *, p: int, d: int
) -> tuple[Float[Array, "rows columns 14"], Int[Array, "rows columns 14"]]:
    """`nearest_patches` in C++, for CPUs with a compiler."""
    border = d * (2 * RADIUS + p - 1)
    shape = (image.shape[0] - border, image.shape[1] - border, NEIGHBOURS)
    if measured is None:
        operands = (image, jnp.zeros((), jnp.float32))
    else:
        operands = (jnp.where(measured, image, 0.0), measured.astype(jnp.float32))
    result = (floats(*shape), integers(*shape))
    return call("nearest_patches", result, *operands, p=p, d=d, radius=RADIUS, unlike=UNLIKE)
