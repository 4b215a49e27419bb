"""Boxes around objects: corners, points inside, overlap, suppression.

A box is (x, y, z, l, w, h, a) in `velo`: its middle, length along its heading, width, height in metres, and heading a
in radians, counter-clockwise from x (OpenPCDet's convention). `lidar_boxes` and `camera_boxes` carry labels over.

Overlap seen from above: in the frame of box B, centred on box A, the area of A inside B is the integral along A's
outline of F(x, y) dx, where F grows with y inside B and is constant outside (Green's theorem). F is y clamped to B's
sides, an edge of A is straight: each of the four edges gives a closed form. No list of vertices, no test of what
lies inside, and so nothing that jumps where edges or corners meet: float32 suffices.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array, Boxes

_NO_LENGTH_M = 1e-20
_OUTLINE = (0, 1, 3, 4, 6)
"""Of a box's numbers those of its outline from above: place, length, width and heading."""
# Front left, front right, rear right, rear left, below and then above: OpenPCDet's order.
_CORNERS = np.array(
    [[x, y, z] for z in (-0.5, 0.5) for x, y in ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))], np.float32
)


class Difficulty(NamedTuple):
    """Least height of the box in the image, and the most that a labelled object may be hidden."""

    height_px: float
    occluded: int
    truncated: float


DIFFICULTIES = {
    # MIN_HEIGHT, MAX_OCCLUSION and MAX_TRUNCATION of KITTI's devkit.
    "easy": Difficulty(40, 0, 0.15),
    "moderate": Difficulty(25, 1, 0.30),
    "hard": Difficulty(25, 2, 0.50),
}


@jax.jit
def box_corners(boxes: Float[Array, "*b n 7"]) -> Float[Array, "*b n 8 3"]:
    """Corners of boxes in metres: front left, front right, rear right, rear left, first below and then above."""
    offset = boxes[..., None, 3:6] * jnp.broadcast_to(jnp.asarray(_CORNERS, boxes.dtype), (*boxes.shape[:-1], 8, 3))
    cos, sin = jnp.cos(boxes[..., None, 6]), jnp.sin(boxes[..., None, 6])
    x, y = offset[..., 0], offset[..., 1]
    turned = jnp.stack([cos * x - sin * y, sin * x + cos * y, offset[..., 2]], axis=-1)
    return boxes[..., None, :3] + turned


