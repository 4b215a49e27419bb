"""PENet's layers: convolutions with batch norm, and residual blocks that know where their cells are in space.

Rasters are channels last; kernels are (rows, columns, in, out), also those of transposed convolutions, which run as
convolutions of the spread-out input. `published.create` draws the values that a training begins with.

DA-CSPN++ spreads depth to neighbours by learned affinities, with dilation and three kernel sizes (Cheng et al., CSPN++,
AAAI 2020; dilated and accelerated by Hu et al., ICRA 2021). k kernel width, o a neighbour's slot, row by row, delta(o)
its offset; c the middle slot. The middle tap takes the depth that the stage began with:

    d(p) <- sum over o != c of w_o(p) d(p + dilation delta(o)) + w_c(p) d_0(p)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jax import Array
from jaxtyping import Float

from jaxsim.products import PRECISION

_Raster = Float[Array, "b _h _w _c"]

Mode = bool | Literal["renorm"]
"""Of batch norms: by the stored statistics (False), by the batch's (True), or both (`BatchNorm`)."""

EPS, MOMENTUM = 1e-5, 0.1
SLOW = 0.02
MOST_SCALE = 3.0
MOST_SHIFT = 5.0
"""Of `renorm`: how fast the stored statistics follow, and how far the batch's may lie from them."""
KERNELS = (3, 5, 7)


class Conv(nnx.Module):
    """Convolution without bias, padded by half its kernel with zeros."""

    def __init__(self, inputs: int, outputs: int, size: int, *, stride: int = 1, rngs: nnx.Rngs):
        self.stride = stride
        self.kernel = nnx.Param(jax.random.normal(rngs.params(), (size, size, inputs, outputs), jnp.float32))

    def __call__(self, x: _Raster) -> _Raster:
        return _convolve(x, self.kernel[...], stride=self.stride)


class TransposedConv(Conv):
    """Twice the rows and columns (`stride` 2, kernel 5) or as many (`stride` 1, kernel 3)."""

    def __call__(self, x: _Raster) -> _Raster:
        return _doubled(x, self.kernel[...]) if self.stride == 2 else _convolve(x, self.kernel[...])


def _doubled(x: Array, kernel: Array) -> Array:
    """The spread-out input's convolution with a kernel of 5 taps, without work on the zeros in between: each of an
    input cell's 2 x 2 outputs has a part of the taps. XLA's gradients of spread-out inputs take ten times as long on a
    CPU (`benchmarks/speed/penet.py`)."""

    def split(taps: Array, axis: int) -> Array:
        """Along an axis: even outputs see the cells before, at and after with taps 0, 2, 4; odd ones the cells at and
        after with taps 1, 3."""
        even = jax.lax.slice_in_dim(taps, 0, None, 2, axis)
        odd = jax.lax.slice_in_dim(taps, 1, None, 2, axis)
        before = [(int(dim == axis), 0) for dim in range(taps.ndim)]
        return jnp.stack([even, jnp.pad(odd, before)])

    parts = split(split(kernel, 0), 2)  # right, down, rows, columns, in, out
    inputs, outputs = kernel.shape[2:]
    y = _convolve(x, parts.transpose(2, 3, 4, 1, 0, 5).reshape(3, 3, inputs, 4 * outputs))
    b, h, w, _ = y.shape
    return y.reshape(b, h, w, 2, 2, outputs).transpose(0, 1, 3, 2, 4, 5).reshape(b, 2 * h, 2 * w, outputs)


def _convolve(x: Array, kernel: Array, *, stride: int = 1) -> Array:
    half = kernel.shape[0] // 2
    return jax.lax.conv_general_dilated(
        x,
        kernel,
        window_strides=(stride, stride),
        padding=((half, half), (half, half)),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
        precision=PRECISION,  # an accelerator's default would round inputs to fewer digits
    )


