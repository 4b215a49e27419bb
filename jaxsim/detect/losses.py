"""Losses of both stages (OpenPCDet `loss_utils.py`, `anchor_head_template.py`, `roi_head_template.py`)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from jaxsim.config import DetectorConfig
from jaxsim.detect.anchors import AnchorTargets, decode, encode
from jaxsim.detect.roi_head import RoiTargets, from_roi
from jaxsim.frame import Array
from jaxsim.geometry.boxes import box_corners

FOCAL_ALPHA, FOCAL_GAMMA = 0.25, 2.0
BETA = 1 / 9
"""The error where the smooth L1 loss turns from square to straight."""


def focal(logit: Float[Array, "*b"], target: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Sigmoid focal loss of each logit (Lin et al. 2017, eq. 5)."""
    p = jax.nn.sigmoid(logit)
    alpha = target * FOCAL_ALPHA + (1 - target) * (1 - FOCAL_ALPHA)
    off = target * (1 - p) + (1 - target) * p  # 1 - p_t of the paper
    return alpha * off**FOCAL_GAMMA * bce(logit, target)


def bce(logit: Float[Array, "*b"], target: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Binary cross entropy of each logit; targets may lie between 0 and 1."""
    # In this form no exponential overflows.
    return jnp.maximum(logit, 0) - logit * target + jnp.log1p(jnp.exp(-jnp.abs(logit)))


def smooth_l1(predicted: Float[Array, "*b"], target: Float[Array, "*b"], *, beta: float = BETA) -> Float[Array, "*b"]:
    """Half a square over beta below it, straight above; a NaN target costs nothing."""
    off = jnp.abs(predicted - jnp.where(jnp.isnan(target), predicted, target))
    return jnp.where(off < beta, 0.5 * off**2 / beta, off - 0.5 * beta)


def sine_difference(
    predicted: Float[Array, "*b 7"], target: Float[Array, "*b 7"]
) -> tuple[Float[Array, "*b 7"], Float[Array, "*b 7"]]:
    """The encoded boxes with headings p, t replaced by sin p cos t and cos p sin t: their difference is sin(p - t)."""
    p, t = predicted[..., 6], target[..., 6]
    return predicted.at[..., 6].set(jnp.sin(p) * jnp.cos(t)), target.at[..., 6].set(jnp.cos(p) * jnp.sin(t))


def cross_entropy(logits: Float[Array, "*b c"], label: Int[Array, "*b"]) -> Float[Array, "*b"]:
    """Softmax cross entropy of each row."""
    return jax.nn.logsumexp(logits, axis=-1) - jnp.take_along_axis(logits, label[..., None], axis=-1)[..., 0]


def corner_loss(predicted: Float[Array, "n 7"], target: Float[Array, "n 7"]) -> Float[Array, " n"]:
    """Mean Huber loss of the distances between the corners of two boxes.

    Each corner takes the nearer of the target's corner and that of the target turned about, as published.
    """
    corners = box_corners(predicted)
    turned = target.at[..., 6].add(jnp.pi)
    ahead = _lengths(corners - box_corners(target))
    about = _lengths(corners - box_corners(turned))
    return smooth_l1(jnp.minimum(ahead, about), jnp.zeros_like(ahead), beta=1.0).mean(axis=-1)


def _lengths(offset: Float[Array, "n 8 3"]) -> Float[Array, "n 8"]:
    """Norms whose gradient at 0 is 0, not NaN."""
    squared = (offset * offset).sum(axis=-1)
    apart = squared > 0
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, squared, 1)), 0)


def rpn_losses(
    outputs: tuple[Float[Array, "b a"], Float[Array, "b a 7"], Float[Array, "b a 2"]],
    targets: AnchorTargets,
    config: DetectorConfig,
) -> dict[str, Float[Array, ""]]:
    """The anchor head's weighted terms: each sample's sum over its number of positive anchors, mean over samples.

    `outputs` are the head's: logits, encoded boxes and direction logits.
    """
    cls, box, direction = outputs
    b = len(cls)
    # An anchor that is neither positive nor background costs nothing.
    positive = targets.positive.astype(cls.dtype)
    cared = positive + targets.background.astype(cls.dtype)
    norm = jnp.maximum(positive.sum(axis=1, keepdims=True), 1)
    given, wanted = sine_difference(box, targets.deltas)
    of_box = smooth_l1(given, wanted).sum(axis=-1)
    of_direction = cross_entropy(direction, targets.direction)
    return {
        "rpn_cls": config.cls_weight * (focal(cls, positive) * cared / norm).sum() / b,
        "rpn_loc": config.loc_weight * (of_box * positive / norm).sum() / b,
        "rpn_dir": config.dir_weight * (of_direction * positive / norm).sum() / b,
    }


def roi_losses(
    cls: Float[Array, "b r"], box: Float[Array, "b r 7"], targets: RoiTargets, *, config: DetectorConfig
) -> dict[str, Float[Array, ""]]:
    """The second stage's weighted terms: scores over all proposals, boxes and corners over the foreground ones."""
    rois, foreground = targets.rois, targets.foreground.astype(cls.dtype)
    count = jnp.maximum(foreground.sum(), 1)
    bare = _bare(rois)
    # A proposal that fills up the list has no size, and the logarithm of its ratio no bound.
    wanted = jnp.where(targets.foreground[..., None], encode(targets.canonical, bare), 0)
    of_box = smooth_l1(box, wanted).sum(axis=-1)
    # A background proposal's box is not learned, and its exponential may overflow: 0 times infinity is no number.
    safe = jnp.where(targets.foreground[..., None], box, 0)
    of_corners = corner_loss(refined(safe, rois).reshape(-1, 7), targets.boxes.reshape(-1, 7))
    return {
        "roi_cls": config.roi_cls_weight * bce(cls, targets.score).mean(),
        "roi_reg": config.roi_reg_weight * (of_box * foreground).sum() / count,
        "roi_corner": config.roi_corner_weight * (of_corners.reshape(foreground.shape) * foreground).sum() / count,
    }


def refined(box: Float[Array, "*b r 7"], rois: Float[Array, "*b r 7"]) -> Float[Array, "*b r 7"]:
    """Boxes that the second stage makes of proposals."""
    return from_roi(decode(box, _bare(rois)), rois)


def _bare(rois: Float[Array, "*b r 7"]) -> Float[Array, "*b r 7"]:
    """Proposals at the origin, along x: what the second stage's boxes are encoded against."""
    return rois.at[..., :3].set(0).at[..., 6].set(0)
