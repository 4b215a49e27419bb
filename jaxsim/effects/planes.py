"""The planes of which a range image is made: at each cell, how steeply the surface leaves the sphere about the sensor.

Letters: q = 1/r of a cell, linear in the ray's direction on a plane; u, v slopes of the surface, so that q (1, u, v)
is the plane's normal over its distance, in the basis of the cell's ray, its left and its up.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.effects.edits import wrapped
from jaxsim.effects.rays import Array, spans_turn
from jaxsim.frame import PolarGrid

_SAME = 1e-3
"""Relative error of a range below which a neighbour continues the plane."""
_ROUGH = 0.03
"""Above it no neighbour continues the surface, which is then taken to face the ray."""
# A cell, then two cells each up, down, left and right of it: the near ones and the far ones.
_DOWN = np.array([0, -1, 1, 0, 0, -2, 2, 0, 0], np.int32)
_RIGHT = np.array([0, 0, 0, -1, 1, 0, 0, -2, 2], np.int32)
_NEAR, _BEYOND = slice(1, 5), slice(5, 9)


def on_turn(column: Int[Array, "*n"], columns: int, full: Bool[Array, ""]) -> Int[Array, "*n"]:
    """Columns that lie in the image: past the border of a full turn those of its other side, else the border's."""
    return jnp.where(full, column % columns, jnp.clip(column, 0, columns - 1))


@jax.jit
def slopes_of(grid: PolarGrid, range_m: Float[Array, "r c"], hit: Bool[Array, "r c"]) -> Float[Array, "r c 2"]:
    """The slopes u and v of every cell's surface, from those neighbours that continue its plane.

    To each side the next cell gives a slope and the one after tells whether it is the same plane's. Weights as in
    WENO schemes: a corner takes the slope of its own side, a lone pole none.
    """
    rows, columns = range_m.shape
    azimuth, elevation = grid.azimuth_rad, grid.elevation_rad
    row, column = jnp.meshgrid(jnp.arange(rows), jnp.arange(columns), indexing="ij")
    down = jnp.asarray(_DOWN)[:, None, None]
    right = jnp.asarray(_RIGHT)[:, None, None]
    i = jnp.clip(row[None] + down, 0, rows - 1)
    j = on_turn(column[None] + right, columns, spans_turn(grid))
    returned = hit[i, j]
    far = jnp.where(returned, range_m[i, j], jnp.inf)
    r = jnp.where(returned[0], far[0], 1.0)
    # Neighbours past a border repeat the border.
    valid = returned & returned[:1]
    valid = valid & ((i != row[None]) | (j != column[None]))
    continued = valid[_BEYOND] & ((i[_BEYOND] != i[_NEAR]) | (j[_BEYOND] != j[_NEAR]))
    ratio = r[None] / jnp.where(returned, far, 1.0)
    e = elevation[row][None]
    de, da = elevation[i] - e, wrapped(azimuth[j] - azimuth[column][None])

    def slope(near: slice, beyond: slice, even: Array, odd: Array) -> Array:
        """The slope that near and far neighbours give: on a plane a neighbour's ratio is even + slope * odd."""
        value = (ratio[near] - even[near]) / jnp.where(valid[near], odd[near], 1.0)
        rough = ratio[beyond] - even[beyond] - value * odd[beyond]
        rough = jnp.where(continued[near.start - 1 : near.stop - 1], rough, ratio[near] - even[near])
        weight = jnp.where(valid[near], 1 / jnp.square(rough * rough + _SAME**2), 0.0)
        flat = 1 / (_ROUGH**2 + _SAME**2) ** 2
        return jnp.sum(jnp.where(valid[near], value, 0.0) * weight, axis=0) / (jnp.sum(weight, axis=0) + flat)

    v = slope(slice(1, 3), slice(5, 7), jnp.cos(de), jnp.sin(de))
    versine = 2 * jnp.square(jnp.sin(da / 2))
    even = 1 - versine * jnp.cos(e) * (jnp.cos(e) - v[None] * jnp.sin(e))
    u = slope(slice(3, 5), slice(7, 9), even, jnp.cos(e) * jnp.sin(da))
    return jnp.stack([u, v], axis=-1)
