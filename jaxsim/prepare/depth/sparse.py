"""The LiDAR's points as a sparse depth image of the camera."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxsim.frame import Array, Camera, Cloud
from jaxsim.geometry import project, scatter_nearest

_NEAREST_M = 0.1


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
    winner, valid = scatter_nearest(depth_m, row, column, inside=inside, shape=size)
    nearest = jnp.take_along_axis(depth_m, winner.reshape(*depth_m.shape[:-1], -1), axis=-1)
    return jnp.where(valid, nearest.reshape(winner.shape), 0), valid
