"""Which labelled object and which detection of a frame overlap, and how much."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.geometry.boxes import pair_overlap
from jaxsim.metrics.detection.files import Objects

_LEAST_PAIRS = 1024
_MOST_PAIRS = 1 << 18


class Pairs(NamedTuple):
    """Objects of one frame, a label and a detection each; sorted by label, then by detection."""

    truth: Int[np.ndarray, " p"]
    detection: Int[np.ndarray, " p"]


def pairs_of(truth: Objects, detections: Objects, among: Bool[np.ndarray, " n"]) -> Pairs:
    """All pairs of a label `among` the labels with a detection of its frame."""
    first = np.searchsorted(detections.frame, truth.frame, side="left")
    stop = np.searchsorted(detections.frame, truth.frame, side="right")
    count = np.where(among, stop - first, 0)
    label = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(label)) - np.repeat(np.cumsum(count) - count, count)
    return Pairs(label, first[label] + place)


def bbox_shared(a: Float[np.ndarray, "p 4"], b: Float[np.ndarray, "p 4"]) -> Float[np.ndarray, " p"]:
    """Area in square pixels that rectangles share, pair by pair."""
    side = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    return np.where((side > 0).all(axis=1), side[:, 0] * side[:, 1], 0.0)


def bbox_area(boxes: Float[np.ndarray, "p 4"]) -> Float[np.ndarray, " p"]:
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])


def _parts(part: Float[np.ndarray, " p"], whole: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def overlaps(truth: Objects, detections: Objects, pairs: Pairs) -> dict[str, Float[np.ndarray, " p"]]:
    """Intersection over union of each pair: in the image (`bbox`), from above (`bev`), in space (`3d`)."""
    a, b = truth.bbox_px[pairs.truth], detections.bbox_px[pairs.detection]
    shared = bbox_shared(a, b)
    bev, volume = np.zeros(len(shared)), np.zeros(len(shared))
    offset = (truth.centre_m[pairs.truth] - detections.centre_m[pairs.detection])[:, [0, 2]]
    reach = _half_diagonal(truth)[pairs.truth] + _half_diagonal(detections)[pairs.detection]
    near = np.flatnonzero(np.hypot(*offset.T) < reach)
    for some in np.array_split(near, max(-(-len(near) // _MOST_PAIRS), 1)):
        bev[some], volume[some] = _turned(truth, detections, Pairs(*(side[some] for side in pairs)))
    return {"bbox": _parts(shared, bbox_area(a) + bbox_area(b) - shared), "bev": bev, "3d": volume}


def in_dont_care(truth: Objects, detections: Objects, pairs: Pairs) -> Float[np.ndarray, " n"]:
    """Largest part of each detection's box in the image that lies in one of the regions of `pairs`."""
    boxes = detections.bbox_px[pairs.detection]
    part = _parts(bbox_shared(truth.bbox_px[pairs.truth], boxes), bbox_area(boxes))
    largest = np.zeros(len(detections.frame))
    np.maximum.at(largest, pairs.detection, part)
    return largest


def _half_diagonal(objects: Objects) -> Float[np.ndarray, " n"]:
    return np.hypot(objects.size_m[:, 0], objects.size_m[:, 1]) / 2


def _turned(
    truth: Objects, detections: Objects, pairs: Pairs
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Overlaps of boxes that turn about the camera's y, relative to the detection: float32 holds offsets, not places.

    Seen along y, x is right and z is forward, and rotation_y turns clockwise.
    """
    count = len(pairs.truth)
    room = max(_LEAST_PAIRS, 1 << (count - 1).bit_length() if count else 0)
    boxes = np.zeros((2, room, 7), np.float32)
    for k, (objects, index) in enumerate(((truth, pairs.truth), (detections, pairs.detection))):
        middle = objects.centre_m[index] - np.array([0, 0.5, 0]) * objects.size_m[index][:, [2, 2, 2]]
        other = detections.centre_m[pairs.detection]
        boxes[k, :count, :3] = (middle - other)[:, [0, 2, 1]]
        boxes[k, :count, 3:6] = objects.size_m[index]
        boxes[k, :count, 6] = -objects.yaw_rad[index]
    bev, volume = (np.asarray(part, np.float64)[:count] for part in pair_overlap(*map(jnp.asarray, boxes)))
    return bev, volume
