"""Camera rasters onto the polar grid, through their depth.

Every pixel with known depth is a point in space and goes to the cell of the beam that passes nearest. Of a
cell's pixels one stands for the ray (the paper: one camera pixel a ray; it leaves open which): a pixel of the
nearest surface, since a ray ends there, and of that surface the pixel nearest to the ray. The nearest pixel
of all would do for walls; on the road it lies at the cell's lower edge, and points would float above it.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from jaxsim.frame import Array, CameraFrame, Painted, PolarGrid
from jaxsim.geometry import column_of, scatter_nearest, unproject
from jaxsim.prepare.occlusion import surface_depth


@partial(jax.jit, static_argnames="occlusion_m")
def paint(camera_frame: CameraFrame, grid: PolarGrid, *, occlusion_m: float = 1.0) -> Painted:
    """The camera's view from the LiDAR's place. A raster that the camera does not have is 0 everywhere.

    Pixels outside the grid are left out: more than half a beam's or column's spacing beyond its border cells.
    Raises ValueError where the frame has no depth.
    """
    if camera_frame.depth_m is None or camera_frame.depth_valid is None:
        raise ValueError("paint: the camera frame has no depth_m and depth_valid; complete it first (complete_depth)")
    *batch, h, w = camera_frame.depth_m.shape
    rows, columns = grid.elevation_rad.shape[0], grid.azimuth_rad.shape[0]
    xyz = unproject(camera_frame.camera, camera_frame.depth_m).reshape(*batch, h * w, 3)
    x, y, z = (xyz[..., k] for k in range(3))
    rho = jnp.hypot(x, y)
    row = _row(rho, z, grid)
    place = column_of(jnp.arctan2(y, x), grid)
    column = jnp.floor(place + 0.5).astype(jnp.int32)

    beam = jnp.clip(row, 0, rows - 1)
    height, slope = grid.origin_m[beam], jnp.tan(grid.elevation_rad)[beam]
    range_m = jnp.hypot(rho, z - height)
    inside = camera_frame.depth_valid.reshape(*batch, h * w) & jnp.isfinite(range_m)
    inside &= (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    cell = _cell(row, column, inside, (rows, columns))
    nearest, farthest = (_extreme(range_m, cell, (rows, columns), which) for which in ("min", "max"))
    valid = farthest > 0
    surface = surface_depth(nearest, valid, occlusion_m)

    front = inside & (range_m <= (nearest + surface).reshape(-1).at[cell].get(mode="fill", fill_value=0.0))
    # Distance from the ray through the cell's centre, as a fraction of the way there: squared, the angle's order.
    step = (grid.azimuth_rad[0] - grid.azimuth_rad[-1]) / (columns - 1)
    off = (jnp.square(z - height - rho * slope) + jnp.square(rho * step * (place - column))) / jnp.square(range_m)
    winner, _ = scatter_nearest(off, row, column, front, (rows, columns))
    flat = winner.reshape(*batch, rows * columns)

    def pick(raster: Array) -> Array:
        values = jnp.take_along_axis(raster.reshape(*batch, h * w), flat, axis=-1).reshape(valid.shape)
        return jnp.where(valid, values, jnp.zeros((), values.dtype))

    nothing = jnp.zeros((*batch, h, w), jnp.int32)
    semantic, instance = (
        pick(nothing if labels is None else labels).astype(jnp.int32)
        for labels in (camera_frame.semantic, camera_frame.instance)
    )
    return Painted(
        range_m=pick(range_m),
        depth_m=pick(camera_frame.depth_m),
        rgb=jnp.stack([pick(camera_frame.rgb[..., k]) for k in range(3)], axis=-1).astype(jnp.float32) / 255,
        semantic=semantic,
        instance=instance,
        valid=valid,
        occluded=valid & (farthest - nearest > surface),
    )


def _row(rho_m: Float[Array, "*b n"], z_m: Float[Array, "*b n"], grid: PolarGrid) -> Int[Array, "*b n"]:
    """The beam that passes nearest; -1 above the grid, `rows` below it.

    The border between two beams is the ray half-way between them in angle and origin. Counting the borders
    above a point gives its beam without a search; it needs no angle, and unrolled it is one fused loop.
    """
    slope, height = jnp.tan(_borders(grid.elevation_rad)), _borders(grid.origin_m)
    row = jnp.full(z_m.shape, -1, jnp.int32)
    for k in range(slope.shape[0]):
        row += (z_m < height[k] + rho_m * slope[k]).astype(jnp.int32)
    return row


def _borders(centres: Float[Array, " rows"]) -> Float[Array, " rows_and_one"]:
    """Values half-way between neighbours, and half a spacing beyond the first and last."""
    middle = (centres[1:] + centres[:-1]) / 2
    return jnp.concatenate([2 * centres[:1] - middle[:1], middle, 2 * centres[-1:] - middle[-1:]])


def _cell(row: Array, column: Array, inside: Array, shape: tuple[int, int]) -> Int[Array, "*b n"]:
    """Number of each pixel's cell over all images of the batch; beyond the last one for a pixel outside."""
    rows, columns = shape
    *batch, n = row.shape
    images = row.size // n
    image = jnp.arange(images, dtype=jnp.int32).reshape(*batch, 1)
    return jnp.where(inside, (image * rows + row) * columns + column, images * rows * columns)


def _extreme(
    range_m: Float[Array, "*b n"], cell: Int[Array, "*b n"], shape: tuple[int, int], which: str
) -> Float[Array, "*b rows columns"]:
    """Range of each cell's nearest ("min") or farthest ("max") pixel; 0 where it has none."""
    *batch, n = range_m.shape
    size = range_m.size // n * shape[0] * shape[1]
    # Floats that are not negative order like their bits read as integers: exact on every device.
    bits = jax.lax.bitcast_convert_type(range_m, jnp.int32).reshape(-1)
    empty = jnp.full(size, 0 if which == "max" else jnp.iinfo(jnp.int32).max, jnp.int32)
    found = getattr(empty.at[cell.reshape(-1)], which)(bits, mode="drop")
    found = jnp.where(found == jnp.iinfo(jnp.int32).max, 0, found)
    return jax.lax.bitcast_convert_type(found, jnp.float32).reshape(*batch, *shape)
