"""What the camera saw and the LiDAR did not: both stand in different places, so in the camera's image a near
surface does not hide all of what it hides from the LiDAR. Such pixels fall into the near surface's cell.

About 26 pixels share a cell, so it is their depth that tells, not their number; and they differ rightly where
a surface is seen at a slant: a cell of the road spans r^2 / height x beam spacing, 10 % of the range at 40 m.
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
def occluded(
    nearest_m: Float[Array, "*b rows columns"],
    farthest_m: Float[Array, "*b rows columns"],
    valid: Bool[Array, "*b rows columns"],
    occlusion_m: Float[Array, ""] | float,
) -> Bool[Array, "*b rows columns"]:
    """Cells whose pixels lie on more than one surface, given the range of their nearest and farthest pixel.

    They differ by more than `occlusion_m`, or a tenth of the range if that is more, plus one and a half
    times the change per cell of the surface in front, along rows and columns.
    """
    slant = _slope(nearest_m, valid, -2) + _slope(nearest_m, valid, -1)
    allowed_m = jnp.maximum(occlusion_m, _RELATIVE * nearest_m) + _SLANT * slant
    return valid & (farthest_m - nearest_m > allowed_m)


def _slope(
    range_m: Float[Array, "*b rows columns"], valid: Bool[Array, "*b rows columns"], axis: int
) -> Float[Array, "*b rows columns"]:
    """Change per cell of the surface a cell lies on, without its sign.

    The smaller of the changes to both neighbours, and none where they have different signs (a pole before a
    house, a gap): a limited slope does not reach over an edge. Only one neighbour known: the change to it.
    """
    before, after = (jnp.roll(range_m, k, axis) for k in (1, -1))
    size = range_m.shape[axis]
    place = jax.lax.broadcasted_iota(jnp.int32, range_m.shape, range_m.ndim + axis)
    has_before = jnp.roll(valid, 1, axis) & (place > 0)
    has_after = jnp.roll(valid, -1, axis) & (place < size - 1)
    a, b = range_m - before, after - range_m
    both = jnp.where(a * b > 0, jnp.minimum(jnp.abs(a), jnp.abs(b)), 0)
    one = jnp.where(has_before, jnp.abs(a), jnp.where(has_after, jnp.abs(b), 0))
    return jnp.where(has_before & has_after, both, one)
