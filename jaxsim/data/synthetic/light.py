"""Daylight: sun, sky, clouds, haze, and shadows looked up in maps.

A shadow map holds, for points g of the ground, the height at which the sunbeam that would land on g is stopped. A
point p lies on the beam that lands on g = p - towards * p_z / towards_z: it is in shade if its beam was stopped above
it. The grid of g is dense by the car and coarse far ahead.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.data.synthetic.fields import Triple, dot, each, smooth_noise
from jaxsim.frame import Array

BEHIND_M = 12.0
GROWTH_X_M = 20.0
GROWTH_Y_M = 8.0
REACH_X_M, REACH_Y_M = 160.0, 42.0
_TURNS_X = float(np.log1p(REACH_X_M / GROWTH_X_M))
_TURNS_Y = float(np.arcsinh(REACH_Y_M / GROWTH_Y_M))


@struct.dataclass
class Light:
    """The weather of one drive."""

    sun: Float[Array, "3"]
    """Unit vector towards the sun."""
    sun_rgb: Float[Array, "3"]
    zenith_rgb: Float[Array, "3"]
    horizon_rgb: Float[Array, "3"]
    cloud: Float[Array, ""]
    """Share of the sky that is covered."""
    haze_m: Float[Array, ""]
    """Distance at which haze leaves 1/e of the contrast."""
    exposure: Float[Array, ""]
    seed: Float[Array, ""]


@struct.dataclass
class Shadows:
    """Heights of the shadow map, and how much of the sky is hidden from the ground by what stands on it."""

    height_m: Float[Array, "down across"]
    covered: Float[Array, "down2 across2"]
    origin_m: Float[Array, "2"]
    """The corner where the maps' dense part lies."""


def map_borders(cells: tuple[int, int]) -> tuple[Float[np.ndarray, " across1"], Float[np.ndarray, " down1"]]:
    """Borders of the map's cells (down, across) in metres from its origin, x then y; host."""
    u, v = np.linspace(0, 1, cells[1] + 1), np.linspace(-1, 1, cells[0] + 1)
    return np.expm1(u * _TURNS_X) * GROWTH_X_M - BEHIND_M, np.sinh(v * _TURNS_Y) * GROWTH_Y_M


def map_place(
    x: Float[Array, "*r"], y: Float[Array, "*r"], shape: tuple[int, ...]
) -> tuple[Float[Array, "*r"], Float[Array, "*r"]]:
    """Row and column of a place in a map of that shape, whole numbers at cell centres; x, y from its origin."""
    # The inverse of `map_borders`.
    u = jnp.log1p(jnp.maximum(x + BEHIND_M, 0.0) / GROWTH_X_M) / _TURNS_X
    v = 0.5 + 0.5 * jnp.arcsinh(y / GROWTH_Y_M) / _TURNS_Y
    return v * shape[0] - 0.5, u * shape[1] - 0.5


@jax.jit
def lit(shadows: Shadows, light: Light, at: Triple, *, normal: Triple) -> Float[Array, "*r"]:
    """Share of the sun that reaches each point, from its four cells of the map."""
    x, y = at[0] - shadows.origin_m[0], at[1] - shadows.origin_m[1]
    # A point is lifted off its surface by about a cell of the map, or the surface would shade itself.
    cell_m = 0.08 + 0.006 * jnp.maximum(x, 0.0) + 0.008 * jnp.abs(y)
    lift = 0.04 + 1.1 * cell_m
    px = x + lift * normal[0]
    py = y + lift * normal[1]
    pz = at[2] + lift * normal[2]
    # Along the sun's ray down to the ground, on which the map has its heights.
    gx, gy = px - light.sun[0] / light.sun[2] * pz, py - light.sun[1] / light.sun[2] * pz
    return _mean_of_four(shadows.height_m, gx, gy, what=lambda stopped: jnp.where(stopped > pz + 0.05, 0.0, 1.0))


@jax.jit
def open_sky(shadows: Shadows, at: Triple, normal: Triple) -> Float[Array, "*r"]:
    """Share of the sky that flat ground sees past what stands on it; 1 for all that stands."""
    x, y = at[0] - shadows.origin_m[0], at[1] - shadows.origin_m[1]
    hidden = _mean_of_four(shadows.covered, x, y, what=lambda covered: covered)
    # A map over the ground tells of the ground alone; walls have the sky that their normals see.
    low = (normal[2] > 0.99) & (at[2] < 0.3)
    return jnp.where(low, 1.0 - hidden, 1.0)


def _mean_of_four(
    values: Float[Array, "down across"],
    x: Float[Array, "*r"],
    y: Float[Array, "*r"],
    *,
    what: Callable[[Float[Array, "*r"]], Float[Array, "*r"]],
) -> Float[Array, "*r"]:
    """Mean of what `what` makes of a map's values, over the four cells around each place, the nearer counting more."""
    row, column = map_place(x, y, values.shape)
    i, j = jnp.floor(row), jnp.floor(column)
    total = jnp.zeros_like(row)
    for down in (0, 1):
        for across in (0, 1):
            weight = jnp.abs(1.0 - down - (row - i)) * jnp.abs(1.0 - across - (column - j))
            k = jnp.clip((i + down).astype(jnp.int32), 0, values.shape[0] - 1)
            m = jnp.clip((j + across).astype(jnp.int32), 0, values.shape[1] - 1)
            total = total + weight * what(values.reshape(-1)[k * values.shape[1] + m])
    return total


