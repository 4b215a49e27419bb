"""Who is matched with whom: labels of a frame choose in the order of its file, all frames and thresholds at once.

What a label would like best does not depend on the threshold: in the first pass the highest score, in the second
the largest overlap, and an ignored detection only where there is no other. So each label has a fixed list of
candidates, and takes the first that is still free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.metrics.detection.overlap import Pairs
from jaxsim.metrics.detection.rules import SLOTS


class Candidates(NamedTuple):
    """Pairs that overlap enough, sorted by label, each label's list in the order of its liking."""

    pair: Int[np.ndarray, " p"]
    """Index of the pair among those given."""
    truth: Int[np.ndarray, " p"]
    detection: Int[np.ndarray, " p"]
    turn: Int[np.ndarray, " p"]
    """How many labels of the frame that have candidates choose before."""
    place: Int[np.ndarray, " p"]
    """In the label's list."""


def candidates(
    pairs: Pairs,
    frame: Int[np.ndarray, " n"],
    *,
    rank: Int[np.ndarray, " p"],
    liking: Float[np.ndarray, " p"],
) -> Candidates:
    """Lists of candidates: lowest `rank` first, then highest `liking`, then the order of the detections' file."""
    order = np.lexsort((pairs.detection, -liking, rank, pairs.truth))
    label, detection = pairs.truth[order], pairs.detection[order]
    starts = np.flatnonzero(np.diff(label, prepend=-1))
    length = np.diff(starts, append=len(label))
    frames = frame[label[starts]]
    begins = np.flatnonzero(np.diff(frames, prepend=-1))
    turn = np.arange(len(starts)) - np.repeat(begins, np.diff(begins, append=len(starts)))
    place = np.arange(len(label)) - np.repeat(starts, length)
    return Candidates(order, label, detection, np.repeat(turn, length), place)


def assign(chosen: Candidates, score: Float[np.ndarray, " d"], at: Float[np.ndarray, " t"]) -> Bool[np.ndarray, "p t"]:
    """Which pairs come about among the detections whose `score` reaches each threshold `at`."""
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
    found = []
    for i, value in enumerate(ordered):
        left = (i + 1) / truths
        right = (i + 2) / truths if i < last else left
        if i < last and right - recall < recall - left:
            continue
        found.append(value)
        recall += 1 / (SLOTS - 1)
    return np.array(found, np.float64)
