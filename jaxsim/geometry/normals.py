"""Surface normals and incidence angles from a range image.

The tangent along a row (and along a column) is a mean of the steps to both neighbours, weighted to the side where the
range changes less: on a plane any mix lies in the plane, at an edge the step across it counts for nothing.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxsim.frame import Array, PolarGrid
from jaxsim.geometry.polar import azimuth_of, directions, spans_turn

_NOISE_M = 1e-2
"""Range steps below this count alike: both sides are averaged."""


def _tangent(
    points: Float[Array, "*b r c 3"],
    range_m: Float[Array, "*b r c"],
    valid: Bool[Array, "*b r c"],
    *,
    axis: int,
    wraps: Bool[Array, ""],
) -> tuple[Float[Array, "*b r c 3"], Bool[Array, "*b r c"]]:
    size = range_m.shape[axis]
    index = jax.lax.broadcasted_iota(jnp.int32, range_m.shape, range_m.ndim + axis)
    total, known = jnp.zeros_like(points), jnp.zeros_like(valid)
    for shift, border in ((1, 0), (-1, size - 1)):
        near = jnp.roll(valid, shift, axis) & valid & ((index != border) | wraps)
        step = (points - jnp.roll(points, shift, axis - 1)) * shift
        jump = jnp.where(near, range_m - jnp.roll(range_m, shift, axis), jnp.zeros_like(range_m))
        # Inverse squares: a step across an edge of 1 m weighs 1e-4 of one on a smooth surface.
        weight = jnp.where(near, 1 / (jump * jump + _NOISE_M**2), jnp.zeros_like(range_m))
        total = total + jnp.where(near[..., None], step, jnp.zeros_like(step)) * weight[..., None]
        known = known | near
    return total, known


@jax.jit
def normals(
    range_m: Float[Array, "*b r c"], valid: Bool[Array, "*b r c"], grid: PolarGrid
) -> tuple[Float[Array, "*b r c 3"], Bool[Array, "*b r c"]]:
    """Unit normals on the sensor's side of the surface, and where they are known.

    A cell needs a neighbour that came back in its row and one in its column. Rows of a grid that spans the turn
    close on themselves.
    """
    lead = (1,) * (range_m.ndim - 2)
    ray = jnp.broadcast_to(directions(grid).reshape(*lead, *range_m.shape[-2:], 3), (*range_m.shape, 3))
    rise = jnp.stack([jnp.zeros_like(grid.origin_m)] * 2 + [grid.origin_m], axis=-1).reshape(*lead, -1, 1, 3)
    points = ray * range_m[..., None] + rise
    along, along_known = _tangent(points, range_m, valid, axis=-1, wraps=spans_turn(grid))
    down, down_known = _tangent(points, range_m, valid, axis=-2, wraps=jnp.zeros((), bool))
    normal = jnp.cross(along, down)
    length = jnp.sqrt(jnp.sum(normal * normal, axis=-1))
    known = along_known & down_known & (length > 0) & jnp.isfinite(length)
    # The cross product's sign depends on how range runs; a surface that is hit faces the sensor.
    outward = jnp.where(jnp.sum(normal * ray, axis=-1) > 0, -1.0, 1.0).astype(normal.dtype)
    scale = outward / jnp.where(known, length, jnp.ones_like(length))
    return jnp.where(known[..., None], normal * scale[..., None], jnp.zeros_like(normal)), known


@jax.jit
def incidence(
    range_m: Float[Array, "*b r c"], valid: Bool[Array, "*b r c"], grid: PolarGrid
) -> tuple[Float[Array, "*b r c"], Bool[Array, "*b r c"]]:
    """Angle in radians between ray and surface normal, 0 = head on, and where it is known."""
    normal, known = normals(range_m, valid, grid)
    ray = jnp.broadcast_to(directions(grid).reshape((1,) * (range_m.ndim - 2) + (*range_m.shape[-2:], 3)), normal.shape)
    across = jnp.cross(normal, ray)
    square = jnp.sum(across * across, axis=-1)
    # Not the arccosine of the product, which is off by 3e-4 near head on and has no derivative there.
    slant = square > 1e-12
    sine = jnp.where(slant, jnp.sqrt(jnp.where(slant, square, jnp.ones_like(square))), jnp.zeros_like(square))
    return azimuth_of(jnp.abs(jnp.sum(normal * ray, axis=-1)), sine), known


def network_incidence(
    range_m: Float[Array, "*b r c"], valid: Bool[Array, "*b r c"], grid: PolarGrid
) -> Float[Array, "*b r c"]:
    """Angle of incidence as networks are given it, in training and in use: a right angle where it is not known, which
    is wherever nothing is seen, too."""
    return known_or_right(*incidence(range_m, valid, grid))


def known_or_median(angle_rad: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """The angles that are known, and for the others the median of these, 0 where there is none: a cell without
    neighbours, on a pole or at a border, may face anywhere, and at a common angle effects of the incidence act on it
    as on most."""
    middle = np.median(angle_rad[known]) if known.any() else 0
    return np.where(known, angle_rad, middle).astype(np.float32)


def known_or_right(angle_rad: Float[Array, "*b r c"], known: Bool[Array, "*b r c"]) -> Float[Array, "*b r c"]:
    """The angles that are known, and a right angle for the others."""
    return jnp.where(known, angle_rad, jnp.full_like(angle_rad, jnp.pi / 2))
