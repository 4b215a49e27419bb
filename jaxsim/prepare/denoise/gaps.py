"""Cells without return, closed from their surroundings before a filter sees them."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

Array = np.ndarray


def close_gaps(
    intensity: Float[Array, "rows columns"], valid: Bool[Array, "rows columns"]
) -> Float[Array, "rows columns"]:
    """Cells that are not valid take the value of the nearest valid one, whatever stood there; 0 where none is."""
    intensity = intensity.astype(np.float32)
    if valid.all():
        return intensity
    if not valid.any():
        return np.zeros_like(intensity)
    _, label = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = label.astype(np.int64)
    value_of = np.zeros(label.max() + 1, np.float32)
    value_of[label[valid]] = intensity[valid]
    return value_of[label]
