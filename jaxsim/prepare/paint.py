"""Camera rasters onto the polar grid, through their depth.

Every pixel with known depth is a point in space and goes to the cell of the beam that passes nearest. Of a
cell's pixels one stands for the ray (the paper: one camera pixel a ray; it leaves open which): a pixel of the
nearest surface, since a ray ends there, and of that surface the pixel nearest to the ray. The nearest pixel
of all would do for walls; on the road it lies at the cell's lower edge, and points would float above it.

Camera and LiDAR stand in different places, so in the image a near surface does not hide all of what it hides from the
LiDAR. Such pixels fall into the near surface's cell. About 26 pixels share a cell, so it is their depth that tells, not
their number; and they differ rightly where a surface is seen at a slant: a cell of the road spans
r^2 / height x beam spacing, 13 % of the range at 40 m. The change of range from one cell to the next tells that span.

`shrink` scales rasters down to the size of a polar window instead, without projection. The paper does so with Virtual
KITTI: its network, trained on rasters in the LiDAR's grid, is shown the camera's. Cells are then not rays, but the
camera's and the window's views nearly agree: both span the same crop of the image.
"""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.frame import Array, CameraFrame, Painted, PolarGrid
from jaxsim.geometry import azimuth_of, column_of, resample, unproject, with_neighbours
from jaxsim.geometry.camera import pixels_at_one
from jaxsim.geometry.points import FAR_M
from jaxsim.geometry.polar import beam_slopes

_NOTHING = 2**31 - 1
_RELATIVE = 0.1
_SLANT = 1.5  # the farther half of a cell of road spans more than the step to the nearer neighbour
_LEAST_M = 0.1


@partial(jax.jit, static_argnames="occlusion_m")
def paint(camera_frame: CameraFrame, grid: PolarGrid, *, occlusion_m: float = 1.0) -> Painted:
    """The camera's view from the LiDAR's place. A raster that the camera does not have is 0 everywhere.

    Pixels outside the grid are left out: more than half a beam's or column's spacing beyond its border cells.
    Raises ValueError where the frame has no depth.
    """
    *batch, h, w, _ = camera_frame.rgb.shape
    rho, z, winner, valid, occluded = _pixels(camera_frame, grid, occlusion_m)
    pick = partial(_pick, winner=winner, valid=valid)
    rgb = camera_frame.rgb.reshape(*batch, h * w, 3)
    rgb = jnp.take_along_axis(rgb, winner[..., None], axis=-2, mode="clip")
    # A beam starts at its own height: the range is measured from there, not from the origin of `velo`.
    rise = pick(z) - grid.origin_m.reshape((1,) * len(batch) + (-1, 1))
    nothing = jnp.zeros((*batch, h, w), jnp.int32)
    semantic = pick(nothing if camera_frame.semantic is None else camera_frame.semantic).astype(jnp.int32)
    instance = pick(nothing if camera_frame.instance is None else camera_frame.instance).astype(jnp.int32)
    return Painted(
        range_m=jnp.where(valid, jnp.sqrt(jnp.square(pick(rho)) + jnp.square(rise)), 0),
        depth_m=pick(camera_frame.depth_m),
        rgb=jnp.where(valid[..., None], rgb.reshape(*valid.shape, 3).astype(jnp.float32) / 255, 0),
        semantic=semantic,
        instance=instance,
        valid=valid,
        occluded=occluded,
    )


@partial(jax.jit, static_argnames="occlusion_m")
def paint_raster(
    raster: Float[Array, "*b h w"], camera_frame: CameraFrame, grid: PolarGrid, *, occlusion_m: float = 1.0
) -> Float[Array, "*b rows columns"]:
    """One more raster of the camera's pixels, carried to the grid as `paint` carries the others; 0 where there is
    none. Raises ValueError where the frame has no depth."""
    _, _, winner, valid, _ = _pixels(camera_frame, grid, occlusion_m)
    return _pick(raster, winner=winner, valid=valid)


