"""A camera's rasters scaled down to the size of a polar window, without projection.

The paper does so with Virtual KITTI: its network, trained on rasters in the LiDAR's grid, is shown the camera's. Cells
are then not rays, but the camera's and the window's views nearly agree: both span the same crop of the image.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxsim.frame import Array, CameraFrame, Painted
from jaxsim.geometry import resample


@partial(jax.jit, static_argnames="size")
def shrink(view: CameraFrame, size: tuple[int, int]) -> Painted:
    """A view with depth at `size` (rows, columns): each cell takes the pixel at its centre, of every raster.

    `range_m` is the distance from the camera; nothing is occluded. A raster that the camera does not have is 0.
    Raises ValueError where the view has no depth, or fewer pixels than cells.
    """
    if view.depth_m is None or view.depth_valid is None:
        raise ValueError("shrink: the view has no depth_m and depth_valid")
    lead, shape = view.depth_m.ndim - 2, view.depth_m.shape
    if shape[-2] < size[0] or shape[-1] < size[1]:
        raise ValueError(
            f"shrink: the view has {shape[-1]} x {shape[-2]} pixels, fewer than the window's {size[1]} x {size[0]} "
            "cells; render it at the resolution of the images that the run learned from"
        )
    nothing = jnp.zeros(shape, jnp.int32)
    semantic = nothing if view.semantic is None else view.semantic.astype(jnp.int32)
    instance = nothing if view.instance is None else view.instance.astype(jnp.int32)
    # A renderer's sky may be infinitely far: it is as good as empty.
    valid = view.depth_valid & jnp.isfinite(view.depth_m)
    depth_m = jnp.where(valid, view.depth_m, jnp.zeros_like(view.depth_m))
    painted = Painted(
        range_m=depth_m * _stretch(view.camera.intrinsics, depth_m),
        depth_m=depth_m,
        rgb=jnp.where(valid[..., None], view.rgb.astype(jnp.float32) / 255, 0),
        semantic=jnp.where(valid, semantic, 0),
        instance=jnp.where(valid, instance, 0),
        valid=valid,
        occluded=jnp.zeros(shape, bool),
    )
    return resample(painted, size, batch_dims=lead)


def _stretch(intrinsics: Float[Array, "*b 3 3"], depth_m: Float[Array, "*b h w"]) -> Float[Array, "*b h w"]:
    """Length of each pixel's ray to a plane at depth 1."""
    v = jax.lax.broadcasted_iota(depth_m.dtype, depth_m.shape, depth_m.ndim - 2)
    u = jax.lax.broadcasted_iota(depth_m.dtype, depth_m.shape, depth_m.ndim - 1)
    fu = intrinsics[..., 0, 0, None, None]
    skew = intrinsics[..., 0, 1, None, None]
    cu = intrinsics[..., 0, 2, None, None]
    fv = intrinsics[..., 1, 1, None, None]
    cv = intrinsics[..., 1, 2, None, None]
    # u = fu x + skew y + cu and v = fv y + cv, solved for the point (x, y, 1).
    y = (v - cv) / fv
    x = (u - cu - skew * y) / fu
    return jnp.sqrt(1 + x * x + y * y)
