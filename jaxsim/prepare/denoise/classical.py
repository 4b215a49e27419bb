"""Intensity rasters by classical filters, on OpenCV: their gaps closed, and non-local means."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.geometry.rasters import nearest_known

_SCALE = 10_000  # integer steps of intensity: finer than the sensor's 1/100, so filtering adds no steps


def close_gaps(
    intensity: Float[np.ndarray, "rows columns"], valid: Bool[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Cells that are not valid take the value of the nearest valid one, whatever stood there; 0 where none is."""
    intensity = intensity.astype(np.float32)
    if valid.all():
        return intensity
    if not valid.any():
        return np.zeros_like(intensity)
    return intensity.ravel()[nearest_known(valid)[1]]


def non_local_means(
    intensity: Float[np.ndarray, "rows columns"], *, strength: float = 0.1
) -> Float[np.ndarray, "rows columns"]:
    """Each cell becomes the mean of cells in the 21 x 21 around it whose 7 x 7 neighbourhoods look alike (Buades, Coll,
    Morel: A Non-Local Algorithm for Image Denoising, CVPR 2005).

    `strength` is the mean difference in intensity up to which two neighbourhoods count as alike.
    """
    integer = np.round(np.clip(intensity, 0, 1) * _SCALE).astype(np.uint16)
    smooth = cv2.fastNlMeansDenoising(
        integer, [strength * _SCALE], templateWindowSize=7, searchWindowSize=21, normType=cv2.NORM_L1
    )
    return smooth.astype(np.float32) / np.float32(_SCALE)
