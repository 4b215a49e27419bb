"""Which proposals the second stage learns from, and what (OpenPCDet's ProposalTargetLayer and RoIHeadTemplate).

A batch has r proposals a sample, of which those that fill up the list are all 0.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.config import RoiConfig
from jaxsim.frame import Array
from jaxsim.geometry.boxes import iou_3d


@struct.dataclass
class RoiTargets:
    """The proposals of a training step and what each learns."""

    rois: Array
    """(b, s, 7)."""
    boxes: Array
    """(b, s, 7): the object that a proposal overlaps most; 0 where there is none."""
    canonical: Array
    """(b, s, 7): that object seen from the proposal, its heading within a quarter turn."""
    score: Array
    """(b, s): score to learn, 0..1."""
    foreground: Array
    """bool (b, s): its box is regressed."""


def best_objects(
    rois: Float[Array, "r 7"], boxes: Float[Array, "g 7"], valid: Bool[Array, " g"]
) -> tuple[Float[Array, " r"], Int[Array, " r"]]:
    """Each proposal's largest 3D overlap with an object, and which one."""
    overlap = jnp.where(valid[None], iou_3d(rois, boxes), 0)
    return overlap.max(axis=1), overlap.argmax(axis=1).astype(jnp.int32)


def sample_rois(overlap: Float[Array, " r"], key: Array, config: RoiConfig) -> Int[Array, " s"]:
    """Numbers of the proposals to learn from: foreground at random without repeats, then hard, then easy background.

    Background is drawn with repeats, and so is foreground where there is no background.
    """
    count, r = config.rois, len(overlap)
    keys = jax.random.split(key, 4)
    # Good enough for either loss, as published: for the box's, or for a full score.
    foreground = overlap >= min(config.matched, config.score_range[1])
    easy = overlap < config.easy
    hard = (overlap < config.matched) & ~easy
    n_fore = foreground.sum(dtype=jnp.int32)
    n_hard = hard.sum(dtype=jnp.int32)
    n_easy = easy.sum(dtype=jnp.int32)

    with_background = n_hard + n_easy > 0
    share = min(round(config.foreground * count), count)
    # Foreground up to its share, background fills up, and of that `hard_share` is hard; where a kind is missing the
    # others take its part.
    fore = jnp.where(with_background, jnp.minimum(share, n_fore), jnp.where(n_fore > 0, count, 0))
    background = count - fore
    hard_share = jnp.minimum((background.astype(overlap.dtype) * config.hard_share).astype(jnp.int32), n_hard)
    from_hard = jnp.where(n_easy == 0, background, jnp.where(n_hard == 0, 0, hard_share))

    place = jnp.arange(count, dtype=jnp.int32)
    # Chances are below 1, so that the foreground, in random order, sorts before all others.
    once = jnp.argsort(jnp.where(foreground, jax.random.uniform(keys[0], (r,)), 2.0)).astype(jnp.int32)
    again = _draw(foreground, keys[1], count)
    first = jnp.where(with_background, once[jnp.minimum(place, r - 1)], again)
    rest = jnp.where(place < fore + from_hard, _draw(hard, keys[2], count), _draw(easy, keys[3], count))
    return jnp.where(place < fore, first, rest)


def _draw(mask: Bool[Array, " r"], key: Array, count: int) -> Int[Array, " s"]:
    """Places where the mask holds, drawn with repeats."""
    # The places where the mask holds come first; where it holds nowhere, what is drawn is not used.
    where = jnp.argsort(~mask, stable=True).astype(jnp.int32)
    return where[jax.random.randint(key, (count,), 0, jnp.maximum(mask.sum(dtype=jnp.int32), 1))]


def assign_rois(
    rois: Float[Array, "b r 7"],
    boxes: Float[Array, "b g 7"],
    valid: Bool[Array, "b g"],
    *,
    key: Array,
    config: RoiConfig,
) -> RoiTargets:
    """Draws the proposals of a step and says what they learn."""

    def of_sample(rois: Array, objects: tuple[Array, Array], key: Array) -> RoiTargets:
        boxes, valid = objects
        overlap, mine = best_objects(rois, boxes, valid)
        chosen = sample_rois(overlap, key, config)
        of_roi = jnp.where(valid.any(), boxes[mine], 0)
        return targets_of(rois[chosen], of_roi[chosen], overlap[chosen], config=config)

    return jax.vmap(of_sample)(rois, (boxes, valid), jax.random.split(key, len(rois)))


def targets_of(
    rois: Float[Array, "*b s 7"], boxes: Float[Array, "*b s 7"], overlap: Float[Array, "*b s"], *, config: RoiConfig
) -> RoiTargets:
    """What chosen proposals learn of their objects."""
    low, high = config.score_range
    return RoiTargets(
        rois=rois,
        boxes=boxes,
        canonical=seen_from_roi(boxes, rois),
        score=jnp.clip((overlap - low) / (high - low), 0, 1),
        foreground=overlap > config.matched,
    )


def seen_from_roi(boxes: Float[Array, "*b s 7"], rois: Float[Array, "*b s 7"]) -> Float[Array, "*b s 7"]:
    """Boxes in the frame of their proposals; a heading the other way round is turned about."""
    turn = rois[..., 6] % (2 * jnp.pi)
    centre = turned(boxes[..., :3] - rois[..., :3], -turn)
    heading = (boxes[..., 6] - turn) % (2 * jnp.pi)
    # Which end is the front is told by the first stage's direction alone.
    about = (heading > jnp.pi / 2) & (heading < 3 * jnp.pi / 2)
    heading = jnp.where(about, (heading + jnp.pi) % (2 * jnp.pi), heading)
    heading = jnp.where(heading > jnp.pi, heading - 2 * jnp.pi, heading)
    heading = jnp.clip(heading, -jnp.pi / 2, jnp.pi / 2)
    return jnp.concatenate([centre, boxes[..., 3:6], heading[..., None]], axis=-1)


def from_roi(boxes: Float[Array, "*b s 7"], rois: Float[Array, "*b s 7"]) -> Float[Array, "*b s 7"]:
    """Boxes in the frames of their proposals back in `velo`: middles turned and moved, headings added."""
    centre = turned(boxes[..., :3], rois[..., 6]) + rois[..., :3]
    return jnp.concatenate([centre, boxes[..., 3:6], boxes[..., 6:] + rois[..., 6:]], axis=-1)


def turned(xyz: Float[Array, "*b 3"], angle_rad: Float[Array, "*b"]) -> Float[Array, "*b 3"]:
    """Points turned counter-clockwise about z."""
    cos, sin = jnp.cos(angle_rad), jnp.sin(angle_rad)
    x, y = xyz[..., 0], xyz[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y, xyz[..., 2]], axis=-1)
