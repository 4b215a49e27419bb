"""Convolutions of (b, h, w, c) arrays with kernels (kh, kw, c_in, c_out), padded by half the kernel.

On accelerators these are XLA's own; on a CPU (chosen when a function is traced) `convolution_cpu` has forms
of the same sums that XLA computes several times faster there.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Float

from jaxsim.frame import Array
from jaxsim.pix2pix import convolution_cpu

Padding = Literal["reflect", "zero"]
_ANY_DEVICE = ContextVar("_ANY_DEVICE", default=False)


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
    if on_cpu():
        if padding == "reflect":
            x = convolution_cpu.reflect_pad(x, (rows, columns))
            rows, columns = 0, 0
        return convolution_cpu.convolve(x, kernel, stride=stride, padding=(rows, columns))
    if padding == "reflect":
        x = jnp.pad(x, ((0, 0), (rows, rows), (columns, columns), (0, 0)), mode="reflect")
        rows, columns = 0, 0
    return lax.conv_general_dilated(
        x, kernel, (stride, stride), ((rows, rows), (columns, columns)), dimension_numbers=("NHWC", "HWIO", "NHWC")
    )


def upsample_conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "3 3 c_in c_out"]
) -> Float[Array, "b 2*h 2*w c_out"]:
    """`conv2d` of x at twice the rows and columns, nearest neighbour, reflect padding."""
    if on_cpu():
        return convolution_cpu.upsample_convolve(x, kernel)
    b, h, w, c = x.shape
    doubled = jnp.broadcast_to(x[:, :, None, :, None], (b, h, 2, w, 2, c)).reshape(b, 2 * h, 2 * w, c)
    return conv2d(doubled, kernel)


def transposed_conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "3 3 c_in c_out"]
) -> Float[Array, "b 2*h 2*w c_out"]:
    """Cross-correlation of x with zeros between, and after, its rows and columns.

    This is PyTorch's ConvTranspose2d of 3 x 3, stride 2, padding 1, output padding 1, with the kernel turned
    by half a circle.
    """
    if on_cpu():
        return convolution_cpu.transposed_convolve(x, kernel)
    # PyTorch's padding of 1 seen from the other side is 3 - 1 - 1 = 1; its output padding adds one behind.
    around = ((1, 2), (1, 2))
    return lax.conv_general_dilated(
        x, kernel, (1, 1), around, lhs_dilation=(2, 2), dimension_numbers=("NHWC", "HWIO", "NHWC")
    )


def average_pool(x: Float[Array, "b h w c"]) -> Float[Array, "b h//2 w//2 c"]:
    """3 x 3 means at stride 2; cells outside the raster are not counted. h and w must be even."""
    # Output i covers cells 2i - 1, 2i and 2i + 1; the first lacks the one before it.
    for axis in (1, 2):
        even, odd = _pairs(x, axis)
        n = even.shape[axis]
        before = [(1, 0) if i == axis else (0, 0) for i in range(4)]
        count = jnp.full(n, 3.0, x.dtype).at[0].set(2.0)
        total = even + odd + jnp.pad(lax.slice_in_dim(odd, 0, n - 1, axis=axis), before)
        x = total / _along(count, axis)
    return x


def halve(x: Float[Array, "b h w c"]) -> Float[Array, "b h//2 w//2 c"]:
    """Bilinear, half the rows and columns, corner cells on corner cells (`align_corners=True`).

    Output i of n then lies i / (n - 1) of the way from cell 2i to cell 2i + 1. h and w must be even.
    """
    for axis in (1, 2):
        even, odd = _pairs(x, axis)
        n = even.shape[axis]
        share = _along(jnp.arange(n, dtype=x.dtype) / max(n - 1, 1), axis)
        x = even * (1 - share) + odd * share
    return x


def on_cpu() -> bool:
    """Whether functions traced now are for a CPU."""
    return jax.default_backend() == "cpu" and not _ANY_DEVICE.get()


@contextmanager
def for_any_device() -> Iterator[None]:
    """Functions traced within are for devices that this machine need not have: they take XLA's own forms."""
    token = _ANY_DEVICE.set(True)
    try:
        yield
    finally:
        _ANY_DEVICE.reset(token)


def _pairs(x: Array, axis: int) -> tuple[Array, Array]:
    """Every other entry along an axis, from the first and from the second on."""
    pairs = x.reshape(*x.shape[:axis], -1, 2, *x.shape[axis + 1 :])
    even = lax.index_in_dim(pairs, 0, axis + 1, keepdims=False)
    odd = lax.index_in_dim(pairs, 1, axis + 1, keepdims=False)
    return even, odd


def _along(values: Array, axis: int) -> Array:
    """One value an entry of an axis of a (b, h, w, c) array."""
    return values.reshape([-1 if i == axis else 1 for i in range(4)])
