"""Anchors, the box coder, and which anchor learns which object (OpenPCDet's AnchorGenerator, ResidualCoder,
AxisAlignedTargetAssigner).

Boxes are (x, y, z, l, w, h, a) as in geometry.boxes: middle, sides in metres, heading in radians.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.config import AnchorConfig, VoxelConfig
from jaxsim.detect.voxelize import grid_shape
from jaxsim.frame import Array
from jaxsim.geometry.boxes import iou_2d

STRIDE = 8
SMALLEST_M = 1e-5
DIRECTION_OFFSET = 0.78539
"""Angle at which the direction bins meet, as published: not quite pi / 4."""
ROUNDING = 1e-6
"""Relative difference below which two overlaps are one."""


@struct.dataclass
class AnchorTargets:
    """What the anchors of a batch learn."""

    positive: Array
    """bool (b, a)."""
    background: Array
    """bool (b, a); an anchor that is neither is ignored."""
    deltas: Array
    """(b, a, 7): encoded boxes; 0 where not positive."""
    direction: Array
    """int32 (b, a): bin of the heading; 0 where not positive."""


def anchor_boxes(config: AnchorConfig, voxels: VoxelConfig) -> Float[np.ndarray, "a 7"]:
    """All anchors in the order row (y), column (x), heading. The outermost lie on the range's borders, as published."""
    _, rows, columns = grid_shape(voxels)
    x0, y0, _, x1, y1, _ = voxels.range_m
    x = np.linspace(x0, x1, columns // STRIDE).astype(np.float32)
    y = np.linspace(y0, y1, rows // STRIDE).astype(np.float32)
    y, x, yaw = np.meshgrid(y, x, np.array(config.yaws_rad, np.float32), indexing="ij")
    fixed = np.array([config.bottom_m + config.size_m[2] / 2, *config.size_m], np.float32)
    boxes = np.concatenate([np.stack([x, y], -1), np.broadcast_to(fixed, (*x.shape, 4)), yaw[..., None]], axis=-1)
    return boxes.reshape(-1, 7).astype(np.float32)


def encode(boxes: Float[Array, "*b 7"], anchors: Float[Array, "*b 7"]) -> Float[Array, "*b 7"]:
    """Boxes relative to anchors: offsets by the anchor's diagonal and height, log ratios of sizes, heading minus
    heading."""
    # SECOND's coding (Yan, Mao, Li 2018): offsets of all anchors are of one scale, whatever their size.
    size = jnp.maximum(boxes[..., 3:6], SMALLEST_M)
    base = jnp.maximum(anchors[..., 3:6], SMALLEST_M)
    diagonal = jnp.sqrt(base[..., :1] ** 2 + base[..., 1:2] ** 2)
    return jnp.concatenate(
        [
            (boxes[..., :2] - anchors[..., :2]) / diagonal,
            (boxes[..., 2:3] - anchors[..., 2:3]) / base[..., 2:],
            jnp.log(size / base),
            boxes[..., 6:] - anchors[..., 6:],
        ],
        axis=-1,
    )


def decode(deltas: Float[Array, "*b 7"], anchors: Float[Array, "*b 7"]) -> Float[Array, "*b 7"]:
    """The inverse of `encode`."""
    base = anchors[..., 3:6]
    diagonal = jnp.sqrt(base[..., :1] ** 2 + base[..., 1:2] ** 2)
    return jnp.concatenate(
        [
            deltas[..., :2] * diagonal + anchors[..., :2],
            deltas[..., 2:3] * base[..., 2:] + anchors[..., 2:3],
            jnp.exp(deltas[..., 3:6]) * base,
            deltas[..., 6:] + anchors[..., 6:],
        ],
        axis=-1,
    )


def limit_period(value: Float[Array, "*b"], offset: float, period: float) -> Float[Array, "*b"]:
    """The value moved by whole periods into [-offset period, (1 - offset) period)."""
    return value - jnp.floor(value / period + offset) * period


def direction_bin(heading_rad: Float[Array, "*b"]) -> Int[Array, "*b"]:
    """0 for headings from DIRECTION_OFFSET on over half a turn, else 1 (int32)."""
    turned = limit_period(heading_rad - DIRECTION_OFFSET, 0.0, 2 * jnp.pi)
    return jnp.clip(jnp.floor(turned / jnp.pi), 0, 1).astype(jnp.int32)


def decode_with_direction(
    deltas: Float[Array, "*b 7"], anchors: Float[Array, "*b 7"], direction: Float[Array, "*b 2"]
) -> Float[Array, "*b 7"]:
    """Boxes whose heading's half turn comes from the direction bin of the larger logit."""
    boxes = decode(deltas, anchors)
    # The encoded heading is learned through a sine, which half turns do not change: the bin says which half.
    half = limit_period(boxes[..., 6] - DIRECTION_OFFSET, 0.0, jnp.pi) + DIRECTION_OFFSET
    heading = half + jnp.pi * jnp.argmax(direction, axis=-1).astype(boxes.dtype)
    return boxes.at[..., 6].set(heading)


def nearest_bev(boxes: Float[Array, "*b 7"]) -> Float[Array, "*b 4"]:
    """Rectangles (x0, y0, x1, y1) from above, each heading snapped to the nearer axis."""
    turn = jnp.abs(limit_period(boxes[..., 6], 0.5, jnp.pi))
    along = (turn < jnp.pi / 4)[..., None]
    # 4:2:-1 is width, then length: the box lies across.
    half = jnp.where(along, boxes[..., 3:5], boxes[..., 4:2:-1]) / 2
    return jnp.concatenate([boxes[..., :2] - half, boxes[..., :2] + half], axis=-1)


def anchor_targets(
    anchors: Float[Array, "a 7"], boxes: Float[Array, "b g 7"], valid: Bool[Array, "b g"], *, config: AnchorConfig
) -> AnchorTargets:
    """Targets of all anchors for the objects of each sample.

    An anchor is positive from `matched` overlap on, or if no other overlaps an object more; it learns the object that
    it overlaps most, which for one of the latter may be another.
    """

    def of_sample(boxes: Float[Array, "g 7"], valid: Bool[Array, " g"]) -> AnchorTargets:
        # As published: overlap of rectangles along the axes, not of the turned boxes.
        overlap = jnp.where(valid[None], iou_2d(nearest_bev(anchors), nearest_bev(boxes)), 0)
        most, mine = overlap.max(axis=1), overlap.argmax(axis=1)
        best = overlap.max(axis=0)
        # Within rounding of its own maximum: XLA may compute it anew, and round otherwise, for either.
        forced = ((overlap >= (1 - ROUNDING) * best[None]) & (best > 0)[None]).any(axis=1)
        positive = forced | (most >= config.matched)
        learned = boxes[mine]
        return AnchorTargets(
            positive=positive,
            background=~positive & (most < config.unmatched),
            deltas=jnp.where(positive[:, None], encode(learned, anchors), 0),
            direction=jnp.where(positive, direction_bin(learned[:, 6]), 0),
        )

    return jax.vmap(of_sample)(boxes, valid)
