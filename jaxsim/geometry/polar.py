"""Points to polar raster and back.

Letters: a azimuth, falling from column to column; e elevation and h height of origin of the beam of a row; r
range from that origin. A cell's point is (r cos e cos a, r cos e sin a, h + r sin e). Column i has its centre
at the float column i, its edges at i - 1/2 and i + 1/2.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jaxsim.frame import Array, Cloud, PolarGrid, PolarImage
from jaxsim.products import matmul

_Tree = TypeVar("_Tree")
FILLED_TO = 2**15
"""Clouds are filled up to multiples of this, so that kernels are compiled once and not for every frame."""
_NOTHING = 2**31 - 1
_TAN_PI_8 = 0.41421356
_TINY = 1e-30
_STEEPEST_RAD = math.pi / 2 - 1e-6


def _step_rad(grid: PolarGrid) -> Float[Array, ""]:
    columns = grid.azimuth_rad.shape[0]
    return (grid.azimuth_rad[0] - grid.azimuth_rad[-1]) / (columns - 1)


def spans_turn(grid: PolarGrid) -> Bool[Array, ""]:
    """Whether the last column is followed by the first."""
    columns = grid.azimuth_rad.shape[0]
    between = jnp.abs(grid.azimuth_rad[0] - grid.azimuth_rad[-1])
    step = between / max(columns - 1, 1)
    # Half a step of slack for grids whose azimuths are rounded.
    return between + step > 2 * jnp.pi - step / 2


def exact_column(azimuth_rad: Float[Array, "*b"], grid: PolarGrid) -> Float[Array, "*b"]:
    """Column of an azimuth, in the precision of both: whole at cell centres, below -1/2 or above columns - 1/2 outside
    the window.

    Azimuths are taken modulo a turn, to the side of the window that is nearer.
    """
    columns = grid.azimuth_rad.shape[0]
    centre = (grid.azimuth_rad[0] + grid.azimuth_rad[-1]) / 2
    right = centre - azimuth_rad
    right = right - 2 * math.pi * (right / (2 * math.pi)).round()
    return right / _step_rad(grid) + (columns - 1) / 2


column_of = jax.jit(exact_column)
"""`exact_column` on the device."""


@jax.jit
def azimuth_of(x: Float[Array, "*b"], y: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """atan2(y, x) in radians within 3e-7: as exact as XLA's own on CPU and four times as fast."""
    ax, ay = jnp.abs(x), jnp.abs(y)
    less, more = jnp.minimum(ax, ay), jnp.maximum(ax, ay)
    # Beyond tan(pi/8): atan(q) = pi/4 + atan((q - 1) / (q + 1)), which leaves |t| <= tan(pi/8) in both cases.
    beyond = less > more * _TAN_PI_8
    t = jnp.where(beyond, less - more, less) / jnp.maximum(jnp.where(beyond, less + more, more), _TINY)
    s = t * t
    # Minimax fit of (atan(t) - t) / t^3 in t^2 there; the largest error in atan is 5e-9.
    p = s * (s * (s * 0.07902598 - 0.13824454) + 0.19971879) - 0.33332757
    angle = t * s * p + t
    angle = jnp.where(beyond, angle + jnp.pi / 4, angle)
    angle = jnp.where(ay > ax, jnp.pi / 2 - angle, angle)
    angle = jnp.where(x < 0, jnp.pi - angle, angle)
    return jnp.where(y < 0, -angle, angle)


def cell_column(azimuth_rad: Float[Array, "*b n"], grid: PolarGrid) -> Int[Array, "*b n"]:
    """Whole column; outside the window it is negative or too large."""
    column = jnp.floor(column_of(azimuth_rad, grid) + 0.5).astype(jnp.int32)
    # Rounding must not push azimuths beside the cut out of a grid that spans the turn, on neither side.
    turn = jnp.round(2 * jnp.pi / _step_rad(grid)).astype(jnp.int32)
    return jnp.where((column == -1) | (column == turn), jnp.mod(column, turn), column)


