"""LIDIA's layers: linear maps along a patch's cells and along its neighbours, and batch norm over patches.

Features are (neighbour, patch, cell), so that both maps are one matrix product each and nothing is transposed. Names
and layouts of parameters are those of the published state dicts: weights are (out, in).
"""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jax import Array
from jaxtyping import Float

Statistics = Literal["stored", "image", "training"]
"""What batch norm divides by: the training set's statistics, stored with the weights; those of the patches at hand;
or these, and the stored ones move towards them."""
EPS, MOMENTUM = 1e-5, 0.1

_product = jax.lax.Precision.HIGHEST  # an accelerator's default would round inputs to fewer digits


class Linear(nnx.Module):
    """y = W x along the first axis (`along_first`) or the last one."""

    def __init__(self, inputs: int, outputs: int, *, bias: bool = False, rngs: nnx.Rngs):
        bound = inputs**-0.5
        draw = lambda shape: jax.random.uniform(rngs.params(), shape, jnp.float32, -bound, bound)  # noqa: E731
        self.weight = nnx.Param(draw((outputs, inputs)))
        if bias:
            self.bias = nnx.Param(draw((outputs,)))

    def along_first(self, x: Float[Array, "i *n"]) -> Float[Array, "o *n"]:
        """The layer on the first axis."""
        return jnp.tensordot(self.weight[...], x, 1, precision=_product)

    def along_last(self, x: Float[Array, "*n i"]) -> Float[Array, "*n o"]:
        """The layer on the last axis."""
        return jnp.einsum("...i,oi->...o", x, self.weight[...], precision=_product)


class VerHor(nnx.Module):
    """The separable layer: a map along cells (`ver`), one along neighbours (`hor`), and a bias for each of both."""

    def __init__(self, ver: tuple[int, int], hor: tuple[int, int], *, rngs: nnx.Rngs):
        self.ver, self.hor = Linear(*ver, rngs=rngs), Linear(*hor, rngs=rngs)
        spread = 2.0 / (ver[1] + hor[1]) ** 0.5  # Xavier, with the gain of a ReLU
        self.b = nnx.Param(spread * jax.random.normal(rngs.params(), (hor[1], ver[1]), jnp.float32))

    def __call__(self, x: Float[Array, "i n u"]) -> Float[Array, "o n v"]:
        outputs, inputs = self.hor.weight.shape
        # The two commute: the one that makes less of it goes first.
        if outputs < inputs:
            x = self.ver.along_last(self.hor.along_first(x))
        else:
            x = self.hor.along_first(self.ver.along_last(x))
        return x + self.b[...][:, None, :]


class BatchNorm(nnx.Module):
    """Each neighbour's features at mean 0 and variance 1 over patches and cells, then scaled and shifted."""

    def __init__(self, channels: int):
        self.weight, self.bias = nnx.Param(jnp.ones(channels)), nnx.Param(jnp.zeros(channels))
        self.running_mean, self.running_var = nnx.BatchStat(jnp.zeros(channels)), nnx.BatchStat(jnp.ones(channels))

    def __call__(self, x: Float[Array, "c n u"], counted: Float[Array, " n"], statistics: Statistics) -> Array:
        """`counted` is 1 for patches that belong to the statistics, 0 for others."""
        if statistics == "stored":
            mean, variance = self.running_mean[...], self.running_var[...]
        else:
            number = jnp.maximum(counted.sum() * x.shape[-1], 1.0)
            weight = counted[None, :, None]
            mean = (x * weight).sum((1, 2)) / number
            variance = ((x - mean[:, None, None]) ** 2 * weight).sum((1, 2)) / number
        if statistics == "training":
            unbiased = variance * number / jnp.maximum(number - 1.0, 1.0)
            for kept, new in ((self.running_mean, mean), (self.running_var, unbiased)):
                kept[...] = (1 - MOMENTUM) * kept[...] + MOMENTUM * jax.lax.stop_gradient(new)
        rate = self.weight[...] * jax.lax.rsqrt(variance + EPS)
        return x * rate[:, None, None] + (self.bias[...] - mean * rate)[:, None, None]


class VerHorBnRe(nnx.Module):
    """Separable layer, batch norm if `norm`, ReLU."""

    def __init__(self, ver: tuple[int, int], hor: tuple[int, int], *, norm: bool, rngs: nnx.Rngs):
        self.ver_hor = VerHor(ver, hor, rngs=rngs)
        self.bn = BatchNorm(hor[1]) if norm else None

    def __call__(self, x: Float[Array, "i n u"], counted: Float[Array, " n"], statistics: Statistics) -> Array:
        x = self.ver_hor(x)
        return jax.nn.relu(x if self.bn is None else self.bn(x, counted, statistics))


class WeightsNet(nnx.Module):
    """From the distances of a patch's neighbours to the factor that each neighbour gets."""

    LAYERS = 6

    def __init__(self, neighbours: int, *, rngs: nnx.Rngs):
        for k in range(self.LAYERS):
            setattr(self, f"fc{k}", Linear(neighbours, neighbours, rngs=rngs))
            setattr(self, f"bn{k}", BatchNorm(neighbours))
        self.fc_out = Linear(neighbours, neighbours, bias=True, rngs=rngs)

    def __call__(
        self, x: Float[Array, "k n"], counted: Float[Array, " n"], statistics: Statistics
    ) -> Float[Array, "k n"]:
        for k in range(self.LAYERS):
            x = getattr(self, f"fc{k}").along_first(x)
            x = jax.nn.relu(getattr(self, f"bn{k}")(x[..., None], counted, statistics)[..., 0])
        return self.fc_out.along_first(x) + self.fc_out.bias[...][:, None]
