"""Points to voxels: capped, deterministic, the mean of each voxel's first points (MeanVFE).

The rules are those of the voxel generator that OpenPCDet calls (spconv's Point2Voxel): voxels are opened in the order
of the points until the cap is reached; later points still join open voxels, up to their limit. The cell of a point is
computed in float32, as there: in float64 points on a border fall elsewhere.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.config import VoxelConfig
from jaxsim.detect.sparse import Sites, Triple, cells, key_of
from jaxsim.frame import Array


@struct.dataclass
class Voxels:
    """One sample's voxels, by rising key."""

    sites: Sites
    features: Array
    """(n, c): mean of each voxel's points; 0 in unused places."""
    points: Array
    """int32 (n): points that entered the mean."""
    first: Array
    """int32 (n): number of the point that opened the voxel, which is the order of the published arrays."""
    dropped: Array
    """int32: voxels beyond the cap, left out."""


def grid_shape(config: VoxelConfig) -> Triple:
    """Voxels along z, y, x of the range."""
    low, high = np.array(config.range_m[:3]), np.array(config.range_m[3:])
    x, y, z = np.round((high - low) / np.array(config.size_m)).astype(int)
    return int(z), int(y), int(x)


def sparse_shape(config: VoxelConfig) -> Triple:
    """Grid of the sparse tensors: one more along z than there are voxels, as OpenPCDet's backbone has it."""
    z, y, x = grid_shape(config)
    return z + 1, y, x


def voxelize(points: Float[Array, "p c"], valid: Bool[Array, " p"], config: VoxelConfig, *, max_voxels: int) -> Voxels:
    """Voxels of one cloud: x, y, z in metres, then any features. Points outside the range are left out."""
    inner, shape = grid_shape(config), sparse_shape(config)
    count, outside = len(points), cells(shape)
    low = jnp.asarray(config.range_m[:3], jnp.float32)
    size = jnp.asarray(config.size_m, jnp.float32)
    # A divisor a point, behind a barrier: by a common one XLA multiplies inversely, which moves points on borders.
    size = jax.lax.optimization_barrier(jnp.broadcast_to(size, (count, 3)))
    xyz = jnp.floor((points[:, :3] - low[None]) / size)
    inside = valid & ((xyz >= 0) & (xyz < jnp.array(inner[::-1], jnp.float32)[None])).all(axis=1)
    zyx = jnp.where(inside[:, None], xyz[:, ::-1], 0).astype(jnp.int32)
    key = jnp.where(inside, key_of(zyx, shape), outside)

    order = jnp.argsort(key, stable=True).astype(jnp.int32)  # within a voxel the points keep their order
    key = key[order]
    new = (key < outside) & jnp.concatenate([jnp.ones(1, bool), key[1:] != key[:-1]])
    opens = jnp.zeros(count, bool).at[order].set(new)
    rank = jnp.cumsum(opens, dtype=jnp.int32)[order]  # which voxel this is in the order of opening, from 1
    opened = new & (rank <= max_voxels)
    slot = jnp.where(opened, jnp.cumsum(opened, dtype=jnp.int32) - 1, max_voxels)
    # Where each voxel's points begin in the sorted order: its first ones follow from there.
    start = jnp.full(max_voxels, count, jnp.int32).at[slot].set(jnp.arange(count, dtype=jnp.int32), mode="drop")
    of_voxel = key.at[start].get(mode="fill", fill_value=outside)

    member = start[:, None] + jnp.arange(config.points_per_voxel, dtype=jnp.int32)[None]
    belongs = (key.at[member].get(mode="fill", fill_value=outside) == of_voxel[:, None]) & (of_voxel < outside)[:, None]
    rows = points[order.at[member].get(mode="fill", fill_value=0)] * belongs[..., None].astype(points.dtype)
    number = belongs.sum(axis=1, dtype=jnp.int32)
    return Voxels(
        sites=Sites(of_voxel, shape),
        features=rows.sum(axis=1) / jnp.maximum(number, 1).astype(points.dtype)[:, None],
        points=number,
        first=order.at[start].get(mode="fill", fill_value=count),
        dropped=jnp.maximum(new.sum(dtype=jnp.int32) - max_voxels, 0),
    )