@partial(jax.jit, static_argnames="shape")
def scatter_nearest(
    range_m: Float[Array, "*b n"] | Int[Array, "*b n"],
    row: Int[Array, "*b n"],
    column: Int[Array, "*b n"],
    *,
    inside: Bool[Array, "*b n"],
    shape: tuple[int, int],
) -> tuple[Int[Array, "*b rows columns"], Bool[Array, "*b rows columns"]]:
    """Index of each cell's nearest point, the first of equals (0 where there is none), and whether it has one.

    Points that are not `inside`, or whose row or column is not in `shape`, are left out. Ranges are compared
    as float32 and must be finite and not negative where `inside`; whole numbers in their place (int32) may be. Two
    scatter-min passes over int32, the range's bits and then the index: no sort, no 64-bit words.
    """
    *batch, _ = range_m.shape
    rows, columns = shape
    frames = math.prod(batch)
    cells = frames * rows * columns
    inside = inside & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    cell = (row * columns + column).astype(jnp.int32)
    if batch:
        first = jnp.arange(frames, dtype=jnp.int32).reshape(*batch, 1) * (rows * columns)
        cell = cell + jnp.broadcast_to(first, cell.shape)
    cell = jnp.where(inside, cell, cells).ravel()
    if not jnp.issubdtype(range_m.dtype, jnp.integer):
        # Floats that are not negative are ordered like their bits read as integers.
        range_m = jax.lax.bitcast_convert_type(range_m.astype(jnp.float32), jnp.int32)
    bits = range_m.ravel()
    nothing = jnp.full(cells, _NOTHING, jnp.int32)
    nearest = nothing.at[cell].min(bits, mode="drop")
    wins = bits == nearest.at[cell].get(mode="fill", fill_value=-1)
    index = jax.lax.broadcasted_iota(jnp.int32, range_m.shape, len(batch)).ravel()
    winner = nothing.at[jnp.where(wins, cell, cells)].min(index, mode="drop")
    valid = (winner != _NOTHING).reshape(*batch, rows, columns)
    return jnp.where(valid, winner.reshape(valid.shape), 0), valid


@jax.jit
def points_to_polar(cloud: Cloud, grid: PolarGrid) -> tuple[PolarImage, Int[Array, "*b rows columns"]]:
    """Puts each point into its cell, the nearest wins; also the winner's index in the cloud, 0 where not valid.

    `cloud.row` counts from the grid's first row: shift it for a window. The column follows from the azimuth,
    the range from the beam's own origin. Points that are not valid or not finite, lie outside the grid or at the
    cloud's origin, where files have what did not return, are left out. Raises ValueError for a cloud without rows.
    """
    if cloud.row is None:
        raise ValueError(
            "points_to_polar: the cloud has no rows; set cloud.row (recover_rows for a file that lies line by line, "
            "rows_by_elevation for others)"
        )
    rows, columns = grid.elevation_rad.shape[0], grid.azimuth_rad.shape[0]
    row = cloud.row.astype(jnp.int32)
    x = cloud.xyz_m[..., 0]
    y = cloud.xyz_m[..., 1]
    z = cloud.xyz_m[..., 2] - grid.origin_m[jnp.clip(row, 0, rows - 1)]
    square = x * x + y * y + z * z
    inside = cloud.valid & jnp.isfinite(square) & (square > 0) & jnp.any(cloud.xyz_m != 0, axis=-1)
    # Padding lies at the origin, where the root has no derivative.
    range_m = jnp.sqrt(jnp.where(square > 0, square, jnp.ones_like(square)))
    range_m = jnp.where(square > 0, range_m, jnp.zeros_like(square))
    column = cell_column(azimuth_of(x, y), grid)
    winner, valid = scatter_nearest(range_m, row, column, inside=inside, shape=(rows, columns))
    flat = winner.reshape(*winner.shape[:-2], rows * columns)

    def pick(values: Float[Array, "*b n"]) -> Float[Array, "*b rows columns"]:
        picked = jnp.take_along_axis(values, flat, axis=-1, mode="clip").reshape(winner.shape)
        return jnp.where(valid, picked, jnp.zeros_like(picked))

    return PolarImage(pick(range_m), pick(cloud.intensity), valid), winner