class BatchNorm(nnx.Module):
    """Channels at mean 0 and variance 1, of the batch in training and of the stored statistics else.

    A batch of a few small crops shows one depth or another, and its own statistics take away which. `renorm` gives in
    training what the stored statistics give, with the gradient of the batch's (Ioffe, Batch Renormalization, 2017).
    """

    def __init__(self, channels: int):
        self.weight, self.bias = nnx.Param(jnp.ones(channels)), nnx.Param(jnp.zeros(channels))
        self.running_mean, self.running_var = nnx.BatchStat(jnp.zeros(channels)), nnx.BatchStat(jnp.ones(channels))

    def __call__(self, x: _Raster, *, train: Mode) -> _Raster:
        mean, variance = self.running_mean[...], self.running_var[...]
        scale, shift = jnp.ones_like(mean), jnp.zeros_like(mean)
        if train:
            stored_mean, stored = mean, jnp.sqrt(variance + EPS)
            number = x.size // x.shape[-1]
            mean = x.mean((0, 1, 2))
            variance = ((x - mean[None, None, None]) ** 2).mean((0, 1, 2))
            if train == "renorm":
                # r and d of the paper: they lead the batch's statistics back to the stored ones, without gradient.
                wider = jnp.clip(jnp.sqrt(variance + EPS) / stored, 1 / MOST_SCALE, MOST_SCALE)
                higher = jnp.clip((mean - stored_mean) / stored, -MOST_SHIFT, MOST_SHIFT)
                scale, shift = jax.lax.stop_gradient(wider), jax.lax.stop_gradient(higher)
            share = SLOW if train == "renorm" else MOMENTUM
            for kept, new in ((self.running_mean, mean), (self.running_var, variance * (number / max(number - 1, 1)))):
                kept[...] = (1 - share) * kept[...] + share * jax.lax.stop_gradient(new)
        # One multiplication and one addition a value: the norm is folded before it meets the raster.
        rate = self.weight[...] * scale * jax.lax.rsqrt(variance + EPS)
        return x * rate[None, None, None] + (self.bias[...] + self.weight[...] * shift - mean * rate)[None, None, None]


class ConvBn(nnx.Module):
    """Convolution, batch norm and, with `relu`, ReLU."""

    def __init__(
        self, inputs: int, outputs: int, size: int = 3, *, stride: int = 1, relu: bool = False, rngs: nnx.Rngs
    ):
        self.conv = Conv(inputs, outputs, size, stride=stride, rngs=rngs)
        self.norm, self.relu = BatchNorm(outputs), relu

    def __call__(self, x: _Raster, *, train: Mode) -> _Raster:
        x = self.norm(self.conv(x), train=train)
        return jax.nn.relu(x) if self.relu else x


class Deconv(nnx.Module):
    """Transposed convolution, batch norm, ReLU."""

    def __init__(self, inputs: int, outputs: int, size: int = 5, *, stride: int = 2, rngs: nnx.Rngs):
        self.deconv = TransposedConv(inputs, outputs, size, stride=stride, rngs=rngs)
        self.norm = BatchNorm(outputs)

    def __call__(self, x: _Raster, *, train: Mode) -> _Raster:
        return jax.nn.relu(self.norm(self.deconv(x), train=train))


class GeoBlock(nnx.Module):
    """Residual block whose convolutions also see the cells' coordinates in space (C-CNN, Hu et al. 2021, fig. 3)."""

    GEO = 3

    def __init__(self, inputs: int, outputs: int, *, stride: int, rngs: nnx.Rngs):
        self.conv1 = Conv(inputs + self.GEO, outputs, 3, stride=stride, rngs=rngs)
        self.conv2 = Conv(outputs + self.GEO, outputs, 3, rngs=rngs)
        self.bn1, self.bn2 = BatchNorm(outputs), BatchNorm(outputs)
        changes = stride != 1 or inputs != outputs
        self.downsample = ConvBn(inputs + self.GEO, outputs, 1, stride=stride, rngs=rngs) if changes else None

    def __call__(self, x: _Raster, before: _Raster, after: _Raster, *, train: Mode) -> _Raster:
        """`before` and `after` are the coordinates at the input's and at the output's scale."""
        placed = jnp.concatenate([x, before], -1)
        y = jax.nn.relu(self.bn1(self.conv1(placed), train=train))
        y = self.bn2(self.conv2(jnp.concatenate([after, y], -1)), train=train)
        return jax.nn.relu(y + (x if self.downsample is None else self.downsample(placed, train=train)))


