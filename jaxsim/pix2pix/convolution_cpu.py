"""Convolution on a CPU: forms of the same sums that XLA computes fast there.

`benchmarks/speed/pix2pixhd.py` measures the whole; what XLA's own forms lose is

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

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxsim.frame import Array

Pair = tuple[int, int]
"""Numbers of rows and columns."""
COMPILER_OPTIONS = {"xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_DOT"}


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


def convolve(x: Array, kernel: Array, *, stride: int = 1, padding: Pair = (0, 0)) -> Array:
    """Cross-correlation of (b, h, w, c) with zeros around: rows and columns of them on either side."""
    kh, kw, _, wide = kernel.shape
    b, h, w, _ = x.shape
    rows, columns = (h + 2 * padding[0] - kh) // stride + 1, (w + 2 * padding[1] - kw) // stride + 1
    if b * rows * columns <= 2 * wide:
        return _patch_product(_zero_pad(x, padding), kernel, (rows, columns), stride=stride)
    if stride > 1:
        return _convolve_strided((stride, padding), x, kernel)
    if padding == (0, 0):
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


def _interleave(phases: list[Array], size: Pair) -> Array:
    """One raster of the cells (2i, 2j), (2i, 2j + 1), (2i + 1, 2j), (2i + 1, 2j + 1) from a raster of each."""
    h, w = size
    y = jnp.stack(phases, axis=3).reshape(-1, h, w, 2, 2, phases[0].shape[-1])
    return y.transpose(0, 1, 3, 2, 4, 5).reshape(-1, 2 * h, 2 * w, y.shape[-1])


@partial(jax.custom_vjp, nondiff_argnums=(1,))
def reflect_pad(x: Array, cells: Pair) -> Array:
    """x mirrored at its outermost cells, which are not repeated: so many rows and columns on either side."""
    rows, columns = cells
    b, h, w, c = x.shape
    if rows:
        place = np.arange(b)[:, None] * h + np.pad(np.arange(h), rows, mode="reflect")
        x = jnp.take(x.reshape(b * h, w, c), place.reshape(-1), axis=0, mode="clip").reshape(b, -1, w, c)
    if columns:
        before = [x[:, :, i : i + 1] for i in range(columns, 0, -1)]
        after = [x[:, :, i : i + 1] for i in range(w - 2, w - 2 - columns, -1)]
        x = jnp.concatenate([*before, x, *after], axis=2)
    return x


def _reflect_forward(x: Array, cells: Pair) -> tuple[Array, None]:
    return reflect_pad(x, cells), None


def _reflect_backward(cells: Pair, _: None, gradient: Array) -> tuple[Array]:
    for axis, pad in zip((1, 2), cells, strict=True):
        n = gradient.shape[axis] - 2 * pad
        part = partial(lax.slice_in_dim, gradient, axis=axis)
        low, high = lax.rev(part(0, pad), (axis,)), lax.rev(part(n + pad, n + 2 * pad), (axis,))
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


reflect_pad.defvjp(_reflect_forward, _reflect_backward)


def _convolve(x: Array, kernel: Array, *, around: tuple[Pair, Pair], stride: int = 1) -> Array:
    return lax.conv_general_dilated(x, kernel, (stride, stride), around, dimension_numbers=("NHWC", "HWIO", "NHWC"))


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _convolve_strided(form: tuple[int, Pair], x: Array, kernel: Array) -> Array:
    """`form` is the stride and the padding."""
    stride, padding = form
    return _convolve(x, kernel, around=_both_sides(padding), stride=stride)


def _strided_forward(form: tuple[int, Pair], x: Array, kernel: Array) -> tuple[Array, tuple[Array, Array]]:
    return _convolve_strided(form, x, kernel), (x, kernel)


def _strided_backward(form: tuple[int, Pair], saved: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
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
    linear = partial(_convolve, kernel=kernel, around=_both_sides(padding), stride=stride)
    (back,) = jax.linear_transpose(linear, x)(gradient)
    return back, total.swapaxes(1, 2).reshape(kernel.shape)


_convolve_strided.defvjp(_strided_forward, _strided_backward)


def _patch_product(x: Array, kernel: Array, size: Pair, *, stride: int) -> Array:
    """Convolution of the cells that are there, as one matrix product."""
    kh, kw, _, wide = kernel.shape
    patches = jnp.concatenate(_taps(x, (kh, kw), size, stride=stride), axis=-1)
    return (patches.reshape(-1, patches.shape[-1]) @ kernel.reshape(-1, wide)).reshape(-1, *size, wide)


def _taps(x: Array, kernel: Pair, size: Pair, *, stride: int) -> list[Array]:
    """The cells that each kernel element meets, in the kernel's order."""
    b, _, _, c = x.shape
    down, right = (size[0] - 1) * stride + 1, (size[1] - 1) * stride + 1
    return [
        lax.slice(x, (0, i, j, 0), (b, i + down, j + right, c), (1, stride, stride, 1))
        for i in range(kernel[0])
        for j in range(kernel[1])
    ]


def _zero_pad(x: Array, padding: Pair) -> Array:
    return jnp.pad(x, ((0, 0), *_both_sides(padding), (0, 0)))


def _both_sides(padding: Pair) -> tuple[Pair, Pair]:
    return (padding[0], padding[0]), (padding[1], padding[1])
