"""Non-local means (Buades, Coll, Morel, CVPR 2005), as OpenCV has it."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

Array = np.ndarray

_SCALE = 10_000  # integer steps of intensity: finer than the sensor's 1/100, so filtering adds no steps


def non_local_means(intensity: Float[Array, "rows columns"], *, strength: float = 0.1) -> Float[Array, "rows columns"]:
    """Each cell becomes the mean of cells in the 21 x 21 around it whose 7 x 7 neighbourhoods look alike.

    `strength` is the mean difference in intensity up to which two neighbourhoods count as alike.
    """
    integer = np.round(np.clip(intensity, 0, 1) * _SCALE).astype(np.uint16)
    smooth = cv2.fastNlMeansDenoising(
        integer, [strength * _SCALE], templateWindowSize=7, searchWindowSize=21, normType=cv2.NORM_L1
    )
    return smooth.astype(np.float32) / np.float32(_SCALE)
