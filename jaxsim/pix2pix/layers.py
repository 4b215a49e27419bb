"""The block that both networks are made of: convolution, instance norm, activation, in this order.

Layers follow Imaginaire's `layers/conv.py`, `layers/residual.py` and `layers/weight_norm.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.pix2pix.convolution import Padding, conv2d, upsample_conv2d
from jaxsim.pix2pix.normalisation import INSTANCE_EPS, SpectralVector, instance_norm, spectral_norm, unit

Array = Any
Activation = Callable[[Array], Array]

INIT_GAIN = 0.02


class Conv(nnx.Module):
    """Convolution whose kernel is divided by its largest singular value if `spectral`.

    `upsample` doubles rows and columns first (nearest neighbour, 3 x 3 kernel, reflect padding).
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        *,
        size: int,
        stride: int,
        padding: Padding,
        spectral: bool,
        upsample: bool,
        rngs: nnx.Rngs,
    ):
        self.stride, self.spectral, self.upsample = stride, spectral, upsample
        self.padding: Padding = padding
        shape = (size, size, in_channels, out_channels)
        # Xavier's normal form with gain 0.02, as published; spectral norm makes the scale immaterial.
        deviation = INIT_GAIN * (2 / ((in_channels + out_channels) * size * size)) ** 0.5
        self.kernel = nnx.Param(deviation * jax.random.normal(rngs.params(), shape))
        self.bias = nnx.Param(jnp.zeros(out_channels))
        if spectral:
            self.left = SpectralVector(unit(jax.random.normal(rngs.params(), (out_channels,))))
            self.right = SpectralVector(unit(jax.random.normal(rngs.params(), (size * size * in_channels,))))

    def __call__(
        self, *parts: Float[Array, "b h w _"], train: bool
    ) -> tuple[Float[Array, "b h_out w_out c_out"], Float[Array, ""] | float]:
        """y and s: the layer's value is y / s + bias. The channels of the parts follow one another.

        Dividing what comes out spares a copy of the kernel, which is the larger of the two deep down; and
        the y of parts and kernel that did not change is the same in the next pass, though s is not.
        """
        kernel = self.kernel[...]
        y, start = 0.0, 0
        for part in parts:
            of_part = kernel[:, :, start : start + part.shape[-1]]
            start += part.shape[-1]
            if self.upsample:
                y += upsample_conv2d(part, of_part)
            else:
                y += conv2d(part, of_part, stride=self.stride, padding=self.padding)
        if not self.spectral:
            return y, 1.0
        left, right = self.left[...], self.right[...]
        sigma, left, right = spectral_norm(kernel, left, right, iterations=int(train))
        if train:
            self.left[...], self.right[...] = left, right
        return y, sigma


class InstanceNorm(nnx.Module):
    """Each channel of each item to mean 0 and variance 1, then a learned scale and shift."""

    def __init__(self, channels: int):
        self.scale = nnx.Param(jnp.ones(channels))
        self.shift = nnx.Param(jnp.zeros(channels))

    def __call__(self, x: Float[Array, "b h w c"], divisor: Float[Array, ""] | float) -> Float[Array, "b h w c"]:
        """The norm of x / divisor, which only the smallest variances and the sign tell from that of x."""
        divisor = jnp.asarray(divisor, x.dtype)
        eps = INSTANCE_EPS * divisor * divisor
        return instance_norm(x, self.scale[...] * jnp.sign(divisor), self.shift[...], eps)


class ConvBlock(nnx.Module):
    """Convolution, instance norm (if `norm`), activation (None: none).

    With a norm the convolution's bias is there, as published, but has no effect: the norm takes the mean away.
    So it is not added, and its gradient is 0 rather than rounding noise, which Adam would blow up.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        *,
        size: int = 3,
        stride: int = 1,
        padding: Padding = "reflect",
        spectral: bool = True,
        upsample: bool = False,
        norm: bool = True,
        activation: Activation | None = jax.nn.relu,
        rngs: nnx.Rngs,
    ):
        self.conv = Conv(
            in_channels,
            out_channels,
            size=size,
            stride=stride,
            padding=padding,
            spectral=spectral,
            upsample=upsample,
            rngs=rngs,
        )
        self.norm = InstanceNorm(out_channels) if norm else None
        self.activation = activation

    def __call__(self, *parts: Float[Array, "b h w _"], train: bool) -> Float[Array, "b h_out w_out c_out"]:
        x, divisor = self.conv(*parts, train=train)
        x = x / divisor + self.conv.bias[...][None, None, None] if self.norm is None else self.norm(x, divisor)
        return x if self.activation is None else self.activation(x)


class ResidualBlock(nnx.Module):
    """x + block(block(x)); no activation after the sum."""

    def __init__(self, channels: int, *, spectral: bool, rngs: nnx.Rngs):
        self.first = ConvBlock(channels, channels, spectral=spectral, rngs=rngs)
        self.second = ConvBlock(channels, channels, spectral=spectral, activation=None, rngs=rngs)

    def __call__(self, x: Float[Array, "b h w c"], *, train: bool) -> Float[Array, "b h w c"]:
        return x + self.second(self.first(x, train=train), train=train)
