"""Patches of an image, and back: the geometry that LIDIA's search and its network share.

p patch width, d dilation (1 at the fine scale, 2 at the coarse one). A patch is the vector of its p x p cells, channel
by channel and row by row; the image of a (rows, columns) array of patches has rows + d (p - 1) rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import jax.numpy as jnp
from jaxtyping import Float

Array = Any


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
    cells = jnp.moveaxis(image[:, row, column], -1, 3)
    return cells.reshape(*cells.shape[:3], -1)


def fold(patches: Float[Array, "b rows columns numel"], p: int, d: int = 1) -> Float[Array, "b h w c"]:
    """Sum of overlapping patches in every cell of their image."""
    b, rows, columns, numel = patches.shape
    x = jnp.moveaxis(patches.reshape(b, rows, columns, numel // (p * p), p, p), (3, 4, 5), (0, 1, 2))
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


def counts(rows: int, columns: int, p: int, d: int = 1) -> Float[Array, "1 h w 1"]:
    """How many patches of such an array cover each cell of their image."""
    return fold(jnp.ones((1, rows, columns, p * p), jnp.float32), p, d)


def blur(image: Float[Array, "b h w c"]) -> Float[Array, "b _h _w c"]:
    """Weighted mean of the 3 x 3 around each cell, 1/4 1/2 1/4 both ways; loses one cell on every side."""
    rows = 0.25 * image[:, :-2] + 0.5 * image[:, 1:-1] + 0.25 * image[:, 2:]
    return 0.25 * rows[:, :, :-2] + 0.5 * rows[:, :, 1:-1] + 0.25 * rows[:, :, 2:]
