"""How much labelled and detected objects of a frame overlap, and who is matched with whom: labels of a frame choose in
the order of its file, all frames and thresholds at once.

What a label would like best does not depend on the threshold: in the first pass the highest score, in the second
the largest overlap, and an ignored detection only where there is no other. So each label has a fixed list of
candidates, and takes the first that is still free.

Flags: 0 counts, 1 is ignored (may match, is neither found nor missed), -1 takes no part. Classes, difficulties and
overlaps stand here too, and where the official tool and OpenPCDet differ.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jaxsim.geometry.boxes import Difficulty, pair_overlap
from jaxsim.metrics.detection.files import Objects

MatchingRules = Literal["official", "openpcdet"]
METRICS = ("bbox", "bev", "3d")
# Recalls 0, 1/40, ..., 1: N_SAMPLE_PTS of the devkit.
SLOTS = 41
# Pairs of boxes clipped at once: fewer are filled up, more are cut, so that few sizes are compiled and memory is
# bounded.
_LEAST_PAIRS = 1024
_MOST_PAIRS = 1 << 18


SCORED = {"Car": "Van", "Pedestrian": "Person_sitting", "Cyclist": None}
"""Each class, and the one that a detector may take for it at no cost."""

OVERLAP_SETS: dict[str, dict[str, tuple[float, float, float]]] = {
    "0.7": {"Car": (0.7, 0.7, 0.7), "Pedestrian": (0.5, 0.5, 0.5), "Cyclist": (0.5, 0.5, 0.5)},
    "0.5": {"Car": (0.7, 0.5, 0.5), "Pedestrian": (0.5, 0.25, 0.25), "Cyclist": (0.5, 0.25, 0.25)},
}
"""Overlap that a match must exceed, for METRICS; sets are named after Car's. In the image it is the same in both."""

PRINTED_COLUMNS = (("3d", "0.7"), ("bev", "0.7"), ("3d", "0.5"), ("bev", "0.5"), ("bbox", "0.7"), ("aos", "0.7"))
"""Metric and overlap set of the columns that papers print."""


def truth_flags(truth: Objects, kind: str, difficulty: Difficulty, *, rules: MatchingRules) -> Int[np.ndarray, " n"]:
    """Flags of labelled objects. A height of exactly the limit counts in the official tool, not in OpenPCDet."""
    names, neighbour = truth.lower_kind, SCORED[kind]
    height = truth.bbox_px[:, 3] - truth.bbox_px[:, 1]
    low = height < difficulty.height_px if rules == "official" else height <= difficulty.height_px
    hidden = (truth.occluded > difficulty.occluded) | (truth.truncated > difficulty.truncated) | low
    of_class = names == kind.lower()
    of_neighbour = names == neighbour.lower() if neighbour else np.zeros(len(names), bool)
    return np.where(of_class & ~hidden, 0, np.where(of_class | of_neighbour, 1, -1))


def detection_flags(detections: Objects, kind: str, difficulty: Difficulty) -> Int[np.ndarray, " n"]:
    """Flags of detections. One below the height limit is ignored *whatever its class*: both tools ask that first."""
    low = np.abs(detections.bbox_px[:, 3] - detections.bbox_px[:, 1]) < difficulty.height_px
    return np.where(low, 1, np.where(detections.lower_kind == kind.lower(), 0, -1))


def dont_care(truth: Objects, rules: MatchingRules) -> Bool[np.ndarray, " n"]:
    """Regions in the image where detections cost nothing. The official tool reads the name in any case."""
    return truth.lower_kind == "dontcare" if rules == "official" else truth.kind == "DontCare"


def has_orientation(detections: Objects, rules: MatchingRules) -> bool:
    """Whether orientation is scored: -10 stands for an unknown alpha.

    One such detection ends it in the official tool; OpenPCDet looks at the first of all detections alone.
    """
    alpha = detections.alpha_rad if rules == "official" else detections.alpha_rad[:1]
    return len(alpha) > 0 and not bool((alpha == -10).any())


