"""Convolutions of (b, h, w, c) arrays with kernels (kh, kw, c_in, c_out), padded by half the kernel.

On accelerators every convolution is XLA's own. On a CPU (chosen when a function is traced) four of XLA's
forms lose by factors, and another form of the same sums is taken; `benchmarks/pix2pixhd.py` measures them:

- an unpadded convolution of several images: it gets one column of zero padding, and the column is cut off;
- few cells and many channels (the middle of the generator): a product of patches with the kernel, whose
  gradients are products too and need no transposed copy of the kernel;
- a weight gradient at stride 2: products of the gradient with shifted cells, item by item;
- nearest up-sampling before a 3 x 3 kernel: the four cells that stem from one see 2 x 2 cells with sums of
  kernel rows and columns, which is 2.25 times less work.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float

Array = Any
Padding = Literal["reflect", "zero"]

CPU_COMPILER_OPTIONS = {"xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_DOT"}


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
    if padding == "reflect":
        x = _reflect_pad(x, rows, columns)
    elif _on_cpu():
        x = jnp.pad(x, ((0, 0), (rows, rows), (columns, columns), (0, 0)))
    else:
        return _convolve(x, kernel, stride, ((rows, rows), (columns, columns)))
    return _convolve_unpadded(x, kernel, stride)


@partial(jax.custom_vjp, nondiff_argnums=(1, 2))
def _reflect_pad(x: Array, rows: int, columns: int) -> Array:
    """x mirrored at its outermost cells, which are not repeated."""
    # Looked up rather than reversed and joined: half the time on a CPU.
    for axis, n in ((1, rows), (2, columns)):
        if n:
            size = x.shape[axis]
            place = np.pad(np.arange(size), n, mode="reflect")
            x = jnp.take(x, place, axis=axis, mode="clip")
    return x


def _reflect_forward(x: Array, rows: int, columns: int) -> tuple[Array, None]:
    return _reflect_pad(x, rows, columns), None


def _reflect_backward(rows: int, columns: int, _: None, gradient: Array) -> tuple[Array]:
    shape = (gradient.shape[0], gradient.shape[1] - 2 * rows, gradient.shape[2] - 2 * columns, gradient.shape[3])
    pads = ((0, 0), (rows, rows), (columns, columns), (0, 0))
    return jax.linear_transpose(partial(jnp.pad, pad_width=pads, mode="reflect"), jnp.zeros(shape))(gradient)


_reflect_pad.defvjp(_reflect_forward, _reflect_backward)


def upsample_conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "3 3 c_in c_out"]
) -> Float[Array, "b 2*h 2*w c_out"]:
    """`conv2d` of x at twice the rows and columns, nearest neighbour, reflect padding."""
    b, h, w, _ = x.shape
    if not _on_cpu():
        return conv2d(upsample(x), kernel)
    # Reflection of repeated cells is repetition of the outermost one.
    x = jnp.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    # Of output row 2i + p, kernel rows (0 | 1, 2) fall on input rows i - 1 and i for p = 0, (0, 1 | 2) on i and
    # i + 1 for p = 1; columns alike.
    by_row = (jnp.stack([kernel[0], kernel[1] + kernel[2]]), jnp.stack([kernel[0] + kernel[1], kernel[2]]))
    phases = []
    for p, half in enumerate(by_row):
        left, middle, right = half[:, 0], half[:, 1], half[:, 2]
        by_column = (jnp.stack([left, middle + right], 1), jnp.stack([left + middle, right], 1))
        for q, quarter in enumerate(by_column):
            part = x[:, p : p + h + 1, q : q + w + 1]
            phases.append(_convolve_unpadded(part, quarter, 1))
    y = jnp.stack(phases, axis=3).reshape(b, h, w, 2, 2, -1)
    return y.transpose(0, 1, 3, 2, 4, 5).reshape(b, 2 * h, 2 * w, -1)


def compiler_options() -> dict[str, str] | None:
    """Options for `jax.jit` of a training step: on a CPU, leave convolutions to Eigen.

    XLA's newer library is several times slower on weight gradients of several images. None where the option
    is not needed or not known.
    """
    if not _on_cpu():
        return None
    try:
        jax.jit(lambda: 0, compiler_options=CPU_COMPILER_OPTIONS).lower().compile()
    except jax.errors.JaxRuntimeError:
        return None
    return CPU_COMPILER_OPTIONS


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


def _on_cpu() -> bool:
    return jax.default_backend() == "cpu"


def _convolve(x: Array, kernel: Array, stride: int, padding: Any) -> Array:
    return lax.conv_general_dilated(x, kernel, (stride, stride), padding, dimension_numbers=("NHWC", "HWIO", "NHWC"))


def _convolve_unpadded(x: Array, kernel: Array, stride: int) -> Array:
    """Convolution of the cells that are there, in the form that the backend does best."""
    kh, kw, _, wide = kernel.shape
    b, h, w, _ = x.shape
    rows, columns = (h - kh) // stride + 1, (w - kw) // stride + 1
    if not _on_cpu():
        return _convolve(x, kernel, stride, ((0, 0), (0, 0)))
    if b * rows * columns <= 2 * wide:
        return _patch_product(x, kernel, stride)
    if stride > 1:
        return _convolve_strided(x, kernel, stride)
    return _convolve(x, kernel, stride, ((0, 0), (0, 1)))[:, :, :columns]


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def _convolve_strided(x: Array, kernel: Array, stride: int) -> Array:
    return _convolve(x, kernel, stride, ((0, 0), (0, 0)))


def _strided_forward(x: Array, kernel: Array, stride: int) -> tuple[Array, tuple[Array, Array]]:
    return _convolve_strided(x, kernel, stride), (x, kernel)


def _strided_backward(stride: int, saved: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    x, kernel = saved
    kh, kw, _, _ = kernel.shape
    _, rows, columns, _ = gradient.shape

    def add_item(total: Array, item: tuple[Array, Array]) -> tuple[Array, None]:
        cells, slope = item
        taps = [
            lax.dot_general(slope, part[0], (((0, 1), (0, 1)), ((), ())))
            for part in _taps(cells[None], kh, kw, (rows, columns), stride)
        ]
        return total + jnp.stack(taps), None

    start = jnp.zeros((kh * kw, kernel.shape[3], kernel.shape[2]), kernel.dtype)
    total, _ = lax.scan(add_item, start, (x, gradient))
    (back,) = jax.linear_transpose(lambda x: _convolve(x, kernel, stride, ((0, 0), (0, 0))), x)(gradient)
    return back, total.swapaxes(1, 2).reshape(kernel.shape)


_convolve_strided.defvjp(_strided_forward, _strided_backward)


def _taps(x: Array, kh: int, kw: int, size: tuple[int, int], stride: int) -> list[Array]:
    """The cells that each kernel element meets, in the kernel's order."""
    b, _, _, c = x.shape
    down, right = ((n - 1) * stride + 1 for n in size)
    strides = (1, stride, stride, 1)
    return [lax.slice(x, (0, i, j, 0), (b, i + down, j + right, c), strides) for i in range(kh) for j in range(kw)]


def _patch_product(x: Array, kernel: Array, stride: int) -> Array:
    """Convolution of the cells that are there, as one matrix product."""
    kh, kw, c, wide = kernel.shape
    b, h, w, _ = x.shape
    rows, columns = (h - kh) // stride + 1, (w - kw) // stride + 1
    taps = _taps(x, kh, kw, (rows, columns), stride)
    patches = jnp.concatenate(taps, axis=-1).reshape(b * rows * columns, kh * kw * c)
    return (patches @ kernel.reshape(kh * kw * c, wide)).reshape(b, rows, columns, wide)
