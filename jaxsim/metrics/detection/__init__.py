"""KITTI's object evaluation: average precision of boxes in the image, from above and in space, and of orientation.

The official tool's rules (devkit_object, evaluate_object_3d_offline) by default, OpenPCDet's by option. Class by class,
thresholds come from a first matching, precision and recall from a second.

    matching.py  what counts, overlaps, and who is matched with whom        files.py    labels and results

Figures: TP matches in which both count; FP detections that count, are not matched, and (in the image) lie in no
DontCare region; FN labels that count and are not matched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.geometry.boxes import DIFFICULTIES
from jaxsim.metrics.detection.files import Objects, read_detections, read_truth
from jaxsim.metrics.detection.matching import (
    METRICS,
    OVERLAP_SETS,
    PRINTED_COLUMNS,
    SCORED,
    SLOTS,
    CandidateMatches,
    MatchingRules,
    assign,
    candidate_matches,
    candidates,
    detection_flags,
    dont_care,
    has_orientation,
    in_dont_care,
    overlaps,
    thresholds,
    truth_flags,
)

__all__ = [
    "DIFFICULTIES",
    "METRICS",
    "OVERLAP_SETS",
    "PRINTED_COLUMNS",
    "SCORED",
    "Curve",
    "MatchingRules",
    "Objects",
    "evaluate",
    "read_detections",
    "read_truth",
]


@dataclass(frozen=True)
class Curve:
    """Precision (or orientation similarity) over recall, for one class, difficulty, overlap and metric."""

    kind: str
    difficulty: str
    overlap_set: str
    metric: str
    """`bbox`, `bev`, `3d`, or `aos`: orientation on the matches in the image."""
    min_overlap: float
    precision: Float[np.ndarray, " 41"]
    """Precision at the 41 thresholds, the highest from there on; 0 where recall never came."""
    recall: Float[np.ndarray, " t"]
    """Recall at each threshold there is."""
    threshold: Float[np.ndarray, " t"]
    truths: int
    """Labels that count. With fewer than 41 of them not all slots fill: nine perfect cars score 20 (R40)."""
    detections: int
    """Detections of the class that count."""

    @property
    def ap_r40(self) -> float:
        """Average over recalls 1/40 .. 1, percent (since 2019); NaN where no label counts."""
        return 100 / 40 * float(self.precision[1:].sum()) if self.truths else float("nan")

    @property
    def ap_r11(self) -> float:
        """Average over recalls 0, 0.1 .. 1, percent (until 2019); NaN where no label counts."""
        return 100 / 11 * float(self.precision[::4].sum()) if self.truths else float("nan")


class _Frames(NamedTuple):
    """What does not depend on class, difficulty and metric."""

    truth: Objects
    detections: Objects
    possible: CandidateMatches
    overlap: dict[str, Float[np.ndarray, " p"]]
    dont_care: Float[np.ndarray, " n"]
    similarity: Float[np.ndarray, " p"]


def evaluate(
    truth: Objects,
    detections: Objects,
    *,
    rules: MatchingRules = "official",
    classes: Sequence[str] = tuple(SCORED),
    done: Callable[[], object] = lambda: None,
) -> list[Curve]:
    """Curves of every class, difficulty, overlap set and metric; `aos` where all detections have an alpha.

    `done` is called after each. Detections of frames without a label file must not be given. A class of which no
    label counts has truths = 0. The official tool scores only classes that some detection names; here such a class
    scores 0. Raises ValueError for frames that differ, an unknown class, and for occlusions that are no integers
    under the official rules: that tool reads %d there, and every later column would be another.
    """
    if truth.names != detections.names:
        raise ValueError(f"evaluate: {len(truth.names)} frames of labels, {len(detections.names)} others of detections")
    unknown = [kind for kind in classes if kind not in SCORED]
    if unknown:
        raise ValueError(f"evaluate: unknown class {unknown[0]!r}; known: {', '.join(SCORED)}")
    if rules == "official" and (broken := np.flatnonzero(truth.occluded != np.round(truth.occluded))).size:
        raise ValueError(
            f"evaluate: occluded is {truth.occluded[broken[0]]:g} in the label of {truth.names[truth.frame[broken[0]]]}"
            "; the official tool reads an integer there and would take every later column for another; export with "
            "integer levels, or score with --rules openpcdet"
        )
    regions = dont_care(truth, rules)
    possible = candidate_matches(truth, detections, ~regions)
    overlap = overlaps(truth, detections, possible)
    # A match needs an overlap above 0: those without any, which are most, can be forgotten.
    meet = np.max(list(overlap.values()), axis=0) > 0
    possible = possible.at(meet)
    overlap = {name: shared[meet] for name, shared in overlap.items()}
    alpha = truth.alpha_rad[possible.truth] - detections.alpha_rad[possible.detection]
    frames = _Frames(
        truth,
        detections,
        possible,
        overlap,
        dont_care=in_dont_care(truth, detections, candidate_matches(truth, detections, regions)),
        # Geiger et al. 2012: 1 for the same heading, 0 for the opposite one.
        similarity=(1 + np.cos(alpha)) / 2,
    )
    oriented = has_orientation(detections, rules)
    curves = []
    for kind in classes:
        for name, difficulty in DIFFICULTIES.items():
            flags = truth_flags(truth, kind, difficulty, rules=rules), detection_flags(detections, kind, difficulty)
            for k, metric in enumerate(METRICS):
                # Where both sets ask for the same overlap, one count serves both.
                known: dict[float, _Counted] = {}
                for overlap_set, least in OVERLAP_SETS.items():
                    minimum = least[kind][k]
                    if minimum not in known:
                        known[minimum] = _count(frames, flags, metric, minimum=minimum)
                    criterion = {"kind": kind, "difficulty": name, "overlap_set": overlap_set, "min_overlap": minimum}
                    for measure in (metric, "aos") if metric == "bbox" and oriented else (metric,):
                        curves.append(_curve(known[minimum], measure, **criterion))
                    done()
    return curves


class _Counted(NamedTuple):
    threshold: Float[np.ndarray, " t"]
    tp: Int[np.ndarray, " t"]
    fp: Int[np.ndarray, " t"]
    fn: Int[np.ndarray, " t"]
    similarity: Float[np.ndarray, " t"]
    truths: int
    detections: int


def _count(
    frames: _Frames, flags: tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]], metric: str, *, minimum: float
) -> _Counted:
    """Both passes of one class and difficulty, in one metric."""
    of_truth, of_detection = flags
    score = frames.detections.score
    truths, countable = int((of_truth == 0).sum()), of_detection == 0
    possible = frames.possible
    match = (
        (frames.overlap[metric] > minimum) & (of_truth[possible.truth] >= 0) & (of_detection[possible.detection] >= 0)
    )
    possible = possible.at(match)
    overlap, similarity = frames.overlap[metric][match], frames.similarity[match]
    matched = (of_truth[possible.truth] == 0) & countable[possible.detection]
    if not truths or not matched.any():
        none = np.zeros(0, int)
        return _Counted(np.zeros(0), none, none, none, np.zeros(0), truths, int(countable.sum()))

    # First pass: every label takes the highest score. The scores of what it finds become the thresholds.
    lists = candidates(possible, frames.truth.frame, rank=np.zeros(len(overlap), int), liking=score[possible.detection])
    takes = assign(lists, score, np.array([-np.inf]))[:, 0]
    counts = takes & (of_truth[lists.truth] == 0) & countable[lists.detection]
    at = thresholds(score[lists.detection[counts]], truths)

    # Second pass, at every threshold: the largest overlap; an ignored detection, the first, where there is no other.
    ignored = of_detection[possible.detection]
    lists = candidates(possible, frames.truth.frame, rank=ignored, liking=np.where(ignored == 0, overlap, 0.0))
    takes = assign(lists, score, at)
    counts = (of_truth[lists.truth] == 0) & countable[lists.detection]
    costs = countable & ~((frames.dont_care > minimum) if metric == "bbox" else np.zeros(len(score), bool))
    # Of sorted scores those from the threshold's place on reach it.
    reaching = costs.sum() - np.searchsorted(np.sort(score[costs]), at)
    return _Counted(
        at,
        tp=_sum(takes, counts),
        fp=reaching - _sum(takes, costs[lists.detection]),
        fn=truths - _sum(takes, of_truth[lists.truth] == 0),
        similarity=(takes & counts[:, None]).T.astype(float) @ similarity[lists.match],
        truths=truths,
        detections=int(countable.sum()),
    )


def _sum(takes: Bool[np.ndarray, "p t"], among: Bool[np.ndarray, " p"]) -> Int[np.ndarray, " t"]:
    return takes[among].sum(axis=0)


def _curve(
    counted: _Counted, metric: str, *, kind: str, difficulty: str, overlap_set: str, min_overlap: float
) -> Curve:
    good = counted.similarity if metric == "aos" else counted.tp.astype(float)
    claimed = counted.tp + counted.fp
    precision = np.zeros(SLOTS)
    # Where ignored labels take all that is left at a threshold, nothing is claimed: no precision to speak of.
    precision[: len(good)] = np.divide(good, claimed, out=np.zeros(len(good)), where=claimed > 0)
    return Curve(
        kind,
        difficulty,
        overlap_set,
        metric,
        min_overlap,
        # Interpolated: the best precision at this recall or a higher one.
        precision=np.maximum.accumulate(precision[::-1])[::-1],
        recall=counted.tp / np.maximum(counted.tp + counted.fn, 1),
        threshold=counted.threshold,
        truths=counted.truths,
        detections=counted.detections,
    )
