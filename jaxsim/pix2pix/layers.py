"""The block that both networks are made of: convolution, instance norm, activation, in this order; and normalisation.

Layers follow Imaginaire's `layers/conv.py`, `layers/residual.py` and `layers/weight_norm.py`, or, in the original
form, NVIDIA/pix2pixHD's `models/networks.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float, PyTree

from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import Padding, conv2d, on_cpu, transposed_conv2d, upsample_conv2d

UNIT_EPS = 1e-12
INSTANCE_EPS = 1e-5
Activation = Callable[[Array], Array]
Upsample = Literal["nearest", "transposed"]


class SpectralVector(nnx.Variable):
    """Estimate of a kernel's first singular vector: state that a forward pass advances, not trained."""


def statistics_type(x: Array) -> Any:
    """Type in which sums over features of x are taken: float32 at least."""
    return x.dtype if x.dtype.itemsize >= 4 else jnp.dtype("float32")


def unit_length(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """x at length 1."""
    return x / jnp.maximum(jnp.sqrt(jnp.sum(x * x)), UNIT_EPS)


def spectral_norm(
    kernel: Float[Array, "kh kw c_in c_out"],
    left: Float[Array, " c_out"],
    right: Float[Array, " kh*kw*c_in"],
    *,
    advance: bool = False,
) -> tuple[Float[Array, ""], Float[Array, " c_out"], Float[Array, " kh*kw*c_in"]]:
    """Largest singular value of the kernel as a (kh kw c_in, c_out) matrix W, and its singular vectors.

    `advance` takes them a power iteration further: right = unit(W left), left = unit(Wᵀ right). The value is
    leftᵀ Wᵀ right; its gradient flows through W alone (Miyato et al. 2018; `torch.nn.utils.spectral_norm`).
    """
    matrix = kernel.reshape(-1, kernel.shape[-1])
    if advance:
        right = unit_length(jax.lax.stop_gradient(matrix) @ left)
    image = right @ matrix  # the last Wᵀ right serves the iteration and the value
    if advance:
        left = unit_length(jax.lax.stop_gradient(image))
    return left @ image, left, right


def fold_spectral_norm(parameters: PyTree, vectors: PyTree) -> PyTree:
    """Parameters of the same network without spectral norm: every kernel divided by its value."""
    if "left" in vectors:
        sigma, _, _ = spectral_norm(parameters["kernel"], vectors["left"], vectors["right"])
        return {**parameters, "kernel": parameters["kernel"] / sigma}
    return {
        name: fold_spectral_norm(part, vectors[name]) if name in vectors else part for name, part in parameters.items()
    }


# Four in a row, since custom_vjp takes its arguments by place.
@jax.custom_vjp
def instance_norm(
    x: Float[Array, "b h w c"], scale: Float[Array, " c"], shift: Float[Array, " c"], eps: Float[Array, ""]
) -> Float[Array, "b h w c"]:
    """(x - mean) / sqrt(variance + eps) over rows and columns (biased variance), times scale, plus shift.

    Computed in the type of scale and shift, given back in that of x.
    """
    return _instance_norm(x, scale, shift, eps)[0]


def _instance_norm(x: Array, scale: Array, shift: Array, eps: Array) -> tuple[Array, tuple[Array, ...]]:
    cells, wide = x.shape[1] * x.shape[2], x.astype(scale.dtype)
    mean = _sum_cells(wide) / cells
    # In two passes: the mean of squares less the square of the mean would cancel.
    centred = wide - mean
    rate = jax.lax.rsqrt(_sum_cells(centred * centred) / cells + eps)
    gain = rate * scale[None, None, None]
    return (centred * gain + shift[None, None, None]).astype(x.dtype), (x, mean, rate, scale)


def _instance_norm_gradient(saved: tuple[Array, ...], gradient: Array) -> tuple[Array, ...]:
    """By hand: two sums over cells, where automatic differentiation takes five."""
    x, mean, rate, scale = saved
    cells, gradient = x.shape[1] * x.shape[2], gradient.astype(scale.dtype)
    normalised = (x.astype(scale.dtype) - mean) * rate
    # dL/dx = scale rate (g - mean(g) - n mean(g n)), with n the normalised x and means over cells.
    total = _sum_cells(gradient)
    along = _sum_cells(gradient * normalised)
    scale = scale[None, None, None]
    back = (scale * rate * (gradient - (total + normalised * along) / cells)).astype(x.dtype)
    back_eps = -0.5 * (rate * rate * scale * along).sum()
    return back, along.sum((0, 1, 2)), total.sum((0, 1, 2)), back_eps


instance_norm.defvjp(_instance_norm, _instance_norm_gradient)


def _sum_cells(x: Array) -> Array:
    """Sum over rows and columns, kept as axes of one."""
    b, h, w, c = x.shape
    if not on_cpu():
        return x.sum((1, 2), keepdims=True)
    # As products with ones: inside a step XLA's own reduction of leading axes is 5 to 10 times slower on a CPU. Row by
    # row: one product over all cells adds them up one after another, and loses two digits of the sum.
    ones = jnp.ones((b * h, 1, w), x.dtype)
    rows = jax.lax.dot_general(ones, x.reshape(b * h, w, c), (((2,), (1,)), ((0,), (0,))))
    return rows.reshape(b, h, 1, c).sum(1, keepdims=True)


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
            self.left = SpectralVector(unit_length(jax.random.normal(rngs.params(), (out_channels,))))
            self.right = SpectralVector(unit_length(jax.random.normal(rngs.params(), (size * size * in_channels,))))

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