def sky(light: Light, direction: Triple) -> Triple:
    """Radiance of the sky in unit directions; below the horizon, that of the horizon."""
    return _veiled(light, direction, mass=_clouds(light, direction))


@jax.jit
def _clouds(light: Light, direction: Triple) -> Float[Array, "*r"]:
    up = jnp.maximum(direction[2], 0.0)
    # Clouds lie on a plane overhead: towards the horizon they are seen edge on, and shrink.
    flat = 1.0 / (up + 0.12)
    x, y = direction[0] * flat * 1.6, direction[1] * flat * 1.6
    seed: Int[Array, ""] = light.seed.astype(jnp.int32)
    mass = 0.55 * smooth_noise(x, y, seed) + 0.28 * smooth_noise(2.3 * x, 2.3 * y, seed + 1)
    return mass + 0.17 * smooth_noise(5.1 * x, 5.1 * y, seed + 2)


@jax.jit
def _veiled(light: Light, direction: Triple, *, mass: Float[Array, "*r"]) -> Triple:
    up = jnp.maximum(direction[2], 0.0)
    # Above what the weather leaves open, their mass covers the blue.
    veil = jnp.clip((mass - 0.78 + 0.7 * light.cloud) * 4.0, 0.0, 1.0)
    blue = jnp.sqrt(jnp.clip(up * 1.5, 0.0, 1.0))
    towards_sun = jnp.maximum(dot(direction, light.sun), 0.0)
    glow = 0.25 * towards_sun**8

    def colour(i: int) -> Float[Array, "*r"]:
        sun, horizon = light.sun_rgb[i], light.horizon_rgb[i]
        clear = horizon + (light.zenith_rgb[i] - horizon) * blue + glow * sun
        white = (0.72 + 0.28 * mass) * (horizon * 0.8 + 0.22 * sun)
        return clear + (white - clear) * veil

    return each(colour)


def mirror(view: Triple, normal: Triple) -> Triple:
    """Directions that are seen in mirrors with those normals."""
    facing = dot(view, normal)
    return each(lambda i: view[i] - 2.0 * facing * normal[i])


@jax.jit
def shade(
    light: Light,
    rgb: Triple,
    gloss: Float[Array, "*r"],
    *,
    view: Triple,
    normal: Triple,
    mirrored: Triple,
    sunlit: Float[Array, "*r"],
    sky_open: Float[Array, "*r"],
    distance_m: Float[Array, "*r"],
) -> Triple:
    """Radiance towards the eye of surfaces seen along unit directions `view`; `mirrored` is the sky in their mirror."""
    facing = dot(view, normal)
    sun = jnp.maximum(dot(normal, light.sun), 0.0) * sunlit
    # Sky and ground light a surface by how far it faces them.
    above, below = 0.8 * (0.5 + 0.5 * normal[2]) * sky_open, 0.5 - 0.5 * normal[2]
    # Schlick's form of Fresnel's law, stronger off the normal than in nature.
    fresnel = gloss + (0.9 * gloss + 0.02) * (1.0 - jnp.abs(facing)) ** 5 * 4.0
    fresnel = jnp.clip(fresnel, 0.0, 0.8)
    # Low mirrored directions meet the houses opposite, not the horizon.
    away = mirror(view, normal)
    roofs = 0.12 + 0.35 * smooth_noise(3.0 * away[0], 3.0 * away[1], jnp.int32(7))
    houses = jnp.clip(1.0 - 6.0 * (away[2] - roofs), 0.0, 1.0)
    # The sun's own image in the gloss (Phong's lobe).
    glint = jnp.maximum(dot(away, light.sun), 0.0) ** 120 * sunlit
    # Haze takes light away by distance, and gives the horizon's instead.
    clear = jnp.exp(-distance_m / light.haze_m)

    def colour(i: int) -> Float[Array, "*r"]:
        sky_rgb = 0.5 * (light.zenith_rgb[i] + light.horizon_rgb[i])
        ground = 0.16 * (light.sun_rgb[i] * light.sun[2] + sky_rgb)
        value = rgb[i] * (light.sun_rgb[i] * sun + sky_rgb * above + ground * below)
        around = mirrored[i] * (1.0 - 0.8 * houses)
        value = value + fresnel * (around - value) + 4.0 * gloss * glint * light.sun_rgb[i]
        return light.horizon_rgb[i] + (value - light.horizon_rgb[i]) * clear

    return each(colour)


@jax.jit
def develop(light: Light, radiance: Triple, behind: Triple, *, in_sky: Bool[Array, "*r"]) -> Triple:
    """Display values 0..1 of surfaces, and of the sky behind them: exposure, a film's shoulder, sRGB's gamma."""

    def channel(i: int) -> Float[Array, "*r"]:
        value = jnp.where(in_sky, behind[i], radiance[i])
        exposed = 1.0 - jnp.exp(-light.exposure * jnp.maximum(value, 0.0))
        # A power in two steps, each of which has vector instructions.
        shown = jnp.where(exposed > 0.0, jnp.exp(jnp.log(exposed) / 2.2), 0.0)
        # An S-shaped curve, as cameras apply for contrast.
        return shown + 0.35 * shown * (1.0 - shown) * (2.0 * shown - 1.0)

    return each(channel)
