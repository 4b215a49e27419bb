"""The second stage: features pooled around proposals, a score and a better box for each.

Voxel query and voxel RoI pooling (Deng et al., AAAI 2021, 3.2; OpenPCDet's NeighborVoxelSAModuleMSG and
VoxelRCNNHead). Letters: q grid points of a sample, n voxels, s samples of a query, c channels.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Bool, Float, Int

from jaxsim.config import BackboneConfig, RoiConfig, VoxelConfig
from jaxsim.detect.backbones import BOX, Scale
from jaxsim.detect.layers import BatchNorm, FullyConnected, Linear
from jaxsim.detect.roi_targets import turned
from jaxsim.detect.sparse import Sites
from jaxsim.frame import Array


def grid_points(rois: Float[Array, "*b r 7"], grid: int) -> Float[Array, "*b r g 3"]:
    """Middles of grid x grid x grid cells of each proposal, in `velo`; x slowest, z fastest."""
    place = (np.stack(np.meshgrid(*[np.arange(grid)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) / grid - 0.5
    place = jnp.asarray(place, rois.dtype).reshape((1,) * (rois.ndim - 1) + (-1, 3))
    local = place * rois[..., None, 3:6]
    heading = jnp.broadcast_to(rois[..., None, 6], local.shape[:-1])
    return turned(local, heading) + rois[..., None, :3]


def cell_of(xyz: Float[Array, "q 3"], voxels: VoxelConfig, stride: int) -> Int[Array, "q 3"]:
    """Cell (z, y, x) that a point lies in, which may be outside the grid."""
    low = jnp.asarray(voxels.range_m[:3], jnp.float32)
    size = jnp.asarray(voxels.size_m, jnp.float32)
    size = jax.lax.optimization_barrier(jnp.broadcast_to(size, xyz.shape))  # a true division, see voxelize
    fine = jnp.floor((xyz - low[None]) / size).astype(jnp.int32)
    return (fine // stride)[:, ::-1]


def cell_centres(zyx: Int[Array, "*n 3"], voxels: VoxelConfig, stride: int) -> Float[Array, "*n 3"]:
    """Middles (x, y, z in metres) of cells."""
    lift = (1,) * (zyx.ndim - 1) + (3,)
    low = jnp.asarray(voxels.range_m[:3], jnp.float32).reshape(lift)
    size = jnp.asarray(voxels.size_m, jnp.float32).reshape(lift)
    return (zyx[..., ::-1].astype(jnp.float32) + 0.5) * (size * stride) + low


@lru_cache
def _rows_in_reach(reach: int, radius_m: float, cell_m: tuple[float, float, float]) -> Int[np.ndarray, "k 2"]:
    """Offsets (dz, dy) that can hold a cell within the radius of a point anywhere in the middle cell.

    Leaving out the others changes no answer: their cells are all too far.
    """
    near = [
        (dz, dy)
        for dz, dy in product(range(-reach, reach + 1), repeat=2)
        if (max(abs(dz) - 0.5, 0) * cell_m[2]) ** 2 + (max(abs(dy) - 0.5, 0) * cell_m[1]) ** 2
        # A thousandth more: rounding must not lose a cell that the query itself would call near.
        <= (1.001 * radius_m) ** 2
    ]
    return np.array(near, np.int32)


def voxel_query(
    sites: Sites, xyz: Float[Array, "q 3"], voxels: VoxelConfig, *, stride: int, radius_m: float, config: RoiConfig
) -> tuple[Int[Array, "q s"], Bool[Array, " q"]]:
    """Rows of the first active voxels within the radius of each point, and whether there is any.

    Looked at are the cells up to `reach` away along each axis, z slowest, x fastest; what lacks repeats the first.
    """
    planes, rows, columns = sites.shape
    reach, count = config.reach, config.samples
    cell = cell_of(xyz, voxels, stride)
    x = cell[:, 2]
    left, right = jnp.maximum(x - reach, 0), jnp.minimum(x + reach, columns - 1)
    size = tuple(float(s * stride) for s in voxels.size_m)
    slots = jnp.arange(count, dtype=jnp.int32)[None]

    def look(state: tuple[Array, Array], offset: Array) -> tuple[tuple[Array, Array], None]:
        found, taken = state
        z, y = cell[:, 0] + offset[0], cell[:, 1] + offset[1]
        inside = (z >= 0) & (z < planes) & (y >= 0) & (y < rows) & (left <= right)
        start = jnp.where(inside, (z * rows + y) * columns, 0)
        # Keys rise along x, so that a row of cells is one stretch of the sites, found by one search.
        at = jnp.searchsorted(sites.key, start + left).astype(jnp.int32)
        for k in range(2 * reach + 1):  # a row's sites follow one another
            key = sites.key.at[at + k].get(mode="fill", fill_value=-1)
            column = key - start
            place = jnp.stack([z, y, column], axis=-1)
            off = xyz - cell_centres(place, voxels, stride)
            near = inside & (column >= left) & (column <= right) & ((off * off).sum(axis=-1) <= radius_m**2)
            # Into the next free slot; once all are taken, `taken` names none.
            found = jnp.where(near[:, None] & (slots == taken[:, None]), (at + k)[:, None], found)
            taken = taken + near.astype(jnp.int32)
        return (found, taken), None

    none = jnp.zeros((len(xyz), count), jnp.int32), jnp.zeros(len(xyz), jnp.int32)
    (found, taken), _ = jax.lax.scan(look, none, jnp.asarray(_rows_in_reach(reach, radius_m, size)))
    return jnp.where(slots < taken[:, None], found, found[:, :1]), taken > 0


class VoxelPool(nnx.Module):
    """Pools one stride's voxel features at grid points: a point sees its voxels' features and their offsets."""

    def __init__(self, in_channels: int, width: int, *, rngs: nnx.Rngs):
        self.of_features, self.features_norm = Linear(in_channels, width, bias=False, rngs=rngs), BatchNorm(width)
        self.of_offset, self.offset_norm = Linear(3, width, bias=False, rngs=rngs), BatchNorm(width)
        self.out, self.out_norm = Linear(width, width, bias=False, rngs=rngs), BatchNorm(width)
        for layer in (self.of_features, self.of_offset, self.out):
            fan_in = layer.kernel[...].shape[0]  # He's normal values, as published
            layer.kernel[...] = (2 / fan_in) ** 0.5 * jax.random.normal(rngs.params(), layer.kernel[...].shape)

    def __call__(
        self,
        scale: Scale,
        xyz: Float[Array, "b q 3"],
        *,
        radius_m: float,
        voxels: VoxelConfig,
        config: RoiConfig,
        train: bool,
    ) -> Float[Array, "b q c"]:
        sites = scale.sites
        query = partial(voxel_query, voxels=voxels, stride=scale.stride, radius_m=radius_m, config=config)
        index, any_near = jax.vmap(query)(sites, jax.lax.stop_gradient(xyz))
        features = self.features_norm(self.of_features(scale.features), sites.valid, train=train)
        # A point without a voxel sees features and offset 0.
        near = any_near[..., None, None].astype(features.dtype)
        grouped = jax.vmap(lambda f, i: f[i])(features, index) * near
        centres = jax.vmap(lambda s, i: s[i])(cell_centres(sites.zyx, voxels, scale.stride), index)
        offset = (centres - xyz[:, :, None]) * near
        together = jax.nn.relu(grouped + self.offset_norm(self.of_offset(offset), train=train))
        return jax.nn.relu(self.out_norm(self.out(_pooled(together)), train=train))


def _pooled(grouped: Float[Array, "b q s c"]) -> Float[Array, "b q c"]:
    """The maximum over a query's samples; its gradient goes to the first of them.

    By its place: the gradient of `max` looks for the samples that equal the maximum, and finds none where XLA computes
    a sample twice and rounds it otherwise.
    """
    place = jnp.argmax(grouped, axis=2, keepdims=True)
    largest = jnp.arange(grouped.shape[2]).reshape(1, 1, -1, 1) == place
    return jnp.where(largest, grouped, 0).sum(axis=2)


class VoxelRoiHead(nnx.Module):
    """Score and box of each proposal from the voxel features inside and around it."""

    def __init__(self, config: RoiConfig, backbone: BackboneConfig, *, rngs: nnx.Rngs):
        self.config = config
        self.pools = nnx.List([VoxelPool(c, config.width, rngs=rngs) for c in backbone.widths[1:]])
        pooled, last = config.grid**3 * config.width * len(self.pools), config.layers[-1]
        self.shared = FullyConnected(pooled, config.layers, config.dropout, rngs=rngs)
        self.of_cls = FullyConnected(last, config.layers, config.dropout, rngs=rngs)
        self.of_box = FullyConnected(last, config.layers, config.dropout, rngs=rngs)
        self.cls, self.box = Linear(last, 1, rngs=rngs), Linear(last, BOX, rngs=rngs)
        for layer, deviation in ((self.cls, config.score_deviation), (self.box, 0.001)):
            layer.kernel[...] = deviation * jax.random.normal(rngs.params(), layer.kernel[...].shape)
            layer.bias[...] = jnp.zeros_like(layer.bias[...])

    def __call__(
        self, scales: list[Scale], rois: Float[Array, "b r 7"], voxels: VoxelConfig, *, key: Array | None
    ) -> tuple[Float[Array, "b r"], Float[Array, "b r 7"]]:
        """Logits and encoded boxes; with a key as in training."""
        b, r, _ = rois.shape
        points, train = grid_points(rois, self.config.grid).reshape(b, -1, 3), key is not None
        pooled = [
            pool(scale, points, radius_m=radius, voxels=voxels, config=self.config, train=train)
            for pool, scale, radius in zip(self.pools, scales, self.config.radii_m, strict=True)
        ]
        keys = [None] * 3 if key is None else list(jax.random.split(key, 3))
        shared = self.shared(jnp.concatenate(pooled, axis=-1).reshape(b, r, -1), key=keys[0])
        cls, box = self.cls(self.of_cls(shared, key=keys[1])), self.box(self.of_box(shared, key=keys[2]))
        return cls[..., 0], box
