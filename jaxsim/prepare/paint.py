"""Camera rasters onto the polar grid, through their depth.

Every pixel with known depth is a point in space; it goes to the cell of the beam that passes nearest, and of
a cell's pixels the nearest stands for it: one camera pixel a ray. (The paper says the latter and leaves the
choice of the pixel open; a ray ends at the first surface.)
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array, CameraFrame, Painted, PolarGrid
from jaxsim.geometry import column_of, scatter_nearest, unproject
from jaxsim.prepare.occlusion import occluded


@partial(jax.jit, static_argnames="occlusion_m")
def paint(camera_frame: CameraFrame, grid: PolarGrid, *, occlusion_m: float = 1.0) -> Painted:
    """The camera's view from the LiDAR's place. A raster that the camera does not have is 0 everywhere.

    Pixels outside the grid are left out: more than half a beam's or column's spacing beyond its border cells.
    Raises ValueError where the frame has no depth.
    """
    if camera_frame.depth_m is None or camera_frame.depth_valid is None:
        raise ValueError(
            "paint: the camera frame has no depth_m and depth_valid; complete it first (complete_depth)"
        )
    *batch, h, w = camera_frame.depth_m.shape
    shape = grid.elevation_rad.shape[0], grid.azimuth_rad.shape[0]
    xyz = unproject(camera_frame.camera, camera_frame.depth_m).reshape(*batch, h * w, 3)
    x, y, z = (xyz[..., k] for k in range(3))
    row = _row(jnp.hypot(x, y), z, grid)
    column = jnp.floor(column_of(jnp.arctan2(y, x), grid) + 0.5).astype(jnp.int32)
    rise = z - grid.origin_m[jnp.clip(row, 0, shape[0] - 1)]
    range_m = jnp.sqrt(x * x + y * y + rise * rise)
    inside = camera_frame.depth_valid.reshape(*batch, h * w) & jnp.isfinite(range_m)
    winner, valid = scatter_nearest(range_m, row, column, inside, shape)
    farthest = _farthest(range_m, row, column, inside, shape)

    flat = winner.reshape(*batch, -1)

    def pick(raster: Array) -> Array:
        values = jnp.take_along_axis(raster.reshape(*batch, h * w), flat, axis=-1).reshape(winner.shape)
        return jnp.where(valid, values, jnp.zeros((), values.dtype))

    nothing = jnp.zeros((*batch, h, w), jnp.int32)
    nearest = pick(range_m)
    return Painted(
        range_m=nearest,
        depth_m=pick(camera_frame.depth_m),
        rgb=jnp.stack([pick(camera_frame.rgb[..., k]) for k in range(3)], axis=-1).astype(jnp.float32) / 255,
        semantic=pick(nothing if camera_frame.semantic is None else camera_frame.semantic).astype(jnp.int32),
        instance=pick(nothing if camera_frame.instance is None else camera_frame.instance).astype(jnp.int32),
        valid=valid,
        occluded=occluded(nearest, farthest, valid, occlusion_m),
    )


def _row(rho_m: Float[Array, "*b n"], z_m: Float[Array, "*b n"], grid: PolarGrid) -> Int[Array, "*b n"]:
    """The beam that passes nearest; -1 above the grid, `rows` below it.

    The border between two beams is the ray half-way between them in angle and origin. Counting the borders
    above a point gives its beam without a search; it needs no angle, and unrolled it is one fused loop.
    """
    slope, height = (_borders(values) for values in (grid.elevation_rad, grid.origin_m))
    slope = jnp.tan(slope)
    row = jnp.full(z_m.shape, -1, jnp.int32)
    for k in range(slope.shape[0]):
        row += (z_m < height[k] + rho_m * slope[k]).astype(jnp.int32)
    return row


def _borders(centres: Float[Array, " rows"]) -> Float[Array, " rows_and_one"]:
    """Values half-way between neighbours, and half a spacing beyond the first and last."""
    middle = (centres[1:] + centres[:-1]) / 2
    return jnp.concatenate([2 * centres[:1] - middle[:1], middle, 2 * centres[-1:] - middle[-1:]])


def _farthest(
    range_m: Float[Array, "*b n"],
    row: Int[Array, "*b n"],
    column: Int[Array, "*b n"],
    inside: Bool[Array, "*b n"],
    shape: tuple[int, int],
) -> Float[Array, "*b rows columns"]:
    """Range of each cell's farthest pixel; 0 where it has none."""
    rows, columns = shape
    *batch, n = range_m.shape
    inside = inside & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    image = jnp.arange(range_m.size // n, dtype=jnp.int32)[:, None]
    size = rows * columns
    cells = image.shape[0] * size
    cell = jnp.where(inside.reshape(-1, n), (row * columns + column).reshape(-1, n) + image * size, cells)
    farthest = jnp.zeros(cells, jnp.float32).at[cell].max(range_m.reshape(-1, n), mode="drop")
    return farthest.reshape(*batch, rows, columns)