class Guide(nnx.Module):
    """Affinities of a kernel from features: they sum to 1, the neighbours' by magnitude to 1."""

    def __init__(self, channels: int, k: int, *, rngs: nnx.Rngs):
        self.generate = ConvBn(channels, k * k - 1, rngs=rngs)

    def __call__(self, features: Float[Array, "b h w c"], *, train: Mode) -> Float[Array, "b h w kk"]:
        guide = self.generate(features, train=train)
        guide = guide / jnp.abs(guide).sum(-1, keepdims=True)  # keeps repeated steps stable
        first, second = jnp.split(guide, 2, -1)
        return jnp.concatenate([first, 1 - guide.sum(-1, keepdims=True), second], -1)


def _offsets(k: int) -> list[tuple[int, int]]:
    return [(o // k - k // 2, o % k - k // 2) for o in range(k * k)]


def _shifted(x: Float[Array, "b h w"], down: int, right: int) -> Float[Array, "b h w"]:
    """x at (row + down, column + right); 0 outside."""
    pad = [(0, 0), (max(-down, 0), max(down, 0)), (max(-right, 0), max(right, 0))]
    h, w = x.shape[1:]
    top, left = max(down, 0), max(right, 0)
    return jnp.pad(x, pad)[:, top : top + h, left : left + w]


def from_neighbours(guide: Float[Array, "b h w kk"]) -> Float[Array, "b h w kk"]:
    """A cell weighs its neighbour o by what that neighbour holds for it: slot k*k - 1 - o there."""
    k = round(guide.shape[-1] ** 0.5)
    return jnp.stack([_shifted(guide[..., k * k - 1 - o], *offset) for o, offset in enumerate(_offsets(k))], -1)


def step(
    taps: Sequence[Float[Array, "b h w"]], depth: Float[Array, "b h w"], start: Float[Array, "b h w"], *, dilation: int
) -> Float[Array, "b h w"]:
    """One propagation; `taps` are the slots of what `from_neighbours` gives."""
    k = round(len(taps) ** 0.5)
    total = taps[k * k // 2] * start
    for o, (down, right) in enumerate(_offsets(k)):
        if o != k * k // 2:
            total = total + taps[o] * _shifted(depth, dilation * down, dilation * right)
    return total


def propagate(
    guides: list[Float[Array, "b h w _kk"]],
    confidence: Float[Array, "b h w 3"],
    start: Float[Array, "b h w"],
    *,
    sparse: Float[Array, "b h w"],
    trust: Float[Array, "b h w"],
    dilation: int,
) -> Float[Array, "b h w"]:
    """A stage of six steps: every kernel spreads `start` and is led back to the sparse depth by `trust`; then they are
    weighed."""
    # One array a slot: the gradient of a slot of a common array is as large as that array, every time.
    taps = [jnp.unstack(guide, axis=-1) for guide in guides]

    def once(_: Array, depths: tuple[Array, ...]) -> tuple[Array, ...]:
        spread = [step(slots, depth, start, dilation=dilation) for slots, depth in zip(taps, depths, strict=True)]
        # The measured depth is put back after each step, as far as it is trusted.
        return tuple((1 - trust) * depth + trust * sparse for depth in spread)

    depths = jax.lax.fori_loop(0, 6, once, (start,) * len(guides), unroll=False)
    return sum(confidence[..., i] * depth for i, depth in enumerate(depths))  # type: ignore[return-value]
