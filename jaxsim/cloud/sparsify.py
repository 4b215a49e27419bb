"""Dense clouds to the laser lines of a LiDAR: one point a cell of rows and columns.

Cells are those of any `PolarGrid` (a real sensor's beams, each from its own origin), or the even angles of
Pseudo-LiDAR++ (You et al. 2020, kitti_sparsify): 64 lines 0.4 degrees apart from +2 degrees down, 512 columns over the
90 degrees ahead. The paper's "32 lines" can be read in two ways: every second of those lines (11,437 points of a KITTI
scan), or lines twice as far apart (14,654); both are here.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Float, Int

from jaxsim.frame import Array, Cloud, PolarGrid
from jaxsim.geometry import azimuth_of, cell_column, rows_of, scatter_nearest, with_neighbours

Winner = Literal["nearest", "last"]


@struct.dataclass
class EvenLines:
    """Cells of equal angles seen from the origin of `velo`, ahead of it."""

    rows: int = struct.field(pytree_node=False, default=64)
    columns: int = struct.field(pytree_node=False, default=512)
    top_deg: float = struct.field(pytree_node=False, default=2.0)
    """Upper edge of the first row."""
    step_deg: float = struct.field(pytree_node=False, default=0.4)
    """Between rows."""
    left_deg: float = struct.field(pytree_node=False, default=45.0)
    """Left edge of the first column; the last ends as far to the right."""


PATTERNS: dict[str, tuple[EvenLines, tuple[int, ...] | None]] = {
    "64": (EvenLines(), None),
    "32_of_64": (EvenLines(), tuple(range(0, 64, 2))),
    "32_wide": (EvenLines(rows=32, step_deg=0.8), None),
    "64_fine": (EvenLines(columns=1024), None),
}
"""The published settings: cells, and which of their rows to keep (None: all). `64_fine` is that of its graph-based
depth correction."""

PUBLISHED_RANGE_M = ((0.0, 120.0), (-50.0, 50.0), (-2.5, 1.5))
"""Where the published program looks at all: x, y, z from (included) and to (excluded)."""


@jax.jit
def crop_cloud(cloud: Cloud) -> Cloud:
    """The cloud with only the points inside PUBLISHED_RANGE_M valid."""
    inside = cloud.valid
    for axis, (low, high) in enumerate(PUBLISHED_RANGE_M):
        inside = inside & (cloud.xyz_m[..., axis] >= low) & (cloud.xyz_m[..., axis] < high)
    return replace(cloud, valid=inside)


@partial(jax.jit, static_argnames=("beams", "winner", "clamp"))
def sparsify(
    cloud: Cloud,
    cells: PolarGrid | EvenLines,
    *,
    beams: tuple[int, ...] | None = None,
    winner: Winner = "nearest",
    clamp: bool = False,
) -> Cloud:
    """One point of `cloud` a cell, unchanged, rows first; `row` counts the cells' rows from the top.

    Where several fall into a cell the `nearest` wins, as of all that a ray may meet; `last` takes the last in the
    cloud's order, as the published program does. Points beyond the cells are left out; with `clamp` they go into the
    border cells, as there, where they pile up. Only the rows `beams` are given out (all by default).

    Drop points before: a cell's winner is chosen among the valid ones. Raises ValueError for a beam that the cells do
    not have, and for other winners.
    """
    if winner not in ("nearest", "last"):
        raise ValueError(f"sparsify: winner is {winner!r}; it is 'nearest' or 'last'")
    shape = _shape(cells)
    if beams is not None and (not beams or min(beams) < 0 or max(beams) >= shape[0]):
        raise ValueError(f"sparsify: beams {beams} do not lie in the {shape[0]} rows of the cells (0..{shape[0] - 1})")
    xyz = cloud.xyz_m
    # Not finite where any coordinate is not.
    square = (xyz * xyz).sum(axis=-1)
    usable = cloud.valid & jnp.isfinite(square)
    row, column = _even_cell(xyz, cells) if isinstance(cells, EvenLines) else _beam_cell(xyz, cells)
    if clamp:
        row, column = jnp.clip(row, 0, shape[0] - 1), jnp.clip(column, 0, shape[1] - 1)
    else:
        usable = usable & (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    if winner == "nearest":
        index, filled = scatter_nearest(jnp.sqrt(jnp.where(usable, square, 0)), row, column, inside=usable, shape=shape)
    else:
        # The later a point comes, the nearer it counts.
        order = jax.lax.broadcasted_iota(jnp.int32, square.shape, square.ndim - 1)
        index, filled = scatter_nearest(-order, row, column, inside=usable, shape=shape)
    lines = jnp.asarray(range(shape[0]) if beams is None else beams, jnp.int32)
    if beams is not None:
        # Winners are chosen on all lines first: which point is nearest does not depend on the lines that are kept.
        index, filled = index[..., lines, :], filled[..., lines, :]
    *batch, rows, columns = index.shape
    flat, place = (*batch, rows * columns), index.reshape(*batch, rows * columns)
    return Cloud(
        jnp.take_along_axis(xyz, place[..., None], axis=-2, mode="clip"),
        jnp.take_along_axis(cloud.intensity, place, axis=-1, mode="clip"),
        filled.reshape(flat),
        jnp.broadcast_to(lines[:, None], index.shape).reshape(flat),
    )


def _shape(cells: PolarGrid | EvenLines) -> tuple[int, int]:
    if isinstance(cells, EvenLines):
        return cells.rows, cells.columns
    return cells.elevation_rad.shape[0], cells.azimuth_rad.shape[0]


def _even_cell(xyz: Float[Array, "*b n 3"], cells: EvenLines) -> tuple[Int[Array, "*b n"], Int[Array, "*b n"]]:
    """Whole row and column from the angles; negative or too large outside."""
    x = xyz[..., 0]
    y = xyz[..., 1]
    z = xyz[..., 2]
    left = math.radians(cells.left_deg)
    top = math.radians(cells.top_deg)
    step = math.radians(cells.step_deg)
    elevation = azimuth_of(jnp.sqrt(x * x + y * y), z)
    # Cut off, not rounded: `top` and `left` are borders of the first cell.
    row = jnp.floor((top - elevation) / step)
    column = jnp.floor((left - azimuth_of(x, y)) / (2 * left / cells.columns))
    return row.astype(jnp.int32), column.astype(jnp.int32)


def _beam_cell(xyz: Float[Array, "*b n 3"], grid: PolarGrid) -> tuple[Int[Array, "*b n"], Int[Array, "*b n"]]:
    """The beam that passes nearest and the column; -1 or too large for points more than half a step outside."""
    column = cell_column(azimuth_of(xyz[..., 0], xyz[..., 1]), grid)
    # Points nearer to the neighbours lie outside the sensor's beams; the first of them is the neighbour above.
    return rows_of(xyz, with_neighbours(grid)) - 1, column