def _rays(grid: PolarGrid) -> Float[Array, "rows columns_by_3"]:
    # A matrix product: XLA would compute a broadcast cosine again in every cell, which takes three times as long.
    ca, sa = jnp.cos(grid.azimuth_rad), jnp.sin(grid.azimuth_rad)
    beams = jnp.stack([jnp.cos(grid.elevation_rad), jnp.sin(grid.elevation_rad)], axis=-1)
    level = jnp.stack([ca, sa, jnp.zeros_like(ca)], axis=-1)
    upright = jnp.stack([jnp.zeros_like(ca), jnp.zeros_like(ca), jnp.ones_like(ca)], axis=-1)
    turn = jnp.stack([level.ravel(), upright.ravel()])
    return matmul(beams, turn)


@jax.jit
def directions(grid: PolarGrid) -> Float[Array, "rows columns 3"]:
    """Unit ray of every cell's centre."""
    return _rays(grid).reshape(grid.elevation_rad.shape[0], grid.azimuth_rad.shape[0], 3)


@jax.jit
def polar_to_points(image: PolarImage, grid: PolarGrid, *, rays: Float[Array, "rows columns 3"] | None = None) -> Cloud:
    """The cloud of a raster, one point a cell, at the cells' centres; row counts from the grid's first row.

    `rays` are `directions(grid)`: kept over many single frames, they halve the time.
    """
    *batch, rows, columns = image.range_m.shape
    wide, flat = (*batch, rows, columns * 3), (*batch, rows * columns)
    range_m = jnp.broadcast_to(image.range_m[..., None], (*image.range_m.shape, 3)).reshape(wide)
    upright = jnp.tile(jnp.array([0.0, 0.0, 1.0], range_m.dtype), columns)
    kept = _rays(grid) if rays is None else rays.reshape(rows, columns * 3)
    rise = jnp.broadcast_to(grid.origin_m[:, None] * upright[None, :], wide)
    xyz = range_m * jnp.broadcast_to(kept, wide) + rise
    row = jax.lax.broadcasted_iota(jnp.int32, image.range_m.shape, len(batch))
    return Cloud(xyz.reshape(*flat, 3), image.intensity.reshape(flat), image.valid.reshape(flat), row.reshape(flat))


def _raster_axis(tree: object, batch_dims: int | None) -> int:
    """Axis of the rows in every leaf; raises ValueError where the leaves are not rasters of one size."""
    shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(tree)]
    axis = min(map(len, shapes)) - 2 if batch_dims is None else batch_dims
    if axis < 0 or any(shape[: axis + 2] != shapes[0][: axis + 2] for shape in shapes):
        raise ValueError(
            f"rasters of one tree must share their shape up to rows and columns, got {sorted(set(shapes))}; "
            "leaves are (*b, rows, columns) or (*b, rows, columns, c), pass batch_dims where all have channels"
        )
    return axis


def _sources(old: int, new: int) -> Int[np.ndarray, " new"]:
    # The centre of new cell i lies (i + 1/2) old / new old cells from the edge.
    return (2 * np.arange(new) + 1) * old // (2 * new)


def resample(image: _Tree, size: tuple[int, int], *, batch_dims: int | None = None) -> _Tree:
    """Each new cell takes the value of the old cell that its centre falls into. Enlarging and going back gives
    the original.

    Leaves are (*b, rows, columns) or (*b, rows, columns, c); `batch_dims` says how many dims lead, which is told from
    the leaves if one of them has no channels. Raises ValueError where they are not rasters of one size.
    """
    axis = _raster_axis(image, batch_dims)

    def take(leaf: Array) -> Array:
        rows = _sources(leaf.shape[axis], size[0])
        columns = _sources(leaf.shape[axis + 1], size[1])
        return leaf[(slice(None),) * axis + (rows[:, None], columns[None, :])]

    return jax.tree.map(take, image)


def with_neighbours(grid: PolarGrid) -> PolarGrid:
    """The grid with one more beam above and one below, as far off as the next; of one beam alone, as columns are."""
    beams = jnp.stack([jnp.asarray(grid.elevation_rad), jnp.asarray(grid.origin_m)])
    first, last = beams[:, :1], beams[:, -1:]
    if beams.shape[1] > 1:
        after, before = beams[:, 1:2], beams[:, -2:-1]
    else:
        # Nothing tells how high a single beam's cell is: it is as high as it is wide.
        step = jnp.stack([_step_rad(grid), jnp.zeros((), beams.dtype)])[:, None]
        after, before = first - step, last + step
    elevation_rad, origin_m = jnp.concatenate([2 * first - after, beams, 2 * last - before], axis=1)
    return PolarGrid(grid.azimuth_rad, elevation_rad, origin_m)


