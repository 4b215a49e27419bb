"""The second stage: proposals, pooled features, a score and a better box for each (OpenPCDet's VoxelRCNNHead)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Bool, Float

from jaxsim.config import BackboneConfig, ProposalConfig, RoiConfig, VoxelConfig
from jaxsim.detect.backbone2d import BOX
from jaxsim.detect.backbone3d import Scale
from jaxsim.detect.layers import BatchNorm, Linear
from jaxsim.detect.roi_pool import VoxelPool, grid_points
from jaxsim.geometry.boxes import nms_bev

Array = Any


def propose(
    score: Float[Array, "b a"], boxes: Float[Array, "b a 7"], config: ProposalConfig
) -> tuple[Float[Array, "b r 7"], Float[Array, "b r"], Bool[Array, "b r"]]:
    """The best boxes that do not overlap: boxes, scores, and which places are taken. The others are 0."""
    index, kept = nms_bev(boxes, score, config.overlap, keep=config.after, consider=config.before)
    boxes = jnp.take_along_axis(boxes, index[..., None], axis=1) * kept[..., None].astype(boxes.dtype)
    score = jnp.take_along_axis(score, index, axis=1) * kept.astype(score.dtype)
    return boxes, score, kept


class FullyConnected(nnx.Module):
    """Linear maps without bias, each with batch norm and ReLU; dropout between them."""

    def __init__(self, in_channels: int, widths: tuple[int, ...], dropout: float, *, rngs: nnx.Rngs):
        self.dropout, layers, norms = dropout, [], []
        for width in widths:
            layer = Linear(in_channels, width, bias=False, rngs=rngs)
            deviation = (2 / (in_channels + width)) ** 0.5
            layer.kernel[...] = deviation * jax.random.normal(rngs.params(), (in_channels, width))
            layers.append(layer)
            norms.append(BatchNorm(width))
            in_channels = width
        self.layers, self.norms = nnx.List(layers), nnx.List(norms)

    def __call__(self, x: Float[Array, "*b c"], *, key: Array | None) -> Float[Array, "*b d"]:
        """With a key as in training: batch statistics and dropout."""
        for k, (layer, norm) in enumerate(zip(self.layers, self.norms, strict=True)):
            x = jax.nn.relu(norm(layer(x), train=key is not None))
            if key is not None and self.dropout and k + 1 < len(self.layers):
                kept = jax.random.bernoulli(jax.random.fold_in(key, k), 1 - self.dropout, x.shape)
                x = jnp.where(kept, x / (1 - self.dropout), 0)
        return x


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
            pool(scale, points, radius, voxels, self.config, train=train)
            for pool, scale, radius in zip(self.pools, scales, self.config.radii_m, strict=True)
        ]
        keys = [None] * 3 if key is None else list(jax.random.split(key, 3))
        shared = self.shared(jnp.concatenate(pooled, axis=-1).reshape(b, r, -1), key=keys[0])
        cls, box = self.cls(self.of_cls(shared, key=keys[1])), self.box(self.of_box(shared, key=keys[2]))
        return cls[..., 0], box
