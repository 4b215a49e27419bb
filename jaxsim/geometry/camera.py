"""Pinhole cameras on the LiDAR's car: transforms, projection, and the polar window that a camera sees.

Transforms are named destination first. Pixel (0, 0) has its centre at u = v = 0, so that an image of width w
reaches from u = -1/2 to w - 1/2.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array, Camera, DepthFrame, PolarGrid
from jaxsim.geometry.sensor import LidarSpec, window_grid

LINE_SHARE = 0.57
"""Of a line that must be in the image. In KITTI's 352 x 1216 crop, lines 43 and 44 keep 0.63 and 0.48 of their points
on a flat road, 0.63-0.69 and 0.49-0.51 in nine real frames: this lies in the middle and gives lines 0-43, the paper's
44."""


def _rotate(matrix: Float[Array, "*b 3 3"], xyz: Float[Array, "*b n 3"]) -> Float[Array, "*b n 3"]:
    # Written out: a matrix product may round to tf32 on an accelerator, which moves far points by centimetres.
    return sum((matrix[..., None, :, j] * xyz[..., :, j, None] for j in range(3)), start=jnp.zeros((), xyz.dtype))


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
    return jnp.concatenate([upper, jnp.broadcast_to(dst_from_src[..., 3:, :], (*upper.shape[:-2], 1, 4))], axis=-2)


@jax.jit
def project(camera: Camera, xyz_velo: Float[Array, "*b n 3"]) -> tuple[Float[Array, "*b n 2"], Float[Array, "*b n"]]:
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
    x, y = pixels_at_one(camera, depth_m.shape)
    depth_m = depth_m.astype(x.dtype)
    cam = jnp.stack([x * depth_m, y * depth_m, depth_m], axis=-1).reshape(*batch, height * width, 3)
    return transform(invert(camera.cam_from_velo), cam).reshape(*batch, height, width, 3)


def pixels_at_one(camera: Camera, shape: tuple[int, ...]) -> tuple[Float[Array, "*b h w"], Float[Array, "*b h w"]]:
    """x and y in `cam` of every pixel's centre at depth 1, of images of `shape` (*b, h, w)."""
    k = camera.intrinsics
    # Of the camera's type: depth may come in half precision, which does not count beyond 2048 pixels.
    v = jax.lax.broadcasted_iota(k.dtype, shape, len(shape) - 2)
    u = jax.lax.broadcasted_iota(k.dtype, shape, len(shape) - 1)
    fu = k[..., 0, 0, None, None]
    skew = k[..., 0, 1, None, None]
    cu = k[..., 0, 2, None, None]
    fv = k[..., 1, 1, None, None]
    cv = k[..., 1, 2, None, None]
    # K is upper triangular: solved from the bottom row up.
    y = (v - cv) / fv
    return (u - cu - skew * y) / fu, y


def camera_from_projection(projection: Float[np.ndarray, "3 4"], cam0_from_velo: Float[np.ndarray, "4 4"]) -> Camera:
    """Camera of a KITTI projection matrix P = K [I | t]: its fourth column becomes part of `cam_from_velo`."""
    intrinsics = np.asarray(projection[:, :3], np.float64)
    shift = np.eye(4)
    shift[:3, 3] = np.linalg.solve(intrinsics, np.asarray(projection[:, 3], np.float64))
    cam_from_velo = shift @ np.asarray(cam0_from_velo, np.float64)
    return Camera(intrinsics.astype(np.float32), cam_from_velo.astype(np.float32))


def camera_at_lidar(intrinsics: Float[np.ndarray, "3 3"]) -> Camera:
    """A camera in the LiDAR's own place that looks straight ahead: z forward is x of `velo`, x right is -y.

    It sees what the LiDAR sees, so that no cell is occluded: where a renderer can place a camera at will, place it so.
    """
    cam_from_velo = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], np.float32)
    return Camera(np.asarray(intrinsics, np.float32), cam_from_velo)


def crop_camera(camera: Camera, top: int, left: int) -> Camera:
    """The camera of the image without its first `top` rows and `left` columns."""
    return replace(camera, intrinsics=_cropped(camera.intrinsics, top, left))


def _cropped(intrinsics: Float[Array, "*b 3 3"], top: int, left: int) -> Float[Array, "*b 3 3"]:
    """Intrinsics whose principal point moved by what is cut off."""
    shift = np.zeros(intrinsics.shape, np.float32)
    shift[..., 0, 2], shift[..., 1, 2] = left, top
    return intrinsics - shift


def crop_offsets(size: tuple[int, int], crop: tuple[int, int]) -> tuple[int, int]:
    """Rows above and columns to the left of the bottom and middle part of an image: what depth completion networks see
    of KITTI's (PENet: 352 x 1216). Raises ValueError where the image is smaller; sizes are (h, w)."""
    if size[0] < crop[0] or size[1] < crop[1]:
        raise ValueError(f"the image is {size[1]} x {size[0]}, smaller than the crop of {crop[1]} x {crop[0]}")
    return size[0] - crop[0], round((size[1] - crop[1]) / 2)