def beam_slopes(grid: PolarGrid) -> Float[Array, " rows"]:
    """Tangent of each beam's elevation. A beam at the zenith or past it, as the neighbour of a dome's top beam is, goes
    as steeply up as a float tells, and so at the nadir: their tangents would change sign, and no row could be counted.
    """
    return jnp.tan(jnp.clip(grid.elevation_rad, -_STEEPEST_RAD, _STEEPEST_RAD))


@jax.jit
def rows_of(xyz_m: Float[Array, "*b n 3"], grid: PolarGrid) -> Int[Array, "*b n"]:
    """The beam that passes nearest in angle, each seen from its own origin, however far off.

    Beams must not cross: where elevations fall, origins must not rise (but for the millimetres of a fit).
    """
    rows = grid.elevation_rad.shape[0]
    x = xyz_m[..., 0]
    y = xyz_m[..., 1]
    z = xyz_m[..., 2]
    rho = jnp.sqrt(x * x + y * y)
    slope = beam_slopes(grid)
    ce = jnp.cos(grid.elevation_rad)
    se = jnp.sin(grid.elevation_rad)
    # How many beams pass above tells the two nearest ones; unrolled, the count is one loop over the points.
    above = jnp.zeros(z.shape, jnp.int32)
    for i in range(rows):
        above += (z < grid.origin_m[i] + rho * slope[i]).astype(jnp.int32)

    def off(row: Int[Array, "*b n"]) -> Float[Array, "*b n"]:
        """|tan of half the angle between point and beam|: grows with the angle all the way."""
        rise = z - grid.origin_m[row]
        sine, cosine = rise * ce[row] - rho * se[row], rho * ce[row] + rise * se[row]
        return jnp.abs(sine) / (jnp.sqrt(rho * rho + rise * rise) + cosine)

    upper, lower = jnp.maximum(above - 1, 0), jnp.minimum(above, rows - 1)
    return jnp.where(off(upper) <= off(lower), upper, lower)


def pad_cloud(cloud: Cloud, multiple: int = FILLED_TO) -> Cloud:
    """The cloud (n points, host memory) with invalid points behind it, filled up to a multiple."""
    missing = -cloud.intensity.shape[-1] % multiple
    return jax.tree.map(lambda leaf: _followed_by(leaf, missing), cloud)


def pad_points(
    points: Float[np.ndarray, "n c"], room: int
) -> tuple[Float[np.ndarray, "room c"], Bool[np.ndarray, " room"]]:
    """Points with zeros behind them, and which of them are real; `room` is n or more."""
    padded = _followed_by(np.asarray(points, np.float32), room - len(points))
    return padded, np.arange(room) < len(points)


def _followed_by(values: Shaped[np.ndarray, "n *c"], missing: int) -> Shaped[np.ndarray, "m *c"]:
    """Values with so many zeros behind the last."""
    return np.pad(values, [(0, missing), *[(0, 0)] * (values.ndim - 1)])


def room_for(points: int, multiple: int = FILLED_TO) -> int:
    """The least multiple, one at least, that holds so many points."""
    return max(-(-points // multiple), 1) * multiple


def scan_on_window(cloud: Cloud, grid: PolarGrid, row_share: Float[np.ndarray, " rows"], *, lines: int) -> PolarImage:
    """The image of a sweep on a window of its sensor's lines (host memory).

    `cloud.row` counts from the sensor's top line, of `lines` in all; `row_share` is each of the window's beams among
    them, 0 the top line and 1 the bottom one. Raises ValueError for a cloud without rows.
    """
    if cloud.row is not None:
        # The grid's rows count from the window's own first line.
        first = round(float(row_share[0]) * (lines - 1))
        cloud = replace(cloud, row=(cloud.row - first).astype(np.int32))
    return jax.device_get(points_to_polar(pad_cloud(cloud), grid)[0])
