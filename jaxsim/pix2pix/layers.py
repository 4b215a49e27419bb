"""The block that both networks are made of: convolution, instance norm, activation, in this order.

Layers follow Imaginaire's `layers/conv.py`, `layers/residual.py` and `layers/weight_norm.py`, or, in the original
form, NVIDIA/pix2pixHD's `models/networks.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import Padding, conv2d, transposed_conv2d, upsample_conv2d
from jaxsim.pix2pix.normalisation import (
    INSTANCE_EPS,
    SpectralVector,
    instance_norm,
    spectral_norm,
    statistics_type,
    unit,
)

Activation = Callable[[Array], Array]
Upsample = Literal["nearest", "transposed"]


class LayerForm(NamedTuple):
    """What the published programs do differently in every layer."""

    spectral: bool
    """Kernels are divided by their largest singular value."""
    affine: bool
    """Instance norm has a learned scale and shift."""
    strided: Padding
    """Around the generator's convolutions at stride 2."""
    upsample: Upsample
    """Twice the rows and columns: repeated cells and a convolution, or a transposed convolution."""
    init: Literal["xavier", "normal"]
    """Kernels of deviation 0.02 sqrt(2 / (fan in + fan out)) and biases 0; or of deviation 0.02, and biases uniform
    up to 1 / sqrt(fan in), as PyTorch makes them."""
    compute: Any = None
    """Type in which convolutions run, e.g. bfloat16; None: that of what comes in. Parameters, statistics and what no
    norm follows stay in the parameters' type."""


FORMS = {
    "imaginaire": LayerForm(spectral=True, affine=True, strided="reflect", upsample="nearest", init="xavier"),
    "original": LayerForm(spectral=False, affine=False, strided="zero", upsample="transposed", init="normal"),
}
"""NVlabs/imaginaire, and NVIDIA/pix2pixHD."""

INIT_GAIN = 0.02


class Conv(nnx.Module):
    """Convolution whose kernel is divided by its largest singular value if `form.spectral`.

    `upsample` doubles rows and columns (3 x 3 kernel).
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        *,
        size: int,
        stride: int,
        padding: Padding,
        upsample: Upsample | None,
        form: LayerForm,
        rngs: nnx.Rngs,
    ):
        self.stride = stride
        self.spectral, self.compute = form.spectral, form.compute
        self.padding: Padding = padding
        self.upsample: Upsample | None = upsample
        shape, area = (size, size, in_channels, out_channels), size * size
        xavier = form.init == "xavier"  # there spectral norm makes the scale immaterial
        deviation = INIT_GAIN * ((2 / ((in_channels + out_channels) * area)) ** 0.5 if xavier else 1.0)
        self.kernel = nnx.Param(deviation * jax.random.normal(rngs.params(), shape))
        self.bias = nnx.Param(jnp.zeros(out_channels))
        if not xavier:
            # PyTorch counts the fan of a transposed convolution on its other side.
            fan = area * (out_channels if upsample == "transposed" else in_channels)
            largest = fan**-0.5
            self.bias[...] = jax.random.uniform(rngs.params(), (out_channels,), minval=-largest, maxval=largest)
        if form.spectral:
            # Power iteration goes on from pass to pass; where it begins matters for the first few alone.
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
        # The convolution of parts side by side is the sum of their convolutions, each with its channels of the kernel.
        for part in parts:
            of_part = kernel[:, :, start : start + part.shape[-1]]
            start += part.shape[-1]
            if self.compute is not None:
                part, of_part = part.astype(self.compute), of_part.astype(self.compute)
            if self.upsample == "nearest":
                y += upsample_conv2d(part, of_part)
            elif self.upsample == "transposed":
                y += transposed_conv2d(part, of_part)
            else:
                y += conv2d(part, of_part, stride=self.stride, padding=self.padding)
        if not self.spectral:
            return y, 1.0
        left, right = self.left[...], self.right[...]
        sigma, left, right = spectral_norm(kernel, left, right, advance=train)
        if train:
            self.left[...], self.right[...] = left, right
        return y, sigma


class InstanceNorm(nnx.Module):
    """Each channel of each item to mean 0 and variance 1, then, if `affine`, a learned scale and shift."""

    def __init__(self, channels: int, *, affine: bool):
        self.affine = affine
        if affine:
            self.scale = nnx.Param(jnp.ones(channels))
            self.shift = nnx.Param(jnp.zeros(channels))

    def __call__(self, x: Float[Array, "b h w c"], divisor: Float[Array, ""] | float) -> Float[Array, "b h w c"]:
        """The norm of x / divisor, which only the smallest variances and the sign tell from that of x."""
        wide = statistics_type(x)
        if self.affine:
            scale, shift = self.scale[...], self.shift[...]
        else:
            scale, shift = jnp.ones(x.shape[-1], wide), jnp.zeros(x.shape[-1], wide)
        # (x/d - mean(x/d)) / sqrt(var(x/d) + eps) = sign(d) (x - mean(x)) / sqrt(var(x) + eps d^2)
        divisor = jnp.asarray(divisor, wide)
        return instance_norm(x, scale * jnp.sign(divisor), shift, INSTANCE_EPS * divisor * divisor)


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
        upsample: Upsample | None = None,
        norm: bool = True,
        activation: Activation | None = jax.nn.relu,
        form: LayerForm,
        rngs: nnx.Rngs,
    ):
        self.conv = Conv(
            in_channels,
            out_channels,
            size=size,
            stride=stride,
            padding=padding,
            upsample=upsample,
            form=form,
            rngs=rngs,
        )
        self.norm = InstanceNorm(out_channels, affine=form.affine) if norm else None
        self.activation = activation

    def __call__(self, *parts: Float[Array, "b h w _"], train: bool) -> Float[Array, "b h_out w_out c_out"]:
        x, divisor = self.conv(*parts, train=train)
        if self.norm is None:
            bias = self.conv.bias[...]
            x = x.astype(bias.dtype) / divisor + bias[None, None, None]
        else:
            x = self.norm(x, divisor)
        return x if self.activation is None else self.activation(x)


class ResidualBlock(nnx.Module):
    """x + block(block(x)); no activation after the sum."""

    def __init__(self, channels: int, *, form: LayerForm, rngs: nnx.Rngs):
        self.first = ConvBlock(channels, channels, form=form, rngs=rngs)
        self.second = ConvBlock(channels, channels, activation=None, form=form, rngs=rngs)

    def __call__(self, x: Float[Array, "b h w c"], *, train: bool) -> Float[Array, "b h w c"]:
        return x + self.second(self.first(x, train=train), train=train)
