"""A response of each cell in its surroundings: a U-Net on the polar grid, small enough to learn from some drives.

What a return's intensity is made of is known: the laser's own gain, range, angle, and what the surface is like. The
first three are the cell's own; the last has to be told from the image around it. So every cell has a part of its own at
full size, and beside it features of its surroundings, which a U-Net (Ronneberger et al. 2015) gathers. At full size,
where a convolution costs most, it has none: what lies next to a cell comes in numbers (`prepare.surroundings`). No
layer has a norm over the image: it would tell each cell what else is in the frame, and that is the street, not the
sensor.
"""

from __future__ import annotations

from itertools import pairwise

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float, PyTree

from jaxsim.config import GeneratorConfig
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import conv2d, doubled

OWN = 4
"""Channels of a cell's own part, in those of the first level."""


class Plain(nnx.Module):
    """Convolution and bias; kernels by He et al. 2015, times `gain`."""

    def __init__(self, in_channels: int, out_channels: int, *, size: int, rngs: nnx.Rngs, gain: float = 1.0):
        shape = (size, size, in_channels, out_channels)
        deviation = gain * (2 / (in_channels * size * size)) ** 0.5
        self.kernel = nnx.Param(deviation * jax.random.normal(rngs.params(), shape))
        self.bias = nnx.Param(jnp.zeros(out_channels))

    def __call__(self, x: Float[Array, "b h w c_in"]) -> Float[Array, "b h w c_out"]:
        kernel, bias = self.kernel[...], self.bias[...]
        if kernel.shape[0] == 1:  # a product of matrices, which is faster than a convolution that is one
            return x @ kernel[0, 0] + bias[None, None, None]
        return conv2d(x, kernel, padding="zero") + bias[None, None, None]


class Residual(nnx.Module):
    """x + conv(relu(conv(relu(x)))); at the start nearly x itself."""

    def __init__(self, channels: int, *, rngs: nnx.Rngs):
        self.first = Plain(channels, channels, size=3, rngs=rngs)
        self.second = Plain(channels, channels, size=3, rngs=rngs, gain=0.1)

    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b h w c"]:
        return x + self.second(jax.nn.relu(self.first(jax.nn.relu(x))))


class UNet(nnx.Module):
    """Outputs of each cell from inputs of any channels; any number of rows and columns.

    `downsamples` halvings, each of twice the channels up to `max_filters`, and below full size `blocks` residual blocks
    a level on either side. Channels that come out are not bounded: `losses` and `predict` say what they mean.
    """

    def __init__(
        self, config: GeneratorConfig, in_channels: int, rngs: nnx.Rngs, *, out_channels: int | None = None
    ) -> None:
        """`out_channels` are the config's own by default."""
        widths = [min(config.filters * 2**k, config.max_filters) for k in range(config.downsamples + 1)]
        alone = OWN * widths[0]
        self.multiple = 2**config.downsamples
        self.stem = Plain(in_channels, widths[0], size=1, rngs=rngs)
        self.own = Plain(in_channels, alone, size=1, rngs=rngs)
        self.response = Plain(alone, alone, size=1, rngs=rngs)
        make = lambda width: nnx.List([Residual(width, rngs=rngs) for _ in range(config.blocks)])  # noqa: E731
        self.down = nnx.List([make(width) for width in widths[1:]])
        pairs = list(pairwise(widths))
        self.widen = nnx.List([Plain(narrow, wide, size=1, rngs=rngs) for narrow, wide in pairs])
        self.narrow = nnx.List([Plain(wide, narrow, size=1, rngs=rngs, gain=0.5) for narrow, wide in pairs])
        # None at full size, and the innermost level has its blocks on the way down.
        self.up = nnx.List([make(width) for width in widths[1:-1]])
        self.join = Plain(alone + widths[0], alone, size=1, rngs=rngs)
        # Small at the start: all cells in the middle of the scale, drops at even odds.
        self.head = Plain(alone, out_channels or config.channels, size=1, rngs=rngs, gain=0.1)

    def __call__(self, inputs: Float[Array, "b h w c"], *, train: bool = False) -> Float[Array, "b h w k"]:
        _, h, w, _ = inputs.shape
        rows, columns = -h % self.multiple, -w % self.multiple
        # Filled up so that every halving is whole; what is added is cut off before the join.
        x = self.stem(jnp.pad(inputs, ((0, 0), (0, rows), (0, columns), (0, 0))))
        skips = []
        for widen, blocks in zip(self.widen, self.down, strict=True):
            skips.append(x)
            x = widen(_halved(x))
            for block in blocks:
                x = block(x)
        for k in reversed(range(len(skips))):
            x = skips[k] + doubled(self.narrow[k](x))
            for block in self.up[k - 1] if k else ():
                x = block(x)
        own = jax.nn.relu(self.response(jax.nn.relu(self.own(inputs))))
        beside = jnp.concatenate([own, jax.nn.relu(x[:, :h, :w])], axis=-1)
        return self.head(jax.nn.relu(self.join(beside)))


class Ensemble(nnx.Module):
    """The mean of `members` U-Nets that learn apart: in training each sees its own share of the batch, so that a step
    is one of each. Where they differ is what the drives did not tell, and the mean errs less than any of them
    (Lakshminarayanan et al. 2017)."""

    def __init__(self, config: GeneratorConfig, in_channels: int, rngs: nnx.Rngs) -> None:
        self.members = nnx.List([UNet(config, in_channels, rngs) for _ in range(config.members)])

    def __call__(self, inputs: Float[Array, "b h w c"], *, train: bool = False) -> Float[Array, "b h w k"]:
        """Raises ValueError where in training the batch has no equal shares."""
        if not train:
            return sum(member(inputs) for member in self.members) / len(self.members)
        if len(inputs) % len(self.members):
            raise ValueError(
                f"generator: {len(inputs)} items a device cannot be shared by {len(self.members)} networks "
                "(--generator.members); give --optim.batch a multiple of that"
            )
        shares = jnp.split(inputs, len(self.members))
        return jnp.concatenate([member(share, train=True) for member, share in zip(self.members, shares, strict=True)])


def cells_alone(parameters: PyTree) -> PyTree:
    """The parameters of a U-Net, or of several, with which each cell answers from its own inputs alone: what its
    surroundings add at the join is 0."""
    if "members" in parameters:
        return parameters | {"members": {k: cells_alone(member) for k, member in parameters["members"].items()}}
    kernel = jnp.asarray(parameters["join"]["kernel"])
    # A cell's own channels come first, as many as come out.
    own = kernel.at[:, :, kernel.shape[-1] :].set(0.0)
    return parameters | {"join": parameters["join"] | {"kernel": own}}


def _halved(x: Float[Array, "b h w c"]) -> Float[Array, "b h/2 w/2 c"]:
    b, h, w, c = x.shape
    return x.reshape(b, h // 2, 2, w // 2, 2, c).mean((2, 4))