def crop_depth_frame(frame: DepthFrame, crop: tuple[int, int]) -> DepthFrame:
    """The bottom and middle part of a frame (host). Raises ValueError where it is smaller, as `crop_offsets`."""
    return cut_depth_frame(frame, *crop_offsets(frame.truth_m.shape, crop), size=crop)


def cut_depth_frame(frame: DepthFrame, top: int, left: int, *, size: tuple[int, int]) -> DepthFrame:
    """So many rows and columns of a frame (host), from a row and a column on, with the camera of that part."""
    part = np.s_[top : top + size[0], left : left + size[1]]
    intrinsics = _cropped(np.asarray(frame.intrinsics, np.float32), top, left)
    rasters = (frame.rgb, frame.sparse_m, frame.given, frame.truth_m, frame.known)
    return DepthFrame(*[np.asarray(raster)[part] for raster in rasters], intrinsics=intrinsics)


def camera_window(camera: Camera, size: tuple[int, int], spec: LidarSpec, *, columns: int) -> PolarGrid:
    """The polar window that a camera with an image of `size` (h, w) sees.

    It has `columns` cells between the azimuths of the image's left and right edge (level with the principal point, far
    away), and the lines of `camera_rows`.

    KITTI's camera 2, cropped to 352 x 1216 (bottom, middle): 80.2 degrees and 44 lines of the HDL-64E. The paper's 372
    columns are then 0.216 degrees wide, coarser than the sensor's own 0.179: a line that comes back leaves no cell
    empty. Raises ValueError as `camera_rows` does.
    """
    rows = camera_rows(camera, size, spec)
    return window_grid(spec, *_azimuth_extent(camera, size), columns=columns, rows=rows)


def camera_rows(camera: Camera, size: tuple[int, int], spec: LidarSpec) -> tuple[int, int]:
    """First and stop of the lines that a camera sees.

    Those are the lines with at least LINE_SHARE of their points on a flat road between the image's top and bottom edge,
    of all points in the camera's azimuth extent. A line is level and its image curved: the image's bottom cuts it first
    at the sides. A flat road depends on the calibration alone, so that all frames of a drive share a window.

    Raises ValueError for a batch of cameras and for a camera that sees no line.
    """
    if np.ndim(camera.intrinsics) != 2:
        raise ValueError(f"camera_rows takes one camera, got a batch {np.shape(camera.intrinsics)[:-2]}; take one out")
    left, right = _azimuth_extent(camera, size)
    # 360 places within the extent; on its very ends rounding would decide what is inside.
    azimuth = np.linspace(left, right, 362)[1:-1]
    fractions = _inside(camera, size, _road_points(spec, azimuth)).mean(axis=1)
    seen = np.flatnonzero(fractions >= LINE_SHARE)
    if len(seen) == 0:
        raise ValueError(
            f"camera_rows: the camera sees no line of {spec.name} (best: {100 * fractions.max():.0f} % of line "
            f"{fractions.argmax()}, asked {100 * LINE_SHARE:.0f} %); is cam_from_velo right, is the size "
            "(height, width)?"
        )
    return int(seen[0]), int(seen[-1]) + 1


def _azimuth_extent(camera: Camera, size: tuple[int, int]) -> tuple[float, float]:
    intrinsics = np.asarray(camera.intrinsics, np.float64)
    rotation = np.asarray(camera.cam_from_velo[:3, :3], np.float64)
    # Outer edges of the first and the last column, level with the principal point.
    edges = np.array([[u, intrinsics[1, 2], 1.0] for u in (-0.5, size[1] - 0.5)])
    rays = np.linalg.solve(intrinsics, edges.T).T @ rotation
    left, right = np.arctan2(rays[:, 1], rays[:, 0])
    # A camera that looks backwards sees across the azimuth's cut at pi.
    return (float(left + 2 * np.pi) if left < right else float(left)), float(right)


def _road_points(spec: LidarSpec, azimuth: Float[np.ndarray, " a"]) -> Float[np.ndarray, "rows a 3"]:
    elevation, origin = spec.elevation_rad[:, None], np.asarray(spec.origin_m)[:, None]
    # A beam that does not fall never meets the road: its points stand at the farthest range.
    fall = np.maximum(-np.sin(elevation), 1e-9)
    range_m = np.clip((spec.mount_m + origin) / fall, spec.min_range_m, spec.max_range_m)
    rho = range_m * np.cos(elevation)
    z = np.broadcast_to(origin + range_m * np.sin(elevation), (spec.rows, len(azimuth)))
    return np.stack([rho * np.cos(azimuth), rho * np.sin(azimuth), z], axis=-1)


def _inside(camera: Camera, size: tuple[int, int], xyz: Float[np.ndarray, "*b 3"]) -> Bool[np.ndarray, "*b"]:
    """Whether points lie ahead and between the image's top and bottom edge."""
    cam_from_velo = np.asarray(camera.cam_from_velo, np.float64)
    pixel = (xyz @ cam_from_velo[:3, :3].T + cam_from_velo[:3, 3]) @ np.asarray(camera.intrinsics, np.float64).T
    ahead = pixel[..., 2] > 0
    v = pixel[..., 1] / np.where(ahead, pixel[..., 2], 1.0)
    return ahead & (v >= -0.5) & (v < size[0] - 0.5)
