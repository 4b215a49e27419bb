"""Depth completion by classical image processing (Ku, Harakeh, Waslander: In Defense of Classical Image
Processing, CRV 2018), on OpenCV.

Everything happens on inverted depth, `100 - depth`, where empty pixels are 0: dilation then lets the near
surface grow over the far one, as an occluding edge does. Empty pixels travel as 0 within this file alone, so depths
of 99.9 m and more would count as empty, as published: where a sensor sees as far, depths are inverted about a little
more than the deepest.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float

Blur = Literal["bilateral", "gaussian"]

_INVERT_M = 100.0
_BEYOND = 1.01  # of the deepest, where that is beyond what is published
_EMPTY_M = 0.1  # less than this is no depth, inverted or not
_NEAR_M, _MEDIUM_M = 15.0, 30.0


def _full(size: int) -> np.ndarray:
    return np.ones((size, size), np.uint8)


def _cross(size: int) -> np.ndarray:
    kernel = np.zeros((size, size), np.uint8)
    kernel[size // 2, :] = kernel[:, size // 2] = 1
    return kernel


def _diamond(size: int) -> np.ndarray:
    offset = np.abs(np.arange(size) - size // 2)
    return (offset[:, None] + offset[None, :] <= size // 2).astype(np.uint8)


def fill_in_fast(
    depth_m: Float[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"],
    *,
    extrapolate: bool = False,
    blur: Blur = "bilateral",
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The quick form: points grow by the same number of pixels at every distance.

    `extrapolate` carries each column's topmost depth up to the image's border and fills what is left.
    """
    about_m = _about(depth_m, valid)
    d = _inverted(depth_m, valid, about_m)
    # Grow each point, close the small holes, then fill what is still empty from farther around.
    d = cv2.dilate(d, _diamond(5))
    d = cv2.morphologyEx(d, cv2.MORPH_CLOSE, _full(5))
    d = _fill_empty(d, 7)
    if extrapolate:
        d = _extend_up(d)
        d = _fill_empty(d, 31)
    # The median takes outliers away, the second blur makes planes smooth; the bilateral one keeps edges.
    d = cv2.medianBlur(d, 5)
    if blur == "bilateral":
        d = cv2.bilateralFilter(d, 5, 1.5, 2.0)
    else:
        d = np.where(d > _EMPTY_M, cv2.GaussianBlur(d, (5, 5), 0), d)
    return _upright(d, about_m)


def fill_in_multiscale(
    depth_m: Float[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"],
    *,
    extrapolate: bool = False,
    blur: Blur = "bilateral",
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Near points grow by more pixels than far ones; less noise than `fill_in_fast`, slower."""
    about_m = _about(depth_m, valid)
    sparse = _inverted(depth_m, valid, about_m)
    near = valid & (depth_m <= _NEAR_M)
    medium = valid & (depth_m > _NEAR_M) & (depth_m <= _MEDIUM_M)
    far = valid & (depth_m > _MEDIUM_M)

    d = sparse
    for band, size in ((far, 3), (medium, 5), (near, 7)):  # nearer bands overwrite
        grown = cv2.dilate(np.where(band, sparse, np.float32(0)), _cross(size))
        d = np.where(grown > _EMPTY_M, grown, d)
    d = cv2.morphologyEx(d, cv2.MORPH_CLOSE, _full(5))
    d = np.where(d > _EMPTY_M, cv2.medianBlur(d, 5), d)
    d = _fill_empty(d, 9, inside=_below_top(d))

    if extrapolate:
        d = _extend_up(d)
        inside = np.ones_like(valid)
    else:
        inside = _below_top(d)
    for _ in range(6):
        d = _fill_empty(d, 5, inside=inside)
    filled = (d > _EMPTY_M) & inside
    d = np.where(filled, cv2.medianBlur(d, 5), d)
    if blur == "bilateral":
        d = np.where(filled, cv2.bilateralFilter(d, 5, 0.5, 2.0), d)
    else:
        d = np.where((d > _EMPTY_M) & inside, cv2.GaussianBlur(d, (5, 5), 0), d)
    return _upright(d, about_m)


def _about(depth_m: np.ndarray, valid: np.ndarray) -> np.float32:
    """The depth about which depths are inverted, m."""
    deepest = float(depth_m[valid].max(initial=0))
    return np.float32(_INVERT_M if deepest < _INVERT_M - _EMPTY_M else _BEYOND * deepest)


def _inverted(depth_m: np.ndarray, valid: np.ndarray, about_m: np.float32) -> np.ndarray:
    return np.where(valid & (depth_m > _EMPTY_M), about_m - depth_m, 0).astype(np.float32)


def _upright(d: np.ndarray, about_m: np.float32) -> tuple[np.ndarray, np.ndarray]:
    valid = d > _EMPTY_M
    return np.where(valid, about_m - d, np.float32(0)), valid


def _fill_empty(d: np.ndarray, size: int, *, inside: np.ndarray | None = None) -> np.ndarray:
    empty = d < _EMPTY_M
    if inside is not None:
        empty &= inside
    return np.where(empty, cv2.dilate(d, _full(size)), d)


def _topmost(d: np.ndarray) -> np.ndarray:
    """Row of each column's first filled pixel; 0 for a column without any, as published."""
    return np.argmax(d > _EMPTY_M, axis=0)


def _below_top(d: np.ndarray) -> np.ndarray:
    return np.arange(d.shape[0])[:, None] >= _topmost(d)[None, :]


def _extend_up(d: np.ndarray) -> np.ndarray:
    value = np.take_along_axis(d, _topmost(d)[None, :], axis=0)
    return np.where(_below_top(d), d, value)