def _pixels(
    camera_frame: CameraFrame, grid: PolarGrid, occlusion_m: float
) -> tuple[
    Float[Array, "*b n"],
    Float[Array, "*b n"],
    Int[Array, "*b cells"],
    Bool[Array, "*b rows columns"],
    Bool[Array, "*b rows columns"],
]:
    """Every pixel's distance from the vertical axis and the height; and what `_winners` says of them.

    Raises ValueError where the frame has no depth.
    """
    if camera_frame.depth_m is None or camera_frame.depth_valid is None:
        raise ValueError("paint: the camera frame has no depth_m and depth_valid; complete it first (complete_depth)")
    *batch, h, w = camera_frame.depth_m.shape
    xyz = unproject(camera_frame.camera, camera_frame.depth_m).reshape(*batch, h * w, 3)
    x = xyz[..., 0]
    y = xyz[..., 1]
    z = xyz[..., 2]
    rho = jnp.sqrt(x * x + y * y)
    down, across = _row_of(rho, z, grid), column_of(azimuth_of(x, y), grid)
    away = jnp.sqrt(rho * rho + z * z)
    known = camera_frame.depth_valid.reshape(*batch, h * w) & jnp.isfinite(away)
    return rho, z, *_winners(away, down, across, known=known, grid=grid, occlusion_m=occlusion_m)


def _pick(raster: Array, *, winner: Int[Array, "*b cells"], valid: Bool[Array, "*b rows columns"]) -> Array:
    flat = raster.reshape(*winner.shape[:-1], -1)
    values = jnp.take_along_axis(flat, winner, axis=-1, mode="clip").reshape(valid.shape)
    return jnp.where(valid, values, jnp.zeros((), values.dtype))


def _winners(
    away_m: Float[Array, "*b n"],
    down: Float[Array, "*b n"],
    across: Float[Array, "*b n"],
    *,
    known: Bool[Array, "*b n"],
    grid: PolarGrid,
    occlusion_m: float,
) -> tuple[Int[Array, "*b cells"], Bool[Array, "*b rows columns"], Bool[Array, "*b rows columns"]]:
    """Finds, of pixels at float rows and columns, the one that stands for each cell, whether there is one, and whether
    others lie behind its surface.

    What lies in front is told by the distance from the origin of `velo`, within a cell as good as from the beam's.
    """
    *batch, n = away_m.shape
    rows, columns = shape = grid.elevation_rad.shape[0], grid.azimuth_rad.shape[0]
    row, column = jnp.floor(down + 0.5), jnp.floor(across + 0.5)
    inside = known & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    # A cell's number counts over the whole batch: one scatter serves all its images.
    image = jnp.arange(math.prod(batch), dtype=jnp.int32).reshape(*batch, 1)
    cells = math.prod(batch) * rows * columns
    cell = (image * rows + row.astype(jnp.int32)) * columns + column.astype(jnp.int32)
    cell = jnp.where(inside, cell, cells).ravel()

    # Floats that are not negative order like their bits read as integers: exact on every device.
    bits = jax.lax.bitcast_convert_type(away_m, jnp.int32).ravel()
    bits = jnp.full(cells, _NOTHING, jnp.int32).at[cell].min(bits, mode="drop").reshape(*batch, *shape)
    valid = bits != _NOTHING
    nearest = jnp.where(valid, jax.lax.bitcast_convert_type(bits, jnp.float32), 0)
    reach = nearest + surface_depth(nearest, valid, occlusion_m)

    # One scatter finds the front pixel nearest to the ray, and in a second table whether a pixel lies behind:
    # the squared distance from the ray, in cells, in the upper bits, the pixel's number in the lower ones.
    number = max(n - 1, 1).bit_length()
    levels = 2 ** (31 - number)
    off = 2 * (jnp.square(down - row) + jnp.square(across - column))
    coarse = jnp.clip(off * levels, 0, levels - 1).astype(jnp.int32)
    pixel = jnp.arange(n, dtype=jnp.int32).reshape((1,) * len(batch) + (n,))
    key = ((coarse << number) + pixel).ravel()
    behind = away_m.ravel() > reach.ravel().at[cell].get(mode="fill", fill_value=0.0)
    target = jnp.where(behind, cell + cells, cell)
    table = jnp.full(2 * cells, _NOTHING, jnp.int32)
    table = table.at[jnp.where(cell < cells, target, 2 * cells)].min(key, mode="drop")
    winner = table[:cells].reshape(*batch, rows * columns) & (2**number - 1)
    return winner, valid, (table[cells:] != _NOTHING).reshape(valid.shape)


