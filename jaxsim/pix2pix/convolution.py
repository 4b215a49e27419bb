"""Convolutions of (b, h, w, c) arrays with kernels (kh, kw, c_in, c_out), padded by half the kernel."""

from __future__ import annotations

from typing import Any, Literal

import jax.numpy as jnp
from jax import lax
from jaxtyping import Float

Array = Any
Padding = Literal["reflect", "zero"]


def conv2d(
    x: Float[Array, "b h w c_in"],
    kernel: Float[Array, "kh kw c_in c_out"],
    *,
    stride: int = 1,
    padding: Padding = "reflect",
) -> Float[Array, "b h_out w_out c_out"]:
    """Cross-correlation with kh // 2 and kw // 2 cells of padding on every side.

    The padding is explicit: XLA's SAME would put it on one side only at stride 2 and shift the grid.
    """
    rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
    if padding == "reflect" and (rows or columns):
        x = jnp.pad(x, ((0, 0), (rows, rows), (columns, columns), (0, 0)), mode="reflect")
        rows = columns = 0
    return lax.conv_general_dilated(
        x,
        kernel,
        (stride, stride),
        ((rows, rows), (columns, columns)),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )


def upsample(x: Float[Array, "b h w c"]) -> Float[Array, "b 2*h 2*w c"]:
    """Nearest neighbour, twice the rows and columns."""
    b, h, w, c = x.shape
    return jnp.broadcast_to(x[:, :, None, :, None], (b, h, 2, w, 2, c)).reshape(b, 2 * h, 2 * w, c)


def average_pool(x: Float[Array, "b h w c"]) -> Float[Array, "b h//2 w//2 c"]:
    """3 x 3 means at stride 2; cells outside the raster are not counted."""
    window = ((1, 3, 3, 1), (1, 2, 2, 1), ((0, 0), (1, 1), (1, 1), (0, 0)))
    count = lax.reduce_window(jnp.ones((1, *x.shape[1:3], 1), x.dtype), 0.0, lax.add, *window)
    return lax.reduce_window(x, 0.0, lax.add, *window) / count


def halve(x: Float[Array, "b h w c"]) -> Float[Array, "b h//2 w//2 c"]:
    """Bilinear, half the rows and columns, corner cells on corner cells (`align_corners=True`).

    Output i of n then lies i / (n - 1) of the way from cell 2i to cell 2i + 1. h and w must be even.
    """
    for axis in (1, 2):
        n = x.shape[axis] // 2
        pairs = x.reshape(*x.shape[:axis], n, 2, *x.shape[axis + 1 :])
        far = jnp.arange(n, dtype=x.dtype) / max(n - 1, 1)
        weights = jnp.stack([1 - far, far], axis=-1)
        x = (pairs * weights.reshape(n, 2, *(1,) * (x.ndim - axis - 1))[(None,) * axis]).sum(axis + 1)
    return x
