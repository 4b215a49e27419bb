"""Denoisers of the measured intensity, behind one function.

A cell without return has no intensity; it is not a black one. So the gaps are closed from their surroundings
before a filter sees the raster, and opened again afterwards.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.geometry.rasters import close_gaps
from jaxsim.prepare.denoise.lidia import open_lidia

_SCALE = 10_000  # integer steps of intensity: finer than the sensor's 1/100, so filtering adds no steps


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


METHODS = {"none": lambda intensity: intensity, "non_local_means": non_local_means}
"""Filters that need no weights; `lidia` does."""


def denoise(
    intensity: Float[np.ndarray, "rows columns"],
    valid: Bool[np.ndarray, "rows columns"],
    method: str = "none",
    *,
    weights: Path | None = None,
    statistics: Literal["stored", "image"] = "image",
    gain: float = 1.0,
) -> Float[np.ndarray, "rows columns"]:
    """Intensity (0..1) without the sensor's noise where `valid`; 0 elsewhere.

    `lidia` takes `weights` that `jaxsim convert lidia` wrote, and `statistics` of its batch norms: those stored with
    them, or each image's own. It sees `gain` times the contrast.

    Raises ValueError for an unknown method; for `lidia` also without weights, where no cell is valid, and for images of
    fewer than 11 rows or columns.
    """
    if method == "lidia":
        return open_lidia(weights)(intensity, valid, statistics=statistics, gain=gain)
    if method not in METHODS:
        raise ValueError(f"denoise: no method {method!r}; known: {', '.join([*METHODS, 'lidia'])}")
    return np.where(valid, METHODS[method](close_gaps(intensity, valid)), np.float32(0))