def corners_of(boxes: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 8 3"]:
    """`box_corners` on the host, in float64."""
    offset = np.asarray(boxes, np.float64)[:, None, 3:6] * _CORNERS
    cos, sin = np.cos(boxes[:, None, 6]), np.sin(boxes[:, None, 6])
    x, y = cos * offset[..., 0] - sin * offset[..., 1], sin * offset[..., 0] + cos * offset[..., 1]
    return np.stack([x, y, offset[..., 2]], axis=-1) + boxes[:, None, :3]


@jax.jit
def points_in_boxes(xyz_m: Float[Array, "*b p 3"], boxes: Float[Array, "*b n 7"]) -> Bool[Array, "*b p n"]:
    """Which points lie in which boxes; a point on a face is inside. A box with a side of 0 or less holds none."""
    offset = xyz_m[..., :, None, :] - boxes[..., None, :, :3]
    cos, sin = jnp.cos(boxes[..., None, :, 6]), jnp.sin(boxes[..., None, :, 6])
    along = jnp.abs(cos * offset[..., 0] + sin * offset[..., 1])
    aside = jnp.abs(cos * offset[..., 1] - sin * offset[..., 0])
    half = boxes[..., None, :, 3:6] / 2
    within = (along <= half[..., 0]) & (aside <= half[..., 1]) & (jnp.abs(offset[..., 2]) <= half[..., 2])
    return within & (half > 0).all(axis=-1)


def _mean_clamped(start: Float[Array, "*b"], end: Float[Array, "*b"], half: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Mean of clamp(y, -half, half) where y runs evenly from `start` to `end`."""
    low, high = jnp.minimum(start, end), jnp.maximum(start, end)
    low_in, high_in = jnp.clip(low, -half, half), jnp.clip(high, -half, half)
    # Below, between and above the two sides; weights are lengths, so that nothing cancels.
    total = (high_in - low_in) * (low_in + high_in) / 2 + half * ((high - high_in) - (low_in - low))
    length = high - low
    runs = length > _NO_LENGTH_M
    # Wholly below or above, or of no length: low_in is the value all along.
    return jnp.where(runs & (high_in > low_in), total / jnp.where(runs, length, jnp.ones_like(length)), low_in)


def _shared_area(a: Float[Array, "*b 7"], b: Float[Array, "*b 7"]) -> Float[Array, "*b"]:
    """Area in square metres that the outlines of `a` and `b` share from above, pair by pair."""
    dx, dy = a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]
    cos_b, sin_b = jnp.cos(b[..., 6]), jnp.sin(b[..., 6])
    x, y = cos_b * dx + sin_b * dy, cos_b * dy - sin_b * dx
    turn = a[..., 6] - b[..., 6]
    cos, sin = jnp.cos(turn), jnp.sin(turn)
    half_l, half_w = jnp.maximum(a[..., 3], 0) / 2, jnp.maximum(a[..., 4], 0) / 2
    half_x, half_y = jnp.maximum(b[..., 3], 0) / 2, jnp.maximum(b[..., 4], 0) / 2
    # Corners of `a` about its own middle (two and their opposites), and the sides of `b` from there.
    ahead, aside = (half_l * cos, half_l * sin), (-half_w * sin, half_w * cos)
    front, rear = (ahead[0] + aside[0], ahead[1] + aside[1]), (aside[0] - ahead[0], aside[1] - ahead[1])
    corners = (front, rear, (-front[0], -front[1]), (-rear[0], -rear[1]))
    middle = jnp.clip(y, -half_y, half_y)
    area = jnp.zeros_like(x)
    for (x0, y0), (x1, y1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        in0, in1 = jnp.clip(x0, -half_x - x, half_x - x), jnp.clip(x1, -half_x - x, half_x - x)
        run = x1 - x0
        slope = (y1 - y0) / jnp.where(jnp.abs(run) > _NO_LENGTH_M, run, jnp.ones_like(run))
        # Never past the edge's ends: a steep edge has no exact slope.
        low, high = jnp.minimum(y0, y1), jnp.maximum(y0, y1)
        start, end = jnp.clip(y0 + (in0 - x0) * slope, low, high), jnp.clip(y1 + (in1 - x1) * slope, low, high)
        # About the height of the middle: the constant drops out of the sum and would cost digits in a thin box.
        area += (in0 - in1) * (_mean_clamped(y + start, y + end, half_y) - middle)
    return jnp.maximum(area, 0)


def _iou(shared: Float[Array, "*b"], size_a: Float[Array, "*b"], size_b: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Shared part of the union; 0 where both are empty."""
    union = size_a + size_b - shared
    share = jnp.clip(shared / jnp.where(union > 0, union, jnp.ones_like(union)), 0, 1)
    # A number over itself need not be 1 on a GPU, whose division is off by its last bits.
    return jnp.where((union > 0) & (shared >= union), jnp.ones_like(share), share)


def _paired(a: Float[Array, "*b n c"], b: Float[Array, "*b m c"]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    *batch, n, c = a.shape
    shape = (*batch, n, b.shape[-2], c)
    return jnp.broadcast_to(a[..., :, None, :], shape), jnp.broadcast_to(b[..., None, :, :], shape)


@jax.jit
def pair_overlap(a: Float[Array, "*b 7"], b: Float[Array, "*b 7"]) -> tuple[Float[Array, "*b"], Float[Array, "*b"]]:
    """Overlap of `a[i]` with `b[i]`: intersection over union from above, and in space.

    Identical boxes give 1, touching ones 0; a box with a side of 0 or less has no overlap with any.
    """
    (area_a, volume_a), (area_b, volume_b) = _sizes(a), _sizes(b)
    # Outlines that are the same share all of it, whatever the sums of a device round.
    one = jnp.stack([a[..., k] == b[..., k] for k in _OUTLINE]).all(0)
    shared = jnp.where(one, area_a, _shared_area(a, b))
    top = jnp.minimum(a[..., 2] + a[..., 5] / 2, b[..., 2] + b[..., 5] / 2)
    bottom = jnp.maximum(a[..., 2] - a[..., 5] / 2, b[..., 2] - b[..., 5] / 2)
    # The same box must share its own height to the last bit, which top - bottom does not give far from 0.
    same = (a[..., 2] == b[..., 2]) & (a[..., 5] == b[..., 5])
    height = jnp.where(same, a[..., 5], top - bottom)
    volume = shared * jnp.maximum(height, 0)
    return _iou(shared, area_a, area_b), _iou(volume, volume_a, volume_b)


def _sizes(boxes: Float[Array, "*b 7"]) -> tuple[Float[Array, "*b"], Float[Array, "*b"]]:
    side = jnp.maximum(boxes[..., 3:6], 0)
    area = side[..., 0] * side[..., 1]
    return area, area * side[..., 2]


@jax.jit
def iou_bev(a: Float[Array, "*b n 7"], b: Float[Array, "*b m 7"]) -> Float[Array, "*b n m"]:
    """Intersection over union of every `a` with every `b` seen from above."""
    return pair_overlap(*_paired(a, b))[0]


@jax.jit
def iou_3d(a: Float[Array, "*b n 7"], b: Float[Array, "*b m 7"]) -> Float[Array, "*b n m"]:
    """Intersection over union in space of every `a` with every `b`, upright boxes."""
    return pair_overlap(*_paired(a, b))[1]


@jax.jit
def iou_2d(a: Float[Array, "*b n 4"], b: Float[Array, "*b m 4"]) -> Float[Array, "*b n m"]:
    """Intersection over union of rectangles (left, top, right, bottom), in pixels or metres: width = right - left."""
    a, b = _paired(a, b)
    side = jnp.minimum(a[..., 2:], b[..., 2:]) - jnp.maximum(a[..., :2], b[..., :2])
    side_a, side_b = jnp.maximum(a[..., 2:] - a[..., :2], 0), jnp.maximum(b[..., 2:] - b[..., :2], 0)
    shared = jnp.maximum(side[..., 0], 0) * jnp.maximum(side[..., 1], 0)
    return _iou(shared, side_a[..., 0] * side_a[..., 1], side_b[..., 0] * side_b[..., 1])


@partial(jax.jit, static_argnames=("keep", "consider"))
def nms_bev(
    boxes: Float[Array, "*b n 7"],
    score: Float[Array, "*b n"],
    threshold: Float[Array, ""] | float,
    *,
    keep: int,
    consider: int | None = None,
    valid: Bool[Array, "*b n"] | None = None,
) -> tuple[Int[Array, "*b {keep}"], Bool[Array, "*b {keep}"]]:
    """Non-maximum suppression from above: indices of the boxes kept, best score first, and which of them are any.

    Takes the best box, drops all that overlap it by more than `threshold`, takes the next; of equal scores the first.
    Only the `consider` best (all by default) take part. At most `keep` are kept, so that only keep x consider overlaps
    are computed. An index that is not valid is 0. A box that is not finite, or whose score is NaN, takes no part.
    """
    *batch, count, _ = boxes.shape
    if not boxes.size:
        return jnp.zeros((*batch, keep), jnp.int32), jnp.zeros((*batch, keep), bool)
    usable = jnp.isfinite(boxes).all(axis=-1) & ~jnp.isnan(score)
    usable = usable if valid is None else usable & valid
    if batch:
        inner = partial(nms_bev, keep=keep, consider=consider)
        flat = boxes.reshape(-1, count, 7), score.reshape(-1, count), usable.reshape(-1, count)
        index, kept = jax.vmap(lambda b, s, u: inner(b, s, threshold, valid=u))(*flat)
        return index.reshape(*batch, keep), kept.reshape(*batch, keep)
    considered = min(consider or count, count)
    order = jnp.argsort(jnp.where(usable, -score, jnp.full_like(score, jnp.inf)), stable=True)[:considered]
    rank = jnp.arange(considered, dtype=jnp.int32)
    sorted_boxes = boxes[order]

    def step(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        taken, alive, index, kept = state
        best = jnp.argmax(alive).astype(jnp.int32)
        overlap, _ = pair_overlap(jnp.broadcast_to(sorted_boxes[best], sorted_boxes.shape), sorted_boxes)
        return (
            taken + 1,
            alive & (overlap <= threshold) & (rank != best),
            index.at[taken].set(order[best].astype(jnp.int32)),
            kept.at[taken].set(True),
        )

    start = jnp.int32(0), usable[order], jnp.zeros(keep, jnp.int32), jnp.zeros(keep, bool)
    _, _, index, kept = jax.lax.while_loop(lambda state: (state[0] < keep) & state[1].any(), step, start)
    return index, kept


def lidar_boxes(boxes: Boxes, cam_from_velo: Float[Array, "4 4"]) -> Float[np.ndarray, "n 7"]:
    """Labels (KITTI's, in `cam`) as boxes in `velo`, float64 on the host: middle, heading = -(rotation_y + pi/2).

    `cam_from_velo` must be that of the labels: in KITTI's own files R0_rect Tr_velo_to_cam, without P2's fourth column.
    """
    velo_from_cam = np.linalg.inv(np.asarray(cam_from_velo, np.float64))
    size = np.asarray(boxes.size_m, np.float64).reshape(-1, 3)
    middle = np.asarray(boxes.centre_m, np.float64).reshape(-1, 3) @ velo_from_cam[:3, :3].T + velo_from_cam[:3, 3]
    middle[:, 2] += size[:, 2] / 2
    heading = -(np.asarray(boxes.yaw_rad, np.float64) + np.pi / 2)
    return np.concatenate([middle, size, wrapped_heading(heading)[:, None]], axis=1)


def camera_boxes(
    boxes: Float[Array, "n 7"], cam_from_velo: Float[Array, "4 4"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """The inverse of `lidar_boxes`: bottom middles in `cam`, sizes (l, w, h) and rotation_y."""
    boxes, cam_from_velo = np.asarray(boxes, np.float64), np.asarray(cam_from_velo, np.float64)
    bottom = boxes[:, :3] - np.array([0, 0, 0.5]) * boxes[:, 3:6]
    centre = bottom @ cam_from_velo[:3, :3].T + cam_from_velo[:3, 3]
    return centre, boxes[:, 3:6].copy(), wrapped_heading(-boxes[:, 6] - np.pi / 2)


def wrapped_heading(angle_rad: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
    """The same direction in [-pi, pi); an angle that lies there already is returned as it is."""
    turns = np.floor((angle_rad + np.pi) / (2 * np.pi))
    return np.where(turns == 0, angle_rad, angle_rad - 2 * np.pi * turns)
