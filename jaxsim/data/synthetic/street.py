"""The ground: a road between kerbs, side streets, pavements, and terrain behind them.

Letters: x along the street at the ego car, y to its left. The middle of the road is y = c x^2 / 2; `aside` is the
distance from it, positive to the left. The ground has two levels: the road at 0, all else at the kerb's height.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float

from jaxsim.data.synthetic.vectors import vector
from jaxsim.frame import Array

SIDE_STREETS = 2
ROUNDING_M = 3.0
"""How far kerbs are rounded where a side street meets the road."""
HALVINGS = 6


@struct.dataclass
class Street:
    """Measures of one street."""

    curvature: Float[Array, ""]
    half_width_m: Float[Array, ""]
    kerb_m: Float[Array, ""]
    pavement_m: Float[Array, ""]
    """Width of the pavement; terrain lies behind it."""
    parking: Float[Array, ""]
    """1 where bays are marked along the kerbs, else 0."""
    side_x_m: Float[Array, " sides"]
    side_half_m: Float[Array, " sides"]
    """Half width of each side street; negative: there is none."""
    side_towards: Float[Array, " sides"]
    """1 to the left, -1 to the right."""
    crossing_x_m: Float[Array, ""]
    """Middle of a zebra crossing."""
    wear: Float[Array, ""]
    """How worn the surface and its markings are, 0..1."""
    tone: Float[Array, ""]
    """Brightness of the asphalt, 0..1."""
    green: Float[Array, ""]
    """1 where lawn lies behind the pavement, 0 where it is paved."""
    seed: Float[Array, ""]


def aside(street: Street, x: Float[Array, "*r"], y: Float[Array, "*r"]) -> Float[Array, "*r"]:
    """Distance to the left of the road's middle, metres."""
    slope = street.curvature * x
    return (y - 0.5 * slope * x) / jnp.sqrt(1.0 + slope * slope)


def past_kerb(street: Street, x: Float[Array, "*r"], y: Float[Array, "*r"]) -> Float[Array, "*r"]:
    """Distance beyond the kerb, metres; negative on the road and in side streets."""
    off = aside(street, x, y)
    distance = jnp.abs(off) - street.half_width_m
    for i in range(SIDE_STREETS):
        side = jnp.maximum(jnp.abs(x - street.side_x_m[i]) - street.side_half_m[i], -street.side_towards[i] * off)
        side = jnp.where(street.side_half_m[i] > 0.0, side, 1e3)
        # A smooth minimum rounds the corner between the two kerbs.
        overlap = jnp.maximum(ROUNDING_M - jnp.abs(distance - side), 0.0) / ROUNDING_M
        distance = jnp.minimum(distance, side) - overlap * overlap * ROUNDING_M * 0.25
    return distance


def cast_ground(
    street: Street, origin: Float[Array, "3 *o"], direction: Float[Array, "3 *r"]
) -> tuple[Float[Array, "*r"], Bool[Array, "*r"], Bool[Array, "*r"]]:
    """Ray parameter of the hit with the ground, whether there is one, and whether it is the kerb's face.

    A ray that clears the upper level over the road and lies under it at the lower level has met a kerb's face: the
    place comes from a bracketed search along the ray.
    """
    ox, oy, oz = origin
    dx, dy, dz = direction
    falls = dz < -1e-6
    steep = jnp.where(falls, dz, -1.0)
    high = (street.kerb_m - oz) / steep
    low = -oz / steep
    on_top = past_kerb(street, ox + high * dx, oy + high * dy) >= 0.0
    past_low = past_kerb(street, ox + low * dx, oy + low * dy)
    face = ~on_top & (past_low > 0.0)

    def halve(_, bracket):
        before, after = bracket
        middle = 0.5 * (before + after)
        outside = past_kerb(street, ox + middle * dx, oy + middle * dy) > 0.0
        return jnp.where(outside, before, middle), jnp.where(outside, middle, after)

    before, after = jax.lax.fori_loop(0, HALVINGS, halve, (high, low))
    t = jnp.where(on_top, high, jnp.where(face, 0.5 * (before + after), low))
    return t, falls & (t > 0.0), face


def ground_normal(
    street: Street, x: Float[Array, "*r"], y: Float[Array, "*r"], *, face: Bool[Array, "*r"]
) -> Float[Array, "3 *r"]:
    """Up, and at a kerb's face towards the road."""
    step = 0.02
    x, y = (x, y)
    here = past_kerb(street, x, y)
    gx = past_kerb(street, x + step, y) - here
    gy = past_kerb(street, x, y + step) - here
    size = jnp.maximum(jnp.sqrt(gx * gx + gy * gy), 1e-6)
    flat = jnp.zeros_like(x)
    return vector(*(jnp.where(face, side, top) for side, top in ((-gx / size, 0.0), (-gy / size, 0.0), (flat, 1.0))))
