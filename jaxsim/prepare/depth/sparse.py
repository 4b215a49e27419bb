"""The LiDAR's points as a sparse depth image of the camera, and the frames that depth completion learns from."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array, Camera, Cloud, DepthFrame, Frame
from jaxsim.geometry import pad_cloud, project, scatter_nearest
from jaxsim.prepare.depth.ip_basic import fill_in_multiscale

_NEAREST_M = 0.1
REACH_M = 120.0
"""True depth beyond a LiDAR's reach is left out, as no sweep could tell it; it would rule a squared error."""


@partial(jax.jit, static_argnames="size")
def sparse_depth(
    cloud: Cloud, camera: Camera, size: tuple[int, int]
) -> tuple[Float[Array, "*b h w"], Bool[Array, "*b h w"]]:
    """Planar depth in metres of the nearest point in each pixel of an image of `size` (h, w), and its mask.

    Points nearer to the image plane than 0.1 m and points outside the image are left out, as in KITTI's
    depth-completion set; a pixel reaches half a pixel around its centre.
    """
    uv, depth_m = project(camera, cloud.xyz_m)
    pixel = jnp.floor(uv + 0.5)
    inside = cloud.valid & (depth_m > _NEAREST_M) & jnp.isfinite(depth_m)
    u, v = pixel[..., 0], pixel[..., 1]
    inside &= (u >= 0) & (u < size[1]) & (v >= 0) & (v < size[0])
    row = jnp.where(inside, v, 0).astype(jnp.int32)
    column = jnp.where(inside, u, 0).astype(jnp.int32)
    winner, valid = scatter_nearest(depth_m, row, column, inside, size)
    nearest = jnp.take_along_axis(depth_m, winner.reshape(*depth_m.shape[:-1], -1), axis=-1)
    return jnp.where(valid, nearest.reshape(winner.shape), 0), valid


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
    h, w = view.rgb.shape[:2]
    rows, columns = crop
    if h < rows or w < columns:
        raise ValueError(
            f"depth: {frame.name} is {h} x {w}, smaller than the crop {rows} x {columns}; lower --image-crop"
        )
    sparse_m, given = jax.device_get(sparse_depth(pad_cloud(cloud), view.camera, (h, w)))
    top, left = h - rows, round((w - columns) / 2)

    def cut(raster: Array) -> np.ndarray:
        return np.asarray(raster)[top:, left : left + columns]

    intrinsics = np.array(view.camera.intrinsics, np.float32)
    intrinsics[:2, 2] -= left, top
    known = np.asarray(view.depth_valid) & (np.asarray(view.depth_m) < REACH_M)
    return DepthFrame(cut(view.rgb), cut(sparse_m), cut(given), cut(view.depth_m), cut(known), intrinsics)


def where_backed(frame: DepthFrame) -> DepthFrame:
    """The frame (host), its truth known only where the sweep's points back a pixel, as in KITTI's set: above the top
    line nothing says how far a facade is, and no completed depth is used there (`Penet`)."""
    backed = fill_in_multiscale(np.asarray(frame.sparse_m), np.asarray(frame.given))[1]
    return replace(frame, known=frame.known & backed)