class CandidateMatches(NamedTuple):
    """Objects of one frame, a label and a detection each; sorted by label, then by detection."""

    truth: Int[np.ndarray, " p"]
    detection: Int[np.ndarray, " p"]

    def at(self, chosen: Shaped[np.ndarray, " k"]) -> CandidateMatches:
        """The candidates of these places, or of this mask."""
        return CandidateMatches(self.truth[chosen], self.detection[chosen])


def candidate_matches(truth: Objects, detections: Objects, among: Bool[np.ndarray, " n"]) -> CandidateMatches:
    """Each label `among` the labels with each detection of its frame."""
    first = np.searchsorted(detections.frame, truth.frame, side="left")
    stop = np.searchsorted(detections.frame, truth.frame, side="right")
    count = np.where(among, stop - first, 0)
    label = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(label)) - np.repeat(np.cumsum(count) - count, count)
    return CandidateMatches(label, first[label] + within)


def _bbox_shared(a: Float[np.ndarray, "p 4"], b: Float[np.ndarray, "p 4"]) -> Float[np.ndarray, " p"]:
    """Area in square pixels that rectangles share, match by match."""
    side = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    return np.where((side > 0).all(axis=1), side[:, 0] * side[:, 1], 0.0)


def _bbox_area(boxes: Float[np.ndarray, "p 4"]) -> Float[np.ndarray, " p"]:
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])


