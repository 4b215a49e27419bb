"""Depth maps to clouds, the Pseudo-LiDAR way (Wang et al. 2019): one point a pixel.

The published program: pixel (u, v) at planar depth d is ((u - cu) d / fu + bx, (v - cv) d / fv + by, d) in the
rectified camera, pixels counted from 0 without half a pixel added; then velo = inverse of R0_rect Tr_velo_to_cam;
points behind the LiDAR and higher than 1 m are left out.
"""

from __future__ import annotations

from functools import partial

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.files import placed
from jaxsim.frame import Array, Camera, Cloud
from jaxsim.geometry import unproject
from jaxsim.geometry.camera import crop_offsets

MAX_HIGH_M = 1.0
"""Highest point that is kept, above the LiDAR."""


@partial(jax.jit, static_argnames=("drop_zero",))
def depth_to_cloud(
    camera: Camera,
    depth_m: Float[Array, "*b h w"],
    valid: Bool[Array, "*b h w"],
    *,
    intensity: Float[Array, "*b h w"] | None = None,
    drop_zero: bool = True,
    max_high_m: Float[Array, ""] | float = MAX_HIGH_M,
) -> Cloud:
    """One point in `velo` for each pixel, top row first, left to right: the order that `last` in `sparsify` needs.

    Valid are the points of `valid` pixels with x >= 0 and z < `max_high_m`; with `drop_zero` those alone whose
    `intensity` is above 0. The published program takes pixels of depth 0 as valid: they lie in the camera's centre.

    Without `intensity`, or where zeros are kept, points have intensity 0: what KITTI's sensor reports of 8 to 27 % of
    its points. The published program writes 1, which KITTI's never reaches, and the paper replaces it by 0: a detector
    trained on one would meet a value that the other does not have.
    """
    *batch, height, width = depth_m.shape
    flat = (*batch, height * width)
    known = valid & jnp.isfinite(depth_m)
    # Unknown depth may be NaN, which would pass into the gradient of the whole image.
    xyz = unproject(camera, jnp.where(known, depth_m, jnp.zeros_like(depth_m))).reshape(*flat, 3)
    brightness = jnp.zeros_like(depth_m) if intensity is None else intensity
    if intensity is not None and drop_zero:
        known = known & (intensity > 0)
    usable = known.reshape(flat) & (xyz[..., 0] >= 0) & (xyz[..., 2] < max_high_m)
    return Cloud(xyz, brightness.reshape(flat), usable)


def place_intensity(
    intensity: Float[np.ndarray, "*b rows columns"], size: tuple[int, int], *, crop: tuple[int, int]
) -> Float[np.ndarray, "*b h w"]:
    """A predicted intensity image at the size (h, w) of the camera's image: scaled up to `crop`, bottom and middle of
    it, 0 around.

    The border is what depth completion crops off, so nothing is known there: 23 rows above and 13 columns at each side
    of KITTI's 375 x 1242. The paper does not say how it scales up; here a pixel takes the nearest cell: a 0 is a lost
    ray, and linear interpolation would give the rays beside it an intensity that no ray has, and shrink the holes.
    Raises ValueError where the crop does not fit.
    """
    *batch, rows, columns = intensity.shape
    if rows > crop[0] or columns > crop[1]:
        raise ValueError(
            f"pseudo-LiDAR: intensity of {rows} x {columns} cells does not fit a crop of {crop[0]} x {crop[1]} (rows x "
            "columns); give the crop that it was made of"
        )
    with placed("pseudo-LiDAR", then="give the size of the camera's image"):
        top, left = crop_offsets(size, crop)
    flat = np.asarray(intensity, np.float32).reshape(-1, rows, columns)
    whole = np.zeros((len(flat), *size), np.float32)
    for out, image in zip(whole, flat, strict=True):
        # Bottom and middle, where depth completion has cropped.
        out[top:, left : left + crop[1]] = cv2.resize(image, crop[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    return whole.reshape(*batch, *size)
