"""Denoisers of the measured intensity, behind one function.

A cell without return has no intensity; it is not a black one. So the gaps are closed from their surroundings
before a filter sees the raster, and opened again afterwards.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.prepare.denoise.non_local_means import non_local_means

Array = np.ndarray

METHODS = {"none": lambda intensity: intensity, "non_local_means": non_local_means}

__all__ = ["METHODS", "denoise", "non_local_means"]


def denoise(
    intensity: Float[Array, "rows columns"], valid: Bool[Array, "rows columns"], method: str = "none"
) -> Float[Array, "rows columns"]:
    """Intensity (0..1) without the sensor's noise where `valid`; 0 elsewhere.

    Raises ValueError for an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"denoise: no method {method!r}; known: {', '.join(METHODS)}")
    filled = _close_gaps(intensity.astype(np.float32), valid)
    return np.where(valid, METHODS[method](filled), np.float32(0))


def _close_gaps(intensity: Array, valid: Array) -> Array:
    """Cells that are not valid take the value of the nearest valid one."""
    if valid.all() or not valid.any():
        return intensity
    _, label = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = label.astype(np.int64)
    value_of = np.zeros(label.max() + 1, np.float32)
    value_of[label[valid]] = intensity[valid]
    return value_of[label]
