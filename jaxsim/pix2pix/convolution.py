"""Convolutions of (b, h, w, c) arrays with kernels (kh, kw, c_in, c_out), padded by half the kernel.

On accelerators these are XLA's own; on a CPU (chosen when a function is traced) they are forms of the same sums that
XLA computes several times faster there. What XLA's own forms lose (`benchmarks/speed/pix2pixhd.py` measures the whole):

- unpadded convolutions of several images: factors of 3 to 10, unless one column of zero padding is added
  (and cut off again);
- few cells and many channels, the middle of the generator: up to 8 in the gradients, which a product of
  patches with the kernel takes without a transposed copy of the kernel;
- weight gradients at stride 2: 2 to 4 against products of shifted cells with the gradient, item by item;
- nearest up-sampling before a 3 x 3 kernel: the four cells that stem from one see 2 x 2 cells with sums of
  kernel rows and columns, which is 2.25 times less work;
- reflection, forward and backward: 2.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float, Int

from jaxsim.frame import Array

Padding = Literal["reflect", "zero"]
_ANY_DEVICE = ContextVar("_ANY_DEVICE", default=False)
_Pair = tuple[int, int]
"""Numbers of rows and columns."""
COMPILER_OPTIONS = {"xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_DOT"}


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
    cells = kernel.shape[0] // 2, kernel.shape[1] // 2
    if padding == "reflect":
        x = reflect_pad(x, cells) if on_cpu() else jnp.pad(x, ((0, 0), *_both_sides(cells), (0, 0)), mode="reflect")
        cells = 0, 0
    if on_cpu():
        return convolve(x, kernel, stride=stride, padding=cells)
    return _convolve(x, kernel, around=_both_sides(cells), stride=stride)


def upsample_conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "3 3 c_in c_out"]
) -> Float[Array, "b 2*h 2*w c_out"]:
    """`conv2d` of x at twice the rows and columns, nearest neighbour, reflect padding."""
    return upsample_convolve(x, kernel) if on_cpu() else conv2d(doubled(x), kernel)


def doubled(x: Float[Array, "b h w c"]) -> Float[Array, "b 2*h 2*w c"]:
    """Twice the rows and columns, nearest neighbour."""
    b, h, w, c = x.shape
    return jnp.broadcast_to(x[:, :, None, :, None], (b, h, 2, w, 2, c)).reshape(b, 2 * h, 2 * w, c)


def transposed_conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "3 3 c_in c_out"]
) -> Float[Array, "b 2*h 2*w c_out"]:
    """Cross-correlation of x with zeros between, and after, its rows and columns.

    This is PyTorch's ConvTranspose2d of 3 x 3, stride 2, padding 1, output padding 1, with the kernel turned
    by half a circle.
    """
    if on_cpu():
        return transposed_convolve(x, kernel)
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


def compiler_options() -> dict[str, str] | None:
    """Options for the `jax.jit` of a training step: leave convolutions to Eigen.

    XLA's newer library (YNNPACK) takes 2 to 4 times as long for weight gradients of several images, and
    longer to compile. None where XLA does not know the option.
    """
    try:
        jax.jit(lambda: 0, compiler_options=COMPILER_OPTIONS).lower().compile()
    except jax.errors.JaxRuntimeError:
        return None
    return COMPILER_OPTIONS


def convolve(x: Array, kernel: Array, *, stride: int = 1, padding: _Pair = (0, 0)) -> Array:
    """Cross-correlation of (b, h, w, c) with zeros around: rows and columns of them on either side."""
    kh, kw, _, wide = kernel.shape
    b, h, w, _ = x.shape
    rows, columns = (h + 2 * padding[0] - kh) // stride + 1, (w + 2 * padding[1] - kw) // stride + 1
    if b * rows * columns <= 2 * wide:
        # Few cells, many channels: gradients of a product need no transposed copy of the kernel.
        return _patch_product(_zero_pad(x, padding), kernel, (rows, columns), stride=stride)
    if stride > 1:
        return _convolve_strided((stride, padding), x, kernel)
    if padding == (0, 0):
        # A column of zeros more, cut off again: XLA has a faster form for anything that is padded.
        return _convolve(x, kernel, around=((0, 0), (0, 1)))[:, :, :columns]
    return _convolve(x, kernel, around=_both_sides(padding))


def upsample_convolve(x: Array, kernel: Array) -> Array:
    """3 x 3 convolution, reflect padding, of x at twice the rows and columns (nearest neighbour)."""
    _, h, w, _ = x.shape
    # Reflection of repeated cells is repetition of the outermost one.
    x = jnp.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    # Of output row 2i + p, kernel rows (0 | 1, 2) fall on input rows i - 1 and i for p = 0, (0, 1 | 2) on i and
    # i + 1 for p = 1; columns alike.
    by_row = (jnp.stack([kernel[0], kernel[1] + kernel[2]]), jnp.stack([kernel[0] + kernel[1], kernel[2]]))
    phases = []
    for p, half in enumerate(by_row):
        left, middle = half[:, 0], half[:, 1]
        right = half[:, 2]
        by_column = (jnp.stack([left, middle + right], 1), jnp.stack([left + middle, right], 1))
        for q, quarter in enumerate(by_column):
            phases.append(convolve(x[:, p : p + h + 1, q : q + w + 1], quarter))
    return _interleave(phases, (h, w))


def transposed_convolve(x: Array, kernel: Array) -> Array:
    """3 x 3 convolution of x with zeros between, and after, its rows and columns: the four phases of the result."""
    # Of output row 2i only kernel row 1 falls on a row of x, row i; of output row 2i + 1 kernel rows 0 and 2 fall on
    # rows i and i + 1; columns alike.
    _, h, w, _ = x.shape
    x = jnp.pad(x, ((0, 0), (0, 1), (0, 1), (0, 0)))
    phases = []
    for p in (0, 1):
        for q in (0, 1):
            taps = kernel[1 - p :: 2 if p else 3, 1 - q :: 2 if q else 3]
            phases.append(convolve(x[:, : h + p, : w + q], taps))
    return _interleave(phases, (h, w))


def _interleave(phases: list[Array], size: _Pair) -> Array:
    """One raster of the cells (2i, 2j), (2i, 2j + 1), (2i + 1, 2j), (2i + 1, 2j + 1) from a raster of each."""
    h, w = size
    y = jnp.stack(phases, axis=3).reshape(-1, h, w, 2, 2, phases[0].shape[-1])
    return y.transpose(0, 1, 3, 2, 4, 5).reshape(-1, 2 * h, 2 * w, y.shape[-1])


def _mirrored(images: int, rows: int, beyond: int) -> Int[np.ndarray, " n"]:
    """Rows of images that lie one after the other, with so many mirrored ones on either side of each."""
    return (np.arange(images)[:, None] * rows + np.pad(np.arange(rows), beyond, mode="reflect")).reshape(-1)


@partial(jax.custom_vjp, nondiff_argnums=(1,))
def reflect_pad(x: Array, cells: _Pair) -> Array:
    """x mirrored at its outermost cells, which are not repeated: so many rows and columns on either side."""
    rows, columns = cells
    b, h, w, c = x.shape
    if rows:
        x = jnp.take(x.reshape(b * h, w, c), _mirrored(b, h, rows), axis=0, mode="clip").reshape(b, -1, w, c)
    if columns:
        before = [x[:, :, i : i + 1] for i in range(columns, 0, -1)]
        after = [x[:, :, i : i + 1] for i in range(w - 2, w - 2 - columns, -1)]
        x = jnp.concatenate([*before, x, *after], axis=2)
    return x


def _reflect_backward(cells: _Pair, _: None, gradient: Array) -> tuple[Array]:
    for axis, pad in zip((1, 2), cells, strict=True):
        n = gradient.shape[axis] - 2 * pad
        part = partial(lax.slice_in_dim, gradient, axis=axis)
        low, high = lax.rev(part(0, pad), (axis,)), lax.rev(part(n + pad, n + 2 * pad), (axis,))
        # Each mirrored cell gives its gradient to the one that it repeats; the outermost is not repeated.
        if n >= 2 * pad + 2:  # the mirrored cells of the two ends are apart
            parts = [
                part(pad, pad + 1),
                part(pad + 1, 2 * pad + 1) + low,
                part(2 * pad + 1, n - 1),
                part(n - 1, n + pad - 1) + high,
                part(n + pad - 1, n + pad),
            ]
            gradient = jnp.concatenate(parts, axis=axis)
        else:
            at = [
                [(before, n - pad - before) if i == axis else (0, 0) for i in range(4)] for before in (1, n - 1 - pad)
            ]
            gradient = part(pad, n + pad) + jnp.pad(low, at[0]) + jnp.pad(high, at[1])
    return (gradient,)


reflect_pad.defvjp(lambda x, cells: (reflect_pad(x, cells), None), _reflect_backward)


def _convolve(x: Array, kernel: Array, *, around: tuple[_Pair, _Pair], stride: int = 1) -> Array:
    return lax.conv_general_dilated(x, kernel, (stride, stride), around, dimension_numbers=("NHWC", "HWIO", "NHWC"))


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _convolve_strided(form: tuple[int, _Pair], x: Array, kernel: Array) -> Array:
    """`form` is the stride and the padding."""
    stride, padding = form
    return _convolve(x, kernel, around=_both_sides(padding), stride=stride)


def _strided_backward(form: tuple[int, _Pair], saved: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    stride, padding = form
    x, kernel = saved
    kh, kw, _, _ = kernel.shape
    _, rows, columns, _ = gradient.shape

    def add_item(total: Array, item: tuple[Array, Array]) -> tuple[Array, None]:
        cells, slope = item
        taps = _taps(_zero_pad(cells[None], padding), (kh, kw), (rows, columns), stride=stride)
        products = [lax.dot_general(slope, tap[0], (((0, 1), (0, 1)), ((), ()))) for tap in taps]
        return total + jnp.stack(products), None

    start = jnp.zeros((kh * kw, kernel.shape[3], kernel.shape[2]), kernel.dtype)
    total, _ = lax.scan(add_item, start, (x, gradient))
    # Only the kernel's gradient is slow in XLA: that of the input stays its own.
    linear = partial(_convolve, kernel=kernel, around=_both_sides(padding), stride=stride)
    (back,) = jax.linear_transpose(linear, x)(gradient)
    # Products are (taps, out, in), a kernel (kh, kw, in, out).
    return back, total.swapaxes(1, 2).reshape(kernel.shape)


_convolve_strided.defvjp(lambda form, *given: (_convolve_strided(form, *given), given), _strided_backward)


def _patch_product(x: Array, kernel: Array, size: _Pair, *, stride: int) -> Array:
    """Convolution of the cells that are there, as one matrix product."""
    kh, kw, _, wide = kernel.shape
    patches = jnp.concatenate(_taps(x, (kh, kw), size, stride=stride), axis=-1)
    return (patches.reshape(-1, patches.shape[-1]) @ kernel.reshape(-1, wide)).reshape(-1, *size, wide)


def _taps(x: Array, kernel: _Pair, size: _Pair, *, stride: int) -> list[Array]:
    """The cells that each kernel element meets, in the kernel's order."""
    b, _, _, c = x.shape
    down, right = (size[0] - 1) * stride + 1, (size[1] - 1) * stride + 1
    return [
        lax.slice(x, (0, i, j, 0), (b, i + down, j + right, c), (1, stride, stride, 1))
        for i in range(kernel[0])
        for j in range(kernel[1])
    ]


def _zero_pad(x: Array, padding: _Pair) -> Array:
    return jnp.pad(x, ((0, 0), *_both_sides(padding), (0, 0)))


def _both_sides(padding: _Pair) -> tuple[_Pair, _Pair]:
    return (padding[0], padding[0]), (padding[1], padding[1])
