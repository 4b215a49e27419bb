"""Voxel R-CNN whole: both stages as one module, in training and in use."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx, struct
from jaxtyping import Bool, Float

from jaxsim.config import DetectorConfig, ProposalConfig, VoxelConfig
from jaxsim.detect.anchors import anchor_boxes, anchor_targets, decode_with_direction
from jaxsim.detect.backbones import DOWN, AnchorHead, BevBackbone, SparseScale, VoxelBackBone8x, capacities
from jaxsim.detect.losses import refined, roi_losses, rpn_losses
from jaxsim.detect.roi_head import VoxelRoiHead, assign_rois
from jaxsim.detect.sparse import strided_shape
from jaxsim.detect.voxelize import sparse_shape, voxelize
from jaxsim.frame import Array
from jaxsim.geometry.boxes import nms_bev

FEATURES = 4
"""x, y, z in metres, intensity 0..1."""


@struct.dataclass
class Detections:
    """What was found in a batch; a place that `valid` does not name holds nothing."""

    boxes: Array
    """(b, d, 7) in `velo`."""
    score: Array
    """(b, d): 0..1, falling."""
    valid: Array
    """bool (b, d)."""


class VoxelRcnn(nnx.Module):
    """Voxel R-CNN for one class.

    Shapes: points (b, p, 4) with their mask, objects (b, g, 7) with theirs.
    """

    def __init__(self, config: DetectorConfig, voxels: VoxelConfig, *, rngs: nnx.Rngs):
        self.config, self.voxels = config, voxels
        backbone = config.backbone
        self.backbone3d = VoxelBackBone8x(backbone, FEATURES, rngs=rngs)
        self.backbone2d = BevBackbone(backbone, bev_channels(config, voxels), rngs=rngs)
        self.head = AnchorHead(sum(backbone.up_widths), len(config.anchors.yaws_rad), rngs=rngs)
        self.roi = VoxelRoiHead(config.roi, backbone, rngs=rngs)

    def first_stage(
        self, points: Float[Array, "b p 4"], valid: Bool[Array, "b p"], *, train: bool
    ) -> tuple[list[SparseScale], tuple[Array, Array, Array], Float[Array, "b a 7"], dict[str, Array]]:
        """Sparse features, the anchor head's outputs, its boxes, and the voxels and sites left out, by stage."""
        cap = self.voxels.max_voxels_train if train else self.voxels.max_voxels
        voxels = jax.vmap(lambda p, v: voxelize(p, v, self.voxels, max_voxels=cap))(points, valid)
        places = capacities(self.voxels, cap)
        # Beside coordinates in metres an intensity of 0..1 is next to nothing.
        units = jnp.array([[[1, 1, 1, self.config.intensity_m]]], voxels.features.dtype)
        scales, bev, dropped = self.backbone3d(voxels.sites, voxels.features * units, places, train=train)
        outputs = self.head(self.backbone2d(bev, train=train))
        anchors = jnp.asarray(anchor_boxes(self.config.anchors, self.voxels))
        boxes = decode_with_direction(outputs[1], jnp.broadcast_to(anchors[None], outputs[1].shape), outputs[2])
        return scales, outputs, boxes, {"voxels": voxels.dropped, **dropped}

    def losses(
        self,
        points: Float[Array, "b p 4"],
        valid: Bool[Array, "b p"],
        *,
        objects: Float[Array, "b g 7"],
        is_object: Bool[Array, "b g"],
        key: Array,
    ) -> tuple[dict[str, Float[Array, ""]], dict[str, Array]]:
        """Weighted loss terms of a training batch, and what was left out (voxels and sites, a sample)."""
        scales, outputs, boxes, dropped = self.first_stage(points, valid, train=True)
        anchors = jnp.asarray(anchor_boxes(self.config.anchors, self.voxels))
        wanted = anchor_targets(anchors, objects, is_object, config=self.config.anchors)
        terms = rpn_losses(outputs, wanted, self.config)
        of_sample, of_dropout = jax.random.split(key)
        # Proposals are given to the second stage: its losses do not move them.
        stop = jax.lax.stop_gradient
        rois, _ = propose(stop(outputs[0]), stop(boxes), self.config.train_proposals)
        targets = assign_rois(rois, objects, is_object, key=of_sample, config=self.config.roi)
        cls, box = self.roi(scales, targets.rois, self.voxels, key=of_dropout)
        return terms | roi_losses(cls, box, targets, config=self.config), dropped

    def detect(self, points: Float[Array, "b p 4"], valid: Bool[Array, "b p"]) -> tuple[Detections, dict[str, Array]]:
        """Boxes of scores of `config.score` and more, and what was left out (voxels and sites, a sample)."""
        scales, (cls, _, _), boxes, dropped = self.first_stage(points, valid, train=False)
        rois, taken = propose(cls, boxes, self.config.proposals)
        logit, box = self.roi(scales, rois, self.voxels, key=None)
        boxes = refined(box, rois)
        score = jax.nn.sigmoid(logit)
        final = self.config.final
        keep = min(final.after, rois.shape[1])
        # Places that no proposal fills hold boxes of size 0, which have a score like any other.
        good = taken & (score >= self.config.score)
        index, good_box = nms_bev(boxes, score, final.overlap, keep=keep, consider=final.before, valid=good)
        boxes = jnp.take_along_axis(boxes, index[..., None], axis=1)
        return Detections(boxes, jnp.take_along_axis(score, index, axis=1), good_box), dropped


def propose(
    score: Float[Array, "b a"], boxes: Float[Array, "b a 7"], config: ProposalConfig
) -> tuple[Float[Array, "b r 7"], Bool[Array, "b r"]]:
    """The best boxes that do not overlap, and which places are taken. The others are 0."""
    index, taken = nms_bev(boxes, score, config.overlap, keep=config.after, consider=config.before)
    boxes = jnp.take_along_axis(boxes, index[..., None], axis=1) * taken[..., None].astype(boxes.dtype)
    return boxes, taken


def bev_channels(config: DetectorConfig, voxels: VoxelConfig) -> int:
    """Channels of the map from above. Raises ValueError where the range does not divide into cells of 8 voxels."""
    shape = sparse_shape(voxels)
    if shape[1] % 8 or shape[2] % 8:
        raise ValueError(
            f"detect: the range holds {shape[2]} x {shape[1]} voxels along x and y; make both multiples of 8 "
            "(--voxels.range-m, --voxels.size-m)"
        )
    for window in DOWN.values():
        shape = strided_shape(shape, window)
    if shape[0] < 1:
        raise ValueError(f"detect: the range is too low for its voxels: {np.round(voxels.range_m, 3)}; no cell is left")
    return shape[0] * config.backbone.out
