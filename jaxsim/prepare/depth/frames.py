"""Frames whose true depth is known, as depth completion learns from them."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np

from jaxsim.frame import DepthFrame, Frame
from jaxsim.geometry import pad_cloud
from jaxsim.prepare.depth.ip_basic import fill_in_multiscale
from jaxsim.prepare.depth.sparse import sparse_depth

REACH_M = 120.0
"""True depth beyond a LiDAR's reach is left out, as no sweep could tell it; it would rule a squared error."""


def depth_frame(frame: Frame, crop: tuple[int, int]) -> DepthFrame:
    """A renderer's frame, its bottom rows and middle columns: the sweep's points in the image, and the rendered depth.

    Raises ValueError where the frame has no cloud or no depth, or is smaller than the crop.
    """
    view, cloud = frame.camera, frame.cloud
    if cloud is None or view.depth_m is None or view.depth_valid is None:
        raise ValueError(
            f"depth: {frame.name} has {'no LiDAR sweep' if cloud is None else 'no true depth'}; depth completion "
            "learns from frames that have both (the embedded world; KITTI's depth completion set, --depth-root)"
        )
    (h, w), (rows, columns) = view.rgb.shape[:2], crop
    if h < rows or w < columns:
        raise ValueError(
            f"depth: {frame.name} is {h} x {w}, smaller than the crop {rows} x {columns}; lower --image-crop"
        )
    sparse_m, given = jax.device_get(sparse_depth(pad_cloud(cloud), view.camera, (h, w)))
    top, left = h - rows, round((w - columns) / 2)
    cut = lambda raster: np.asarray(raster)[top:, left : left + columns]  # noqa: E731
    intrinsics = np.array(view.camera.intrinsics, np.float32)
    intrinsics[:2, 2] -= left, top
    known = np.asarray(view.depth_valid) & (np.asarray(view.depth_m) < REACH_M)
    return DepthFrame(cut(view.rgb), cut(sparse_m), cut(given), cut(view.depth_m), cut(known), intrinsics)


def where_backed(frame: DepthFrame) -> DepthFrame:
    """The frame (host), its truth known only where the sweep's points back a pixel, as in KITTI's set: above the top
    line nothing says how far a facade is, and no completed depth is used there (`Penet`)."""
    backed = fill_in_multiscale(np.asarray(frame.sparse_m), np.asarray(frame.given))[1]
    return replace(frame, known=frame.known & backed)
