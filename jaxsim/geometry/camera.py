"""Pinhole cameras on the LiDAR's car: transforms, projection, and the polar window that a camera sees.

Transforms are named destination first. Pixel (0, 0) has its centre at u = v = 0, so that an image of width w
reaches from u = -1/2 to w - 1/2.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxsim.frame import Array, Camera, Cloud, PolarGrid
from jaxsim.geometry.sensor import LidarSpec, window_grid


def _rotate(matrix: Float[Array, "*b 3 3"], xyz: Float[Array, "*b n 3"]) -> Float[Array, "*b n 3"]:
    # Written out: a matrix product may round to tf32 on an accelerator, which moves far points by centimetres.
    columns = (matrix[..., None, :, j] * xyz[..., :, j, None] for j in range(3))
    return sum(columns, start=jnp.zeros((), xyz.dtype))


@jax.jit
def transform(dst_from_src: Float[Array, "*b 4 4"], xyz: Float[Array, "*b n 3"]) -> Float[Array, "*b n 3"]:
    """Points of frame `src` in frame `dst`; the last row of the matrix is taken as 0 0 0 1."""
    return _rotate(dst_from_src[..., :3, :3], xyz) + dst_from_src[..., None, :3, 3]


@jax.jit
def invert(dst_from_src: Float[Array, "*b 4 4"]) -> Float[Array, "*b 4 4"]:
    """`src_from_dst` of a rigid transform (rotation and translation alone)."""
    rotation = jnp.swapaxes(dst_from_src[..., :3, :3], -1, -2)
    shift = -_rotate(rotation, dst_from_src[..., None, :3, 3])
    upper = jnp.concatenate([rotation, jnp.swapaxes(shift, -1, -2)], axis=-1)
    return jnp.concatenate(
        [upper, jnp.broadcast_to(dst_from_src[..., 3:, :], (*upper.shape[:-2], 1, 4))], axis=-2
    )


@jax.jit
def project(
    camera: Camera, xyz_velo: Float[Array, "*b n 3"]
) -> tuple[Float[Array, "*b n 2"], Float[Array, "*b n"]]:
    """Pixel (u, v) and planar depth in metres of points in `velo`; NaN pixels for points not in front of the camera."""
    pixel = _rotate(camera.intrinsics, transform(camera.cam_from_velo, xyz_velo))
    depth = pixel[..., 2]
    ahead = depth > 0
    uv = pixel[..., :2] / jnp.where(ahead, depth, jnp.ones_like(depth))[..., None]
    return jnp.where(ahead[..., None], uv, jnp.full_like(uv, jnp.nan)), depth


@jax.jit
def unproject(camera: Camera, depth_m: Float[Array, "*b h w"]) -> Float[Array, "*b h w 3"]:
    """Point in `velo` of every pixel's centre at planar depth `depth_m`."""
    *batch, height, width = depth_m.shape
    k = camera.intrinsics
    v = jax.lax.broadcasted_iota(depth_m.dtype, depth_m.shape, depth_m.ndim - 2)
    u = jax.lax.broadcasted_iota(depth_m.dtype, depth_m.shape, depth_m.ndim - 1)
    fu, skew, cu, fv, cv = (k[..., i, j, None, None] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2)))
    y = (v - cv) / fv
    x = (u - cu - skew * y) / fu
    cam = jnp.stack([x * depth_m, y * depth_m, depth_m], axis=-1).reshape(*batch, height * width, 3)
    return transform(invert(camera.cam_from_velo), cam).reshape(*batch, height, width, 3)


def camera_from_projection(
    projection: Float[np.ndarray, "3 4"], cam0_from_velo: Float[np.ndarray, "4 4"]
) -> Camera:
    """Camera of a KITTI projection matrix P = K [I | t]: its fourth column becomes part of `cam_from_velo`."""
    intrinsics = np.asarray(projection[:, :3], np.float64)
    shift = np.eye(4)
    shift[:3, 3] = np.linalg.solve(intrinsics, np.asarray(projection[:, 3], np.float64))
    cam_from_velo = shift @ np.asarray(cam0_from_velo, np.float64)
    return Camera(intrinsics.astype(np.float32), cam_from_velo.astype(np.float32))


def crop_camera(camera: Camera, top: int, left: int) -> Camera:
    """The camera of the image without its first `top` rows and `left` columns."""
    shift = np.zeros(camera.intrinsics.shape, np.float32)
    shift[..., 0, 2], shift[..., 1, 2] = left, top
    return camera.replace(intrinsics=camera.intrinsics - shift)


def _pixel_azimuth(camera: Camera, u: float, v: float) -> float:
    ray = np.linalg.solve(np.asarray(camera.intrinsics, np.float64), [u, v, 1.0])
    x, y, _ = np.asarray(camera.cam_from_velo, np.float64)[:3, :3].T @ ray
    return float(np.arctan2(y, x))


def camera_window(
    camera: Camera,
    size: tuple[int, int],
    spec: LidarSpec,
    columns: int,
    *,
    rows_from: Cloud | None = None,
) -> PolarGrid:
    """The polar window that a camera sees (draft: first 44 lines)."""
    cv = float(camera.intrinsics[1, 2])
    left, right = (_pixel_azimuth(camera, u, cv) for u in (-0.5, size[1] - 0.5))
    return window_grid(spec, left, right, columns, camera_rows(camera, size, spec, rows_from=rows_from))


def camera_rows(
    camera: Camera, size: tuple[int, int], spec: LidarSpec, *, rows_from: Cloud | None = None
) -> tuple[int, int]:
    """First line and stop of the lines that a camera sees (draft)."""
    return 0, 44
