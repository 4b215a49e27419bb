"""BaseBEVBackbone: convolutions on the map from above, and the anchor head's three outputs."""

from __future__ import annotations

from math import log
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Float

from jaxsim.config import BackboneConfig
from jaxsim.detect.layers import ConvBlock, Linear, UpBlock

Array = Any

FIRST_SCORE = 0.01
"""Score of every anchor before training."""
DIRECTIONS = 2
BOX = 7


class BevBackbone(nnx.Module):
    """Blocks of convolutions, each on the one before; all their outputs, scaled to one size, side by side."""

    def __init__(self, config: BackboneConfig, in_channels: int, *, rngs: nnx.Rngs):
        blocks, ups = [], []
        for layers, stride, width, up_stride, up_width in zip(
            config.bev_layers, config.bev_strides, config.bev_widths, config.up_strides, config.up_widths, strict=True
        ):
            block = [ConvBlock(in_channels, width, stride=stride, rngs=rngs)]
            block += [ConvBlock(width, width, rngs=rngs) for _ in range(layers)]
            blocks.append(nnx.List(block))
            ups.append(UpBlock(width, up_width, stride=up_stride, rngs=rngs))
            in_channels = width
        self.blocks, self.ups = nnx.List(blocks), nnx.List(ups)

    def __call__(self, x: Float[Array, "b h w c"], *, train: bool) -> Float[Array, "b h_out w_out d"]:
        outputs = []
        for block, up in zip(self.blocks, self.ups, strict=True):
            for layer in block:
                x = layer(x, train=train)
            outputs.append(up(x, train=train))
        return jnp.concatenate(outputs, axis=-1)


class AnchorHead(nnx.Module):
    """Score, box and direction of every anchor, by 1 x 1 convolutions (AnchorHeadSingle, one class)."""

    def __init__(self, in_channels: int, anchors: int, *, rngs: nnx.Rngs):
        self.cls = Linear(in_channels, anchors, rngs=rngs)
        self.box = Linear(in_channels, anchors * BOX, rngs=rngs)
        self.direction = Linear(in_channels, anchors * DIRECTIONS, rngs=rngs)
        first = -log((1 - FIRST_SCORE) / FIRST_SCORE)
        self.cls.bias[...] = jnp.full(anchors, first, jnp.float32)  # a weak type would compile the step twice
        self.box.kernel[...] = 0.001 * jax.random.normal(rngs.params(), (in_channels, anchors * BOX))

    def __call__(
        self, x: Float[Array, "b h w c"]
    ) -> tuple[Float[Array, "b a"], Float[Array, "b a 7"], Float[Array, "b a 2"]]:
        """Logits, encoded boxes and direction logits; anchors in the order row (y), column (x), heading."""
        b = len(x)
        return (
            self.cls(x).reshape(b, -1),
            self.box(x).reshape(b, -1, BOX),
            self.direction(x).reshape(b, -1, DIRECTIONS),
        )
