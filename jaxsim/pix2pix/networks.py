"""pix2pixHD in Imaginaire's form: generator with local enhancers, multi-scale patch discriminator.

Wang et al., "High-Resolution Image Synthesis and Semantic Manipulation with Conditional GANs", CVPR 2018;
layer plan of NVlabs/imaginaire `generators/pix2pixHD.py`, `discriminators/multires_patch.py`.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.config import DiscriminatorConfig, GeneratorConfig
from jaxsim.pix2pix.convolution import average_pool, halve
from jaxsim.pix2pix.layers import ConvBlock, ResidualBlock

Array = Any


class EncoderDecoder(nnx.Module):
    """7 x 7 stem, halvings, residual blocks, doublings and, if `out_channels`, a 7 x 7 tanh head.

    The global generator is one; a local enhancer is one with a single halving, whose middle receives the
    coarser part's features.
    """

    def __init__(
        self,
        in_channels: int,
        widths: tuple[int, ...],
        *,
        blocks: int,
        out_channels: int | None,
        spectral: bool,
        rngs: nnx.Rngs,
    ):
        block = partial(ConvBlock, spectral=spectral, rngs=rngs)
        steps = list(pairwise(widths))
        self.stem = block(in_channels, widths[0], size=7)
        self.down = nnx.List([block(narrow, wide, stride=2) for narrow, wide in steps])
        self.blocks = nnx.List([ResidualBlock(widths[-1], spectral=spectral, rngs=rngs) for _ in range(blocks)])
        self.up = nnx.List([block(wide, narrow, upsample=True) for narrow, wide in reversed(steps)])
        head = partial(ConvBlock, size=7, spectral=False, norm=False, activation=jnp.tanh, rngs=rngs)
        self.head = None if out_channels is None else head(widths[0], out_channels)

    def __call__(
        self, x: Float[Array, "b h w c"], coarse: Float[Array, "b h/2 w/2 k"] | None = None, *, train: bool
    ) -> Float[Array, "b h w n"]:
        x = self.stem(x, train=train)
        for block in self.down:
            x = block(x, train=train)
        if coarse is not None:
            x = x + coarse
        for block in self.blocks:
            x = block(x, train=train)
        for block in self.up:
            x = block(x, train=train)
        return x if self.head is None else self.head(x, train=train)


class Generator(nnx.Module):
    """Image in [-1, 1] from inputs of any channels; rows and columns must divide by `multiple`.

    `spectral=False` gives the network of the averaged generator, whose kernels have the norm folded in.
    """

    def __init__(self, config: GeneratorConfig, in_channels: int, rngs: nnx.Rngs, *, spectral: bool = True) -> None:
        if config.filters % 2**config.enhancers:
            raise ValueError(
                f"generator.filters is {config.filters}: {config.enhancers} enhancers halve it that often; "
                f"take a multiple of {2**config.enhancers}"
            )
        self.multiple = 2 ** (config.downsamples + config.enhancers)
        widths = tuple(min(config.filters * 2**i, config.max_filters) for i in range(config.downsamples + 1))
        part = partial(EncoderDecoder, in_channels, spectral=spectral, rngs=rngs)
        self.coarse = part(widths, blocks=config.blocks, out_channels=None if config.enhancers else config.out_channels)
        fine = [config.filters // 2 ** (k + 1) for k in range(config.enhancers)]
        self.enhancers = nnx.List(
            [
                part(
                    (width, 2 * width),
                    blocks=config.enhancer_blocks,
                    out_channels=config.out_channels if width == fine[-1] else None,
                )
                for width in fine
            ]
        )

    def __call__(self, inputs: Float[Array, "b h w c"], *, train: bool = False) -> Float[Array, "b h w k"]:
        _, rows, columns, _ = inputs.shape
        # Reflection by one cell needs two of them in the innermost part.
        if rows % self.multiple or columns % self.multiple or min(rows, columns) < 2 * self.multiple:
            raise ValueError(
                f"generator: inputs have {rows} x {columns} cells; both must be multiples of {self.multiple} "
                f"and at least {2 * self.multiple}: change prepare.network_size, or use fewer downsamples "
                "or enhancers"
            )
        pyramid = [inputs]
        for _ in self.enhancers:
            pyramid.append(average_pool(pyramid[-1]))
        x = self.coarse(pyramid.pop(), train=train)
        for enhancer in self.enhancers:
            x = enhancer(pyramid.pop(), x, train=train)
        return x


class PatchDiscriminator(nnx.Module):
    """One scale: logits of overlapping patches, and the features before them."""

    def __init__(self, config: DiscriminatorConfig, in_channels: int, rngs: nnx.Rngs) -> None:
        block = partial(ConvBlock, padding="zero", activation=partial(jax.nn.leaky_relu, negative_slope=0.2), rngs=rngs)
        widths = [min(config.filters * 2**i, config.max_filters) for i in range(config.layers + 1)]
        channels = [in_channels, *widths]
        self.features = nnx.List(
            [
                block(channels[i], channels[i + 1], stride=2 if i < config.layers else 1)
                for i in range(config.layers + 1)
            ]
        )
        self.logits = ConvBlock(widths[-1], 1, padding="zero", norm=False, activation=None, rngs=rngs)

    def __call__(
        self, inputs: Float[Array, "b h w c"], image: Float[Array, "b h w k"], *, train: bool
    ) -> tuple[Float[Array, "b h_out w_out 1"], list[Float[Array, "b _h _w _c"]]]:
        # The parts stay apart: the larger one is the same for every image and wants no gradient.
        features = [self.features[0](inputs, image, train=train)]
        for layer in self.features[1:]:
            features.append(layer(features[-1], train=train))
        return self.logits(features[-1], train=train), features


class Discriminator(nnx.Module):
    """Independent patch discriminators, each seeing the image at half the size of the one before."""

    def __init__(self, config: DiscriminatorConfig, in_channels: int, rngs: nnx.Rngs) -> None:
        self.scales = nnx.List([PatchDiscriminator(config, in_channels, rngs) for _ in range(config.scales)])

    def __call__(
        self, inputs: Float[Array, "b h w c"], image: Float[Array, "b h w k"], *, train: bool = False
    ) -> list[tuple[Float[Array, "b _h _w 1"], list[Float[Array, "b _h _w _c"]]]]:
        """Logits and features of each scale, the finest first."""
        _, rows, columns, _ = image.shape
        multiple = 2 ** (len(self.scales) - 1)
        if rows % multiple or columns % multiple:
            raise ValueError(
                f"discriminator: images have {rows} x {columns} cells; {len(self.scales)} scales need "
                f"multiples of {multiple}: change prepare.network_size, or use fewer scales"
            )
        results = []
        for i, scale in enumerate(self.scales):
            if i:
                inputs, image = halve(inputs), halve(image)
            results.append(scale(inputs, image, train=train))
        return results
