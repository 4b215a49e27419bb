"""How well classes are told apart, and what intensity is worth to who tells them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

INTENSITIES = ("none", "simulated", "measured")
"""Intensities that networks learn from, in the order of the table."""
Confusion = Int[np.ndarray, "classes classes"]
"""Cells by true class (rows) and told class (columns), of all that returned and have a label."""


def confusion(label: Int[np.ndarray, "*n"], told: Int[np.ndarray, "*n"], classes: int) -> Confusion:
    """Labelled cells (class above 0) by true and told class."""
    known = label > 0
    return np.bincount(classes * label[known] + told[known], minlength=classes**2).reshape(classes, classes)


def class_iou(cells: Confusion) -> Float[np.ndarray, " known"]:
    """Intersection over union of classes 1 on; NaN where a class is not there.

    What is told of a class that is not there counts against the others, which it was not told to be: as a 0 of its own
    it would change the number of classes that a mean is over from network to network.
    """
    there = cells.sum(1)[1:]
    hits = np.diag(cells)[1:].astype(float)
    return np.where(there > 0, hits / np.maximum(cells.sum(0)[1:] + there - hits, 1), np.nan)


def mean_iou(iou: Float[np.ndarray, "seeds known"]) -> float:
    """Over the classes that are there, then over seeds."""
    return float(np.nanmean(iou, axis=1).mean())


def worth(iou: Mapping[str, Float[np.ndarray, "seeds known"]]) -> float:
    """What simulated intensity gains over none, as a share of what measured intensity does; NaN where that is
    nothing."""
    mean = {kind: mean_iou(iou[kind]) for kind in INTENSITIES}
    room = mean["measured"] - mean["none"]
    return (mean["simulated"] - mean["none"]) / room if room > 0 else float("nan")
