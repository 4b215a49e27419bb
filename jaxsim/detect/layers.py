"""Layers with PyTorch's arithmetic and first values: batch norm over masked rows, convolutions, linear maps.

Shapes are channels last. Batch norm counts the valid rows of the whole batch, so that padding changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Bool, Float

from jaxsim.detect.sparse import CUBE, Tables, Triple, sparse_conv
from jaxsim.frame import Array


class Statistic(nnx.Variable):
    """Running mean or variance of a batch norm: training moves it, no gradient does."""


def uniform(rngs: nnx.Rngs, shape: Sequence[int], fan_in: int) -> Float[Array, "..."]:
    """PyTorch's first values of convolutions, linear maps and their biases: uniform up to 1 / sqrt(fan in)."""
    bound = fan_in**-0.5
    return jax.random.uniform(rngs.params(), tuple(shape), minval=-bound, maxval=bound)


class BatchNorm(nnx.Module):
    """Each channel to mean 0 and variance 1 over all valid rows, then a learned scale and shift."""

    def __init__(self, channels: int, *, eps: float = 1e-5, momentum: float = 0.1):
        self.eps, self.momentum = eps, momentum
        self.scale, self.shift = nnx.Param(jnp.ones(channels)), nnx.Param(jnp.zeros(channels))
        self.mean, self.variance = Statistic(jnp.zeros(channels)), Statistic(jnp.ones(channels))

    def __call__(
        self, x: Float[Array, "*b c"], valid: Bool[Array, "*b"] | None = None, *, train: bool
    ) -> Float[Array, "*b c"]:
        mean, variance = self.mean[...], self.variance[...]
        if train:
            rows, weight = x.reshape(-1, x.shape[-1]), jnp.ones(x.size // x.shape[-1], x.dtype)
            if valid is not None:
                weight = valid.reshape(-1).astype(x.dtype)
            weight, count = weight[:, None], weight.sum()
            own_mean = (rows * weight).sum(axis=0) / jnp.maximum(count, 1)
            off = (rows - own_mean[None]) * weight
            own_variance = (off * off).sum(axis=0) / jnp.maximum(count, 1)
            # As PyTorch: normalised by the biased variance, remembered the unbiased one.
            unbiased = own_variance * (count / jnp.maximum(count - 1, 1))
            # A batch without a row says nothing.
            step = jnp.where(count > 0, self.momentum, 0.0)
            self.mean[...] = jax.lax.stop_gradient((1 - step) * mean + step * own_mean)
            self.variance[...] = jax.lax.stop_gradient((1 - step) * variance + step * unbiased)
            mean, variance = own_mean, own_variance
        # One multiplication and one addition a value: the scale and shift of this batch.
        gain = self.scale[...] * jax.lax.rsqrt(variance + self.eps)
        lift = (1,) * (x.ndim - 1)
        return x * gain.reshape(*lift, -1) + (self.shift[...] - mean * gain).reshape(*lift, -1)


class SparseBlock(nnx.Module):
    """Sparse convolution without bias, batch norm (eps 1e-3, momentum 0.01), ReLU."""

    def __init__(self, in_channels: int, out_channels: int, *, size: Triple = CUBE, rngs: nnx.Rngs):
        shape = (*size, in_channels, out_channels)
        self.kernel = nnx.Param(uniform(rngs, shape, int(np.prod(shape[:-1]))))
        self.norm = BatchNorm(out_channels, eps=1e-3, momentum=0.01)

    def __call__(
        self, features: Float[Array, "b n c"], tables: Tables, valid: Bool[Array, "b m"], *, train: bool
    ) -> Float[Array, "b m d"]:
        """Unused places of the output are 0."""
        out = jax.vmap(sparse_conv, (0, None, 0))(features, self.kernel[...], tables)
        out = jax.nn.relu(self.norm(out, valid, train=train))
        return out * valid[..., None].astype(out.dtype)


class ConvBlock(nnx.Module):
    """3 x 3 convolution without bias, padded by 1, batch norm (eps 1e-3, momentum 0.01), ReLU."""

    def __init__(self, in_channels: int, out_channels: int, *, stride: int = 1, rngs: nnx.Rngs):
        self.stride = stride
        self.kernel = nnx.Param(uniform(rngs, (3, 3, in_channels, out_channels), 9 * in_channels))
        self.norm = BatchNorm(out_channels, eps=1e-3, momentum=0.01)

    def __call__(self, x: Float[Array, "b h w c"], *, train: bool) -> Float[Array, "b h_out w_out d"]:
        x = jax.lax.conv_general_dilated(
            x,
            self.kernel[...],
            (self.stride, self.stride),
            ((1, 1), (1, 1)),  # not SAME, which pads strided convolutions on one side
            dimension_numbers=("NHWC", "HWIO", "NHWC"),
        )
        return jax.nn.relu(self.norm(x, train=train))


class UpBlock(nnx.Module):
    """Transposed convolution whose kernel is as wide as its stride, batch norm (1e-3, 0.01), ReLU."""

    def __init__(self, in_channels: int, out_channels: int, *, stride: int, rngs: nnx.Rngs):
        self.stride = stride
        shape = (stride, stride, in_channels, out_channels)
        self.kernel = nnx.Param(uniform(rngs, shape, stride * stride * out_channels))  # PyTorch counts this side
        self.norm = BatchNorm(out_channels, eps=1e-3, momentum=0.01)

    def __call__(self, x: Float[Array, "b h w c"], *, train: bool) -> Float[Array, "b h_out w_out d"]:
        b, h, w, _ = x.shape
        # Kernels do not overlap: every cell becomes its own s x s cells.
        y = jnp.einsum("bhwc,ijcd->bhiwjd", x, self.kernel[...])
        y = y.reshape(b, h * self.stride, w * self.stride, -1)
        return jax.nn.relu(self.norm(y, train=train))


class Linear(nnx.Module):
    """Linear map of the channels, which is also a 1 x 1 convolution."""

    def __init__(self, in_channels: int, out_channels: int, *, bias: bool = True, rngs: nnx.Rngs):
        self.kernel = nnx.Param(uniform(rngs, (in_channels, out_channels), in_channels))
        self.has_bias = bias
        if bias:
            self.bias = nnx.Param(uniform(rngs, (out_channels,), in_channels))

    def __call__(self, x: Float[Array, "*b c"]) -> Float[Array, "*b d"]:
        y = x @ self.kernel[...]
        return y + self.bias[...].reshape((1,) * (y.ndim - 1) + (-1,)) if self.has_bias else y


class FullyConnected(nnx.Module):
    """Linear maps without bias, each with batch norm and ReLU; dropout between them."""

    def __init__(self, in_channels: int, widths: tuple[int, ...], dropout: float, *, rngs: nnx.Rngs):
        self.dropout = dropout
        layers, norms = [], []
        for width in widths:
            layer = Linear(in_channels, width, bias=False, rngs=rngs)
            deviation = (2 / (in_channels + width)) ** 0.5  # Xavier's normal values, as published
            layer.kernel[...] = deviation * jax.random.normal(rngs.params(), (in_channels, width))
            layers.append(layer)
            norms.append(BatchNorm(width))
            in_channels = width
        self.layers, self.norms = nnx.List(layers), nnx.List(norms)

    def __call__(self, x: Float[Array, "*b c"], *, key: Array | None) -> Float[Array, "*b d"]:
        """With a key as in training: batch statistics and dropout."""
        for k, (layer, norm) in enumerate(zip(self.layers, self.norms, strict=True)):
            x = jax.nn.relu(norm(layer(x), train=key is not None))
            if key is not None and self.dropout and k + 1 < len(self.layers):
                kept = jax.random.bernoulli(jax.random.fold_in(key, k), 1 - self.dropout, x.shape)
                x = jnp.where(kept, x / (1 - self.dropout), 0)
        return x
