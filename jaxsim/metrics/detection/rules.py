"""What counts: classes, difficulties, overlaps, and where the official tool and OpenPCDet differ.

Flags: 0 counts, 1 is ignored (may match, is neither found nor missed), -1 takes no part.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxsim.metrics.detection.files import Objects

Rules = Literal["official", "openpcdet"]
METRICS = ("bbox", "bev", "3d")
# Recalls 0, 1/40, ..., 1: N_SAMPLE_PTS of the devkit.
SLOTS = 41


class Difficulty(NamedTuple):
    """Least height of the box in the image, and the most that a labelled object may be hidden."""

    height_px: float
    occluded: int
    truncated: float


DIFFICULTIES = {
    # MIN_HEIGHT, MAX_OCCLUSION and MAX_TRUNCATION of the devkit.
    "easy": Difficulty(40, 0, 0.15),
    "moderate": Difficulty(25, 1, 0.30),
    "hard": Difficulty(25, 2, 0.50),
}

CLASSES = {"Car": "Van", "Pedestrian": "Person_sitting", "Cyclist": None}
"""Each class, and the one that a detector may take for it at no cost."""

OVERLAP_SETS: dict[str, dict[str, tuple[float, float, float]]] = {
    "0.7": {"Car": (0.7, 0.7, 0.7), "Pedestrian": (0.5, 0.5, 0.5), "Cyclist": (0.5, 0.5, 0.5)},
    "0.5": {"Car": (0.7, 0.5, 0.5), "Pedestrian": (0.5, 0.25, 0.25), "Cyclist": (0.5, 0.25, 0.25)},
}
"""Overlap that a match must exceed, for METRICS; sets are named after Car's. In the image it is the same in both."""

COLUMNS = (("3d", "0.7"), ("bev", "0.7"), ("3d", "0.5"), ("bev", "0.5"), ("bbox", "0.7"), ("aos", "0.7"))
"""Metric and overlap set of the columns that papers print."""


def truth_flags(truth: Objects, kind: str, difficulty: Difficulty, *, rules: Rules) -> Int[np.ndarray, " n"]:
    """Flags of labelled objects. A height of exactly the limit counts in the official tool, not in OpenPCDet."""
    names, neighbour = truth.lower_kind, CLASSES[kind]
    height = truth.bbox_px[:, 3] - truth.bbox_px[:, 1]
    low = height < difficulty.height_px if rules == "official" else height <= difficulty.height_px
    hidden = (truth.occluded > difficulty.occluded) | (truth.truncated > difficulty.truncated) | low
    own = names == kind.lower()
    beside = names == neighbour.lower() if neighbour else np.zeros(len(names), bool)
    return np.where(own & ~hidden, 0, np.where(own | beside, 1, -1))


def detection_flags(detections: Objects, kind: str, difficulty: Difficulty) -> Int[np.ndarray, " n"]:
    """Flags of detections. One below the height limit is ignored *whatever its class*: both tools ask that first."""
    low = np.abs(detections.bbox_px[:, 3] - detections.bbox_px[:, 1]) < difficulty.height_px
    return np.where(low, 1, np.where(detections.lower_kind == kind.lower(), 0, -1))


def dont_care(truth: Objects, rules: Rules) -> Bool[np.ndarray, " n"]:
    """Regions in the image where detections cost nothing. The official tool reads the name in any case."""
    return truth.lower_kind == "dontcare" if rules == "official" else truth.kind == "DontCare"


def has_orientation(detections: Objects, rules: Rules) -> bool:
    """Whether orientation is scored: -10 stands for an unknown alpha.

    One such detection ends it in the official tool; OpenPCDet looks at the first of all detections alone.
    """
    alpha = detections.alpha_rad if rules == "official" else detections.alpha_rad[:1]
    return len(alpha) > 0 and not bool((alpha == -10).any())