def _row_of(rho_m: Float[Array, "*b n"], z_m: Float[Array, "*b n"], grid: PolarGrid) -> Float[Array, "*b n"]:
    """Row as a float: whole on the ray of a beam, linear in height in between.

    One more ray is thought above and below the grid. Counting the rays above a point needs no angle, no search
    and no look-up; unrolled it is one fused loop.
    """
    wider = with_neighbours(grid)
    slopes, origins = beam_slopes(wider), wider.origin_m
    rays = [origins[k] + rho_m * slopes[k] for k in range(slopes.shape[0])]
    row = jnp.full(z_m.shape, -2.0)
    above = rays[0] + 1
    below = rays[0]
    for k, (ray, next_ray) in enumerate(zip(rays, [*rays[1:], rays[-1] - 1], strict=True)):
        under = z_m < ray
        row = jnp.where(under, k - 1.0, row)
        above, below = jnp.where(under, ray, above), jnp.where(under, next_ray, below)
    # The division comes last because XLA keeps the result of one, and computes a sum again for every use.
    return (row * (above - below) + (above - z_m)) / (above - below)


@jax.jit
def surface_depth(
    nearest_m: Float[Array, "*b rows columns"],
    valid: Bool[Array, "*b rows columns"],
    occlusion_m: Float[Array, ""] | float,
) -> Float[Array, "*b rows columns"]:
    """How far the pixels of one surface may differ in range within a cell, in metres.

    `occlusion_m`, or a tenth of the range if that is more, plus what the surface in front spans over one and a half
    cells along rows and columns. Pixels that differ by more lie on different surfaces: the cell is occluded.
    """
    # Of a plane the inverse of the range changes evenly from cell to cell. Ranges of a road do not: of few rows
    # one meets it twice as far off as the next. Columns are many.
    near = jnp.maximum(nearest_m, _LEAST_M)
    inverse = jnp.where(valid, 1 / near, 0)
    farthest = 1 / jnp.maximum(inverse - _SLANT * _slope(inverse, valid, -2), 1 / FAR_M)
    over_rows = jnp.where(valid, jnp.maximum(farthest - near, 0), 0)
    return jnp.maximum(occlusion_m, _RELATIVE * nearest_m) + over_rows + _SLANT * _slope(nearest_m, valid, -1)


def _slope(
    values: Float[Array, "*b rows columns"], valid: Bool[Array, "*b rows columns"], axis: int
) -> Float[Array, "*b rows columns"]:
    """Change per cell of the surface a cell lies on, without its sign.

    The smaller of the changes to both neighbours, and none where they have different signs (a pole before a
    house, a gap): a limited slope does not reach over an edge. Only one neighbour known: the change to it.
    """
    before = jnp.roll(values, 1, axis)
    after = jnp.roll(values, -1, axis)
    index = jax.lax.broadcasted_iota(jnp.int32, values.shape, values.ndim + axis)
    has_before = jnp.roll(valid, 1, axis) & (index > 0)
    has_after = jnp.roll(valid, -1, axis) & (index < values.shape[axis] - 1)
    a, b = jnp.abs(values - before), jnp.abs(after - values)
    falls_or_rises = (values - before) * (after - values) > 0
    both = jnp.where(falls_or_rises, jnp.minimum(a, b), jnp.zeros_like(a))
    one = jnp.where(has_before, a, jnp.where(has_after, b, jnp.zeros_like(a)))
    return jnp.where(has_before & has_after, both, one)


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
    x, y = pixels_at_one(view.camera, shape)
    painted = Painted(
        range_m=depth_m * jnp.sqrt(1 + x * x + y * y),
        depth_m=depth_m,
        rgb=jnp.where(valid[..., None], view.rgb.astype(jnp.float32) / 255, 0),
        semantic=jnp.where(valid, semantic, 0),
        instance=jnp.where(valid, instance, 0),
        valid=valid,
        occluded=jnp.zeros(shape, bool),
    )
    return resample(painted, size, batch_dims=lead)
