"""Voxels to a map from above by sparse convolutions, that map to features by dense ones, these to anchors' outputs
(OpenPCDet's VoxelBackBone8x, BaseBEVBackbone and AnchorHeadSingle)."""

from __future__ import annotations

from math import log

import jax
import jax.numpy as jnp
from flax import nnx, struct
from jaxtyping import Float, Int

from jaxsim.config import BackboneConfig, VoxelConfig
from jaxsim.detect.layers import ConvBlock, Linear, SparseBlock, UpBlock
from jaxsim.detect.sparse import CUBE, ConvWindow, Sites, strided_sites, strided_tables, submanifold_tables
from jaxsim.frame import Array

DOWN = {
    "conv2": ConvWindow(CUBE, stride=(2, 2, 2), padding=(1, 1, 1)),
    "conv3": ConvWindow(CUBE, stride=(2, 2, 2), padding=(1, 1, 1)),
    # As published, without padding along z: 41 planes become 21, 11, 5 and, by `out`, 2.
    "conv4": ConvWindow(CUBE, stride=(2, 2, 2), padding=(0, 1, 1)),
    "out": ConvWindow((3, 1, 1), stride=(2, 1, 1), padding=(0, 0, 0)),
}
"""The strided convolutions, by stage."""
FIRST_SCORE = 0.01
"""Score of every anchor before training."""
DIRECTIONS = 2
BOX = 7


@struct.dataclass
class SparseScale:
    """A batch's sparse features at one stride."""

    sites: Sites
    """Sites of each sample (b, n)."""
    features: Array
    """(b, n, c)."""
    stride: int = struct.field(pytree_node=False)
    """Voxels along each side of a cell."""


class SparseStage(nnx.Module):
    """A strided convolution and two submanifold ones at its sites."""

    def __init__(self, in_channels: int, out_channels: int, *, rngs: nnx.Rngs):
        self.down = SparseBlock(in_channels, out_channels, rngs=rngs)
        self.first = SparseBlock(out_channels, out_channels, rngs=rngs)
        self.second = SparseBlock(out_channels, out_channels, rngs=rngs)


class VoxelBackBone8x(nnx.Module):
    """Voxels (stride 1) to sparse features at strides 2, 4, 8, and to the map from above at stride 8."""

    def __init__(self, config: BackboneConfig, in_channels: int, *, rngs: nnx.Rngs):
        one, two, four, eight = config.widths
        self.conv_input = SparseBlock(in_channels, one, rngs=rngs)
        self.conv1 = SparseBlock(one, one, rngs=rngs)
        self.conv2 = SparseStage(one, two, rngs=rngs)
        self.conv3 = SparseStage(two, four, rngs=rngs)
        self.conv4 = SparseStage(four, eight, rngs=rngs)
        self.out = SparseBlock(eight, config.out, size=DOWN["out"].kernel, rngs=rngs)

    def __call__(
        self, sites: Sites, features: Float[Array, "b n c"], capacities: dict[str, int], *, train: bool
    ) -> tuple[list[SparseScale], Float[Array, "b h w d"], dict[str, Int[Array, " b"]]]:
        """Features at strides 2, 4, 8; the map from above; and how many sites of each stage did not fit.

        `capacities` are the places of a sample in each stage of DOWN.
        """
        # One table serves every convolution whose outputs are its inputs' sites.
        same = jax.vmap(submanifold_tables)(sites)
        x = self.conv_input(features, same, sites.valid, train=train)
        x = self.conv1(x, same, sites.valid, train=train)
        scales, dropped = [], {}

        def strided(name: str, block: SparseBlock) -> tuple[Sites, Float[Array, "b m d"]]:
            outputs, dropped[name] = jax.vmap(lambda s: strided_sites(s, DOWN[name], capacities[name]))(sites)
            tables = jax.vmap(lambda i, o: strided_tables(i, o, DOWN[name]))(sites, outputs)
            return outputs, block(x, tables, outputs.valid, train=train)

        for name, stage in (("conv2", self.conv2), ("conv3", self.conv3), ("conv4", self.conv4)):
            sites, x = strided(name, stage.down)
            same = jax.vmap(submanifold_tables)(sites)
            x = stage.first(x, same, sites.valid, train=train)
            x = stage.second(x, same, sites.valid, train=train)
            scales.append(SparseScale(sites, x, 2 ** (len(scales) + 1)))
        sites, x = strided("out", self.out)
        return scales, height_compression(sites, x), dropped


def height_compression(sites: Sites, features: Float[Array, "b n c"]) -> Float[Array, "b h w cz"]:
    """The map from above: the features of a column's cells side by side, channel c z_cells + z; 0 where none is."""
    planes, rows, columns = sites.shape
    b, _, c = features.shape
    volume = jnp.zeros((b, planes * rows * columns, c), features.dtype)
    # Unused places have a key past the last cell, which `drop` leaves out.
    volume = jax.vmap(lambda v, key, f: v.at[key].set(f, mode="drop"))(volume, sites.key, features)
    return volume.reshape(b, planes, rows, columns, c).transpose(0, 2, 3, 4, 1).reshape(b, rows, columns, c * planes)


def capacities(config: VoxelConfig, max_voxels: int) -> dict[str, int]:
    """Places of a sample in each stage, for a cap on voxels."""
    return {name: round(growth * max_voxels) for name, growth in zip(DOWN, config.growth, strict=True)}


class BevBackbone(nnx.Module):
    """Blocks of convolutions, each on the one before; all their outputs, scaled to one size, side by side."""

    def __init__(self, config: BackboneConfig, in_channels: int, *, rngs: nnx.Rngs):
        blocks, ups = [], []
        for layers, stride, width, up_stride, up_width in zip(
            config.bev_layers, config.bev_strides, config.bev_widths, config.up_strides, config.up_widths, strict=True
        ):
            block = [ConvBlock(in_channels, width, stride=stride, rngs=rngs)]  # `layers` counts those after it
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
        # The logit of FIRST_SCORE (Lin et al. 2017): else the many background anchors rule the first steps.
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
