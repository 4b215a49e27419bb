"""Dense depth from the LiDAR points that fall into the image, behind one function.

A method takes sparse depth with its mask and gives dense depth with its mask; it never writes into its input.

    ip_basic       filled by morphology
    penet          completed by a network that sees the image
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array, Camera, CameraFrame, Cloud
from jaxsim.geometry import project, scatter_nearest
from jaxsim.geometry.rasters import nearest_known
from jaxsim.prepare.depth.ip_basic import fill_in_fast, fill_in_multiscale
from jaxsim.prepare.depth.penet import open_penet

_NEAREST_M = 0.1
REACH_PX, SAME_SURFACE = 3.0, 0.1
"""Of `through_points`: half of what lines of an HDL-64E lie apart at most, and by which share a surface's depth may be
missed."""
METHODS = {"ip_basic": fill_in_multiscale, "ip_basic_fast": fill_in_fast}
"""Methods that use the sparse depth alone; `penet` also takes the image, and weights."""


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
    # Points that are left out take cell (0, 0) for an index alone: the mask keeps them from winning it.
    winner, valid = scatter_nearest(depth_m, row, column, inside=inside, shape=size)
    nearest = jnp.take_along_axis(depth_m, winner.reshape(*depth_m.shape[:-1], -1), axis=-1)
    return jnp.where(valid, nearest.reshape(winner.shape), 0), valid


def complete_depth(
    sparse_depth_m: Float[np.ndarray, "h w"], valid: Bool[np.ndarray, "h w"], method: str = "ip_basic_fast"
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Planar depth in metres for the pixels that the points' surroundings tell, and where that is.

    `ip_basic_fast` without extrapolation came nearest to KITTI's measured ranges (docs/benchmarks.md); sensors of
    fewer lines leave gaps that only `ip_basic` closes.

    Raises ValueError when no pixel has depth or the method is unknown.
    """
    if method not in METHODS:
        raise ValueError(
            f"depth: {method!r} completes no sparse depth alone; known: {', '.join(METHODS)}; penet also takes the "
            "image: call complete_view"
        )
    if not valid.any():
        raise ValueError(
            "depth: not one pixel has depth, so there is nothing to complete; check that the points fall "
            "into the image (calibration of another drive, or an empty scan?)"
        )
    return METHODS[method](sparse_depth_m.astype(np.float32), valid)


def through_points(
    depth_m: Float[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    sparse_depth_m: Float[np.ndarray, "h w"],
    *,
    valid: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "h w"]:
    """The dense depth, led through the points that it was completed from.

    IP-Basic lets near points grow over far ones, by 7 pixels up to 15 m and by 5 beyond, and lines of the HDL-64E lie 3
    to 4 pixels apart there: a line of road takes the depth of the one below it, which is nearer. So every pixel takes
    over by what share the dense depth misses the nearest point, up to REACH_PX away; where a point lies on another
    surface than its pixel, as behind an edge that has grown over it, the pixel stays as it is.
    """
    usable = valid & known & (depth_m > 0)
    if not usable.any():
        return depth_m
    ratio = np.ones_like(depth_m)
    np.divide(sparse_depth_m, depth_m, out=ratio, where=usable, dtype=np.float32)
    usable &= np.abs(ratio - 1) < SAME_SURFACE
    away_px, nearest = nearest_known(usable)
    return np.where(known & (away_px <= REACH_PX), depth_m * ratio.ravel()[nearest], depth_m)


def complete_view(
    view: CameraFrame,
    sparse_depth_m: Float[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"],
    *,
    method: str,
    weights: Path | None = None,
    rows_cut: int = 0,
) -> CameraFrame:
    """A cropped view with dense depth, by any method; `penet` takes `weights` that `jaxsim convert penet` or a training
    wrote. `rows_cut`: rows that the crop takes off the image's top.

    Raises ValueError as `complete_depth` does; for `penet` also without weights, and where the crop's sides are no
    multiples of 32.
    """
    if method == "penet":
        network = open_penet(weights)
        depth_m, known = network(
            np.asarray(view.rgb),
            sparse_depth_m,
            valid,
            intrinsics=np.asarray(view.camera.intrinsics),
            rows_cut=rows_cut,
        )
    else:
        depth_m, known = complete_depth(sparse_depth_m, valid, method)
        depth_m = through_points(depth_m, known, sparse_depth_m, valid=valid)
    return replace(view, depth_m=depth_m, depth_valid=known)
