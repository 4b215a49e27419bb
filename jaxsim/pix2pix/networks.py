"""pix2pixHD: generator with local enhancers, multi-scale patch discriminator.

Wang et al., "High-Resolution Image Synthesis and Semantic Manipulation with Conditional GANs", CVPR 2018;
layer plan of NVlabs/imaginaire `generators/pix2pixHD.py`, `discriminators/multires_patch.py`. The original form,
NVIDIA/pix2pixHD `models/networks.py`, has the same plan and other layers (`layers.FORMS`).
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.config import DiscriminatorConfig, GeneratorConfig
from jaxsim.frame import Array
from jaxsim.pix2pix.convolution import average_pool, halve
from jaxsim.pix2pix.layers import FORMS, ConvBlock, LayerForm, ResidualBlock
from jaxsim.pix2pix.unet import Ensemble, UNet

Precision = Literal["float32", "bfloat16"]


def layer_form(name: str, precision: Precision) -> LayerForm:
    """The layers of a published form, at a precision of their convolutions."""
    return FORMS[name]._replace(compute=None if precision == "float32" else jnp.dtype(precision))


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
        form: LayerForm,
        rngs: nnx.Rngs,
    ):
        block = partial(ConvBlock, form=form, rngs=rngs)
        steps = list(pairwise(widths))
        # c7s1 - d - ... - R - ... - u - c7s1 of the paper's appendix.
        self.stem = block(in_channels, widths[0], size=7)
        self.down = nnx.List([block(narrow, wide, stride=2, padding=form.strided) for narrow, wide in steps])
        self.blocks = nnx.List([ResidualBlock(widths[-1], form=form, rngs=rngs) for _ in range(blocks)])
        self.up = nnx.List([block(wide, narrow, upsample=form.upsample) for narrow, wide in reversed(steps)])
        # The head has no spectral norm in either program.
        plain = form._replace(spectral=False)
        head = partial(ConvBlock, size=7, norm=False, activation=jnp.tanh, form=plain, rngs=rngs)
        self.head = None if out_channels is None else head(widths[0], out_channels)

    def __call__(
        self, x: Float[Array, "b h w c"], coarse: Float[Array, "b h/2 w/2 k"] | None = None, *, train: bool
    ) -> Float[Array, "b h w n"]:
        x = self.stem(x, train=train)
        for block in self.down:
            x = block(x, train=train)
        # The enhancer's own features at half size and the coarser part's last ones, added (Wang et al. 2018, 3.1).
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

    def __init__(
        self,
        config: GeneratorConfig,
        in_channels: int,
        rngs: nnx.Rngs,
        *,
        spectral: bool = True,
        precision: Precision = "float32",
    ) -> None:
        if config.filters % 2**config.enhancers:
            raise ValueError(
                f"generator.filters is {config.filters}: {config.enhancers} enhancers halve it that often; "
                f"take a multiple of {2**config.enhancers}"
            )
        self.multiple = 2 ** (config.downsamples + config.enhancers)
        widths = tuple(min(config.filters * 2**i, config.max_filters) for i in range(config.downsamples + 1))
        form = layer_form(config.form, precision)
        form = form._replace(spectral=form.spectral and spectral)
        part = partial(EncoderDecoder, in_channels, form=form, rngs=rngs)
        self.coarse = part(widths, blocks=config.blocks, out_channels=None if config.enhancers else config.out_channels)
        # An enhancer sees twice the rows and columns of the part before it, and has half its width.
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
        # Finest first, so that the coarse part takes the last.
        pyramid = [inputs]
        for _ in self.enhancers:
            pyramid.append(average_pool(pyramid[-1]))
        x = self.coarse(pyramid.pop(), train=train)
        for enhancer in self.enhancers:
            x = enhancer(pyramid.pop(), x, train=train)
        return x


def make_generator(
    config: GeneratorConfig,
    in_channels: int,
    rngs: nnx.Rngs,
    *,
    spectral: bool = True,
    precision: Precision = "float32",
) -> nnx.Module:
    """The network of a config's form. Raises ValueError where a `unet` is asked for another precision."""
    if config.form != "unet":
        if config.members > 1:
            raise ValueError(
                f"generator: {config.form} is one network; --generator.members is for --generator.form unet"
            )
        return Generator(config, in_channels, rngs, spectral=spectral, precision=precision)
    if precision != "float32":
        raise ValueError(f"generator: unet computes in float32; leave out --optim.precision {precision}")
    return UNet(config, in_channels, rngs) if config.members == 1 else Ensemble(config, in_channels, rngs)


class PatchDiscriminator(nnx.Module):
    """One scale: logits of overlapping patches, and the features before them."""

    def __init__(self, config: DiscriminatorConfig, in_channels: int, rngs: nnx.Rngs, *, precision: Precision) -> None:
        original = config.form == "original"
        block = partial(
            ConvBlock, size=4 if original else 3, padding="zero", form=layer_form(config.form, precision), rngs=rngs
        )
        relu = partial(jax.nn.leaky_relu, negative_slope=0.2)
        widths = [min(config.filters * 2**i, config.max_filters) for i in range(config.layers + 1)]
        channels = [in_channels, *widths]
        self.features = nnx.List(
            [
                block(
                    channels[i],
                    channels[i + 1],
                    stride=2 if i < config.layers else 1,
                    # The original leaves the first layer without a norm.
                    norm=not (original and i == 0),
                    activation=relu,
                )
                for i in range(config.layers + 1)
            ]
        )
        self.logits = block(widths[-1], 1, norm=False, activation=None)

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

    def __init__(
        self, config: DiscriminatorConfig, in_channels: int, rngs: nnx.Rngs, *, precision: Precision = "float32"
    ) -> None:
        self.scales = nnx.List(
            [PatchDiscriminator(config, in_channels, rngs, precision=precision) for _ in range(config.scales)]
        )
        self.shrink = average_pool if config.form == "original" else halve

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
                inputs, image = self.shrink(inputs), self.shrink(image)
            results.append(scale(inputs, image, train=train))
        return results
