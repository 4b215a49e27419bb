"""What the camera saw and the LiDAR did not: both stand in different places, so in the camera's image a near
surface does not hide all of what it hides from the LiDAR. Such pixels fall into the near surface's cell.

About 26 pixels share a cell, so it is their depth that tells, not their number; and they differ rightly where
a surface is seen at a slant: a cell of the road spans r^2 / height x beam spacing, 13 % of the range at 40 m.
That span is known from the cells around: it is what the range changes by from one cell to the next.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxsim.frame import Array

_RELATIVE = 0.1
_SLANT = 1.5  # the farther half of a cell of road spans more than the step to the nearer neighbour


@jax.jit
def surface_depth(
    nearest_m: Float[Array, "*b rows columns"],
    valid: Bool[Array, "*b rows columns"],
    occlusion_m: Float[Array, ""] | float,
) -> Float[Array, "*b rows columns"]:
    """By how much the pixels of one surface may differ in range within a cell, in metres.

    `occlusion_m`, or a tenth of the range if that is more, plus one and a half times the change per cell of
    the surface in front, along rows and columns. Pixels that differ by more lie on different surfaces: the
    cell is occluded.
    """
    slant = _slope(nearest_m, valid, -2) + _slope(nearest_m, valid, -1)
    return jnp.maximum(occlusion_m, _RELATIVE * nearest_m) + _SLANT * slant


def _slope(
    range_m: Float[Array, "*b rows columns"], valid: Bool[Array, "*b rows columns"], axis: int
) -> Float[Array, "*b rows columns"]:
    """Change per cell of the surface a cell lies on, without its sign.

    The smaller of the changes to both neighbours, and none where they have different signs (a pole before a
    house, a gap): a limited slope does not reach over an edge. Only one neighbour known: the change to it.
    """
    before = jnp.roll(range_m, 1, axis)
    after = jnp.roll(range_m, -1, axis)
    place = jax.lax.broadcasted_iota(jnp.int32, range_m.shape, range_m.ndim + axis)
    has_before = jnp.roll(valid, 1, axis) & (place > 0)
    has_after = jnp.roll(valid, -1, axis) & (place < range_m.shape[axis] - 1)
    a, b = jnp.abs(range_m - before), jnp.abs(after - range_m)
    falls_or_rises = (range_m - before) * (after - range_m) > 0
    both = jnp.where(falls_or_rises, jnp.minimum(a, b), jnp.zeros_like(a))
    one = jnp.where(has_before, a, jnp.where(has_after, b, jnp.zeros_like(a)))
    return jnp.where(has_before & has_after, both, one)