def _parts(part: Float[np.ndarray, " p"], whole: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def overlaps(truth: Objects, detections: Objects, possible: CandidateMatches) -> dict[str, Float[np.ndarray, " p"]]:
    """Intersection over union of each match: in the image (`bbox`), from above (`bev`), in space (`3d`)."""
    a, b = truth.bbox_px[possible.truth], detections.bbox_px[possible.detection]
    shared = _bbox_shared(a, b)
    bev, volume = np.zeros(len(shared)), np.zeros(len(shared))
    offset = (truth.centre_m[possible.truth] - detections.centre_m[possible.detection])[:, [0, 2]]
    reach = _half_diagonal(truth)[possible.truth] + _half_diagonal(detections)[possible.detection]
    # Boxes farther apart than both half diagonals share nothing: few are left to clip.
    near = np.flatnonzero(np.hypot(*offset.T) < reach)
    for some in np.array_split(near, max(-(-len(near) // _MOST_PAIRS), 1)):
        bev[some], volume[some] = _turned(truth, detections, possible.at(some))
    return {"bbox": _parts(shared, _bbox_area(a) + _bbox_area(b) - shared), "bev": bev, "3d": volume}


def in_dont_care(truth: Objects, detections: Objects, possible: CandidateMatches) -> Float[np.ndarray, " n"]:
    """Largest part of each detection's box in the image that lies in one of the regions of `possible`."""
    boxes = detections.bbox_px[possible.detection]
    part = _parts(_bbox_shared(truth.bbox_px[possible.truth], boxes), _bbox_area(boxes))
    largest = np.zeros(len(detections.frame))
    np.maximum.at(largest, possible.detection, part)
    return largest


def _half_diagonal(objects: Objects) -> Float[np.ndarray, " n"]:
    return np.hypot(objects.size_m[:, 0], objects.size_m[:, 1]) / 2


def _turned(
    truth: Objects, detections: Objects, possible: CandidateMatches
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Overlaps of boxes that turn about the camera's y, relative to the detection: float32 holds offsets, not places.

    Seen along y, x is right and z is forward, and rotation_y turns clockwise.
    """
    count = len(possible.truth)
    # Filled up to powers of two: each size is compiled once.
    room = max(_LEAST_PAIRS, 1 << (count - 1).bit_length() if count else 0)
    boxes = np.zeros((2, room, 7), np.float32)
    for k, (objects, index) in enumerate(((truth, possible.truth), (detections, possible.detection))):
        # The camera's y points down: a box's middle lies half a height above its bottom face.
        middle = objects.centre_m[index] - np.array([0, 0.5, 0]) * objects.size_m[index][:, [2, 2, 2]]
        other = detections.centre_m[possible.detection]
        # Right and forward span the plane; y, the height, comes third.
        boxes[k, :count, :3] = (middle - other)[:, [0, 2, 1]]
        boxes[k, :count, 3:6] = objects.size_m[index]
        boxes[k, :count, 6] = -objects.yaw_rad[index]
    bev, volume = pair_overlap(boxes[0], boxes[1])
    return np.asarray(bev, np.float64)[:count], np.asarray(volume, np.float64)[:count]


class Candidates(NamedTuple):
    """Matches that overlap enough, sorted by label, each label's list in the order of its liking."""

    match: Int[np.ndarray, " p"]
    """Index among the matches given."""
    truth: Int[np.ndarray, " p"]
    detection: Int[np.ndarray, " p"]
    turn: Int[np.ndarray, " p"]
    """How many labels of the frame that have candidates choose before."""
    place: Int[np.ndarray, " p"]
    """Position in the label's list."""


def candidates(
    possible: CandidateMatches,
    frame: Int[np.ndarray, " n"],
    *,
    rank: Int[np.ndarray, " p"],
    liking: Float[np.ndarray, " p"],
) -> Candidates:
    """Lists of candidates: lowest `rank` first, then highest `liking`, then the order of the detections' file."""
    order = np.lexsort((possible.detection, -liking, rank, possible.truth))
    label, detection = possible.truth[order], possible.detection[order]
    starts = np.flatnonzero(np.diff(label, prepend=-1))
    length = np.diff(starts, append=len(label))
    frames = frame[label[starts]]
    # Labels stand frame by frame: a label's turn counts from its frame's first.
    begins = np.flatnonzero(np.diff(frames, prepend=-1))
    turn = np.arange(len(starts)) - np.repeat(begins, np.diff(begins, append=len(starts)))
    within = np.arange(len(label)) - np.repeat(starts, length)
    return Candidates(order, label, detection, np.repeat(turn, length), within)


def assign(chosen: Candidates, score: Float[np.ndarray, " d"], at: Float[np.ndarray, " t"]) -> Bool[np.ndarray, "p t"]:
    """Which matches come about among the detections whose `score` reaches each threshold `at`."""
    _, label = np.unique(chosen.truth, return_inverse=True)
    used, detection = np.unique(chosen.detection, return_inverse=True)
    free = score[used, None] >= at
    open_ = np.ones((label.max(initial=-1) + 1, free.shape[1]), bool)
    takes = np.zeros((len(label), free.shape[1]), bool)
    order = np.lexsort((chosen.place, chosen.turn))
    steps = np.stack([chosen.turn[order], chosen.place[order]], axis=1)
    borders = np.flatnonzero((np.diff(steps, axis=0, prepend=-1) != 0).any(axis=1))
    # Labels of one turn stand in different frames: none of them wants another's detection.
    for some in np.split(order, borders[1:]):
        take = free[detection[some]] & open_[label[some]]
        free[detection[some]] &= ~take
        open_[label[some]] &= ~take
        takes[some] = take
    return takes


def thresholds(score: Float[np.ndarray, " p"], truths: int) -> Float[np.ndarray, " t"]:
    """Scores at which recall passes 0, 1/40, ..., 1 most nearly (getThresholds): at most 41, fewer with few objects."""
    ordered = np.sort(score)[::-1].tolist()
    last = len(ordered) - 1
    recall = 0.0
    scores = []
    for i, value in enumerate(ordered):
        next_recall = (i + 1) / truths
        right = (i + 2) / truths if i < last else next_recall
        # Take this score only if the next one's recall is not nearer to the wanted one.
        if i < last and right - recall < recall - next_recall:
            continue
        scores.append(value)
        # Added up, as the devkit does: its rounding decides which scores are taken.
        recall += 1 / (SLOTS - 1)
    return np.array(scores, np.float64)
