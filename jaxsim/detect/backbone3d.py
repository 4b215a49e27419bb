"""VoxelBackBone8x: sparse convolutions from voxels to a map seen from above (OpenPCDet `spconv_backbone.py`)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx, struct
from jaxtyping import Float, Int

from jaxsim.config import BackboneConfig, VoxelConfig
from jaxsim.detect.layers import SparseBlock
from jaxsim.detect.sparse import Sites, Triple, strided_sites, strided_tables, submanifold_tables

Array = Any

CUBE: Triple = (3, 3, 3)
DOWN: dict[str, tuple[Triple, Triple, Triple]] = {
    "conv2": (CUBE, (2, 2, 2), (1, 1, 1)),
    "conv3": (CUBE, (2, 2, 2), (1, 1, 1)),
    "conv4": (CUBE, (2, 2, 2), (0, 1, 1)),
    "out": ((3, 1, 1), (2, 1, 1), (0, 0, 0)),
}
"""Strided convolutions: kernel, stride and padding along z, y, x."""


@struct.dataclass
class Scale:
    """A batch's sparse features at one stride."""

    sites: Sites
    """Of each sample (b, n)."""
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
        self.out = SparseBlock(eight, config.out, size=DOWN["out"][0], rngs=rngs)

    def __call__(
        self, sites: Sites, features: Float[Array, "b n c"], capacities: dict[str, int], *, train: bool
    ) -> tuple[list[Scale], Float[Array, "b h w d"], dict[str, Int[Array, " b"]]]:
        """Features at strides 2, 4, 8; the map from above; and how many sites of each stage did not fit.

        `capacities` are the places of a sample in each stage of DOWN.
        """
        same = jax.vmap(lambda s: submanifold_tables(s, CUBE))(sites)
        x = self.conv_input(features, same, sites.valid, train=train)
        x = self.conv1(x, same, sites.valid, train=train)
        scales = []
        dropped = {}
        stride = 1
        for name, stage in (("conv2", self.conv2), ("conv3", self.conv3), ("conv4", self.conv4)):
            sites, x, dropped[name] = _strided(stage.down, name, sites, x=x, capacities=capacities, train=train)
            same = jax.vmap(lambda s: submanifold_tables(s, CUBE))(sites)
            x = stage.first(x, same, sites.valid, train=train)
            x = stage.second(x, same, sites.valid, train=train)
            stride *= 2
            scales.append(Scale(sites, x, stride))
        sites, x, dropped["out"] = _strided(self.out, "out", sites, x=x, capacities=capacities, train=train)
        return scales, height_compression(sites, x), dropped


def _strided(
    block: SparseBlock,
    name: str,
    sites: Sites,
    *,
    x: Float[Array, "b n c"],
    capacities: dict[str, int],
    train: bool,
) -> tuple[Sites, Float[Array, "b m d"], Int[Array, " b"]]:
    form = DOWN[name]
    outputs, dropped = jax.vmap(lambda s: strided_sites(s, *form, capacity=capacities[name]))(sites)
    tables = jax.vmap(lambda i, o: strided_tables(i, o, *form))(sites, outputs)
    return outputs, block(x, tables, outputs.valid, train=train), dropped


def height_compression(sites: Sites, features: Float[Array, "b n c"]) -> Float[Array, "b h w cz"]:
    """The map from above: the features of a column's cells side by side, channel c z_cells + z; 0 where none is."""
    planes, rows, columns = sites.shape
    b, _, c = features.shape
    volume = jnp.zeros((b, planes * rows * columns, c), features.dtype)
    volume = jax.vmap(lambda v, key, f: v.at[key].set(f, mode="drop"))(volume, sites.key, features)
    return volume.reshape(b, planes, rows, columns, c).transpose(0, 2, 3, 4, 1).reshape(b, rows, columns, c * planes)


def capacities(config: VoxelConfig, max_voxels: int) -> dict[str, int]:
    """Places of a sample in each stage, for a cap on voxels."""
    return {name: round(growth * max_voxels) for name, growth in zip(DOWN, config.growth, strict=True)}
