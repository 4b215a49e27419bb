"""The ground: a road between kerbs, side streets, pavements, and terrain behind them.

Letters: x along the street at the ego car, y to its left. The middle of the road is y = c x^2 / 2; `aside` is the
distance from it, positive to the left. The ground has two levels: the road at 0, all else at the kerb's height. It is
made of asphalt with its markings, kerbs, paving and lawn. After rain a film of water lies on a share of the road: it
takes about half of the light at either wavelength (Twomey, Bohren and Mergenthaler, Reflectance and albedo differences
between wet and dry surfaces, Applied Optics 25, 1986).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic.fields import Starts, Triple, cell, cell_hash, each, in_blocks, smooth_noise, when
from jaxsim.frame import Array

SIDE_STREETS = 2
ROUNDING_M = 3.0
"""How far kerbs are rounded where a side street meets the road."""
HALVINGS = 6
ROAD, PAVEMENT = IDS["road"], IDS["sidewalk"]
OPEN_GROUND, TERRAIN = IDS["ground"], IDS["terrain"]
LINE_M = 0.13
LINE, SLAB = (0.62, 0.62, 0.58), (0.27, 0.27, 0.25)
KERBSTONE = (0.30, 0.29, 0.27)
GRASS, STRAW = (0.055, 0.10, 0.028), (0.19, 0.17, 0.09)
WET_RGB, WET_NIR = 0.55, 0.45
"""What a film of water leaves of the albedo."""


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
    wet: Float[Array, ""]
    """About the share of the road that is wet."""


class Ground(NamedTuple):
    """The ground at every hit."""

    rgb: Triple
    """Linear albedo."""
    nir: Float[Array, "*r"]
    """Reflectance at 905 nm."""
    semantic: Int[Array, "*r"]
    marking: Bool[Array, "*r"]
    """Painted road, as far as the paint is not worn off."""
    wet: Bool[Array, "*r"]


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
    street: Street, origin: Starts, direction: Triple
) -> tuple[Float[Array, "*r"], Bool[Array, "*r"], Bool[Array, "*r"]]:
    """Ray parameter of the hit with the ground, whether there is one, and whether it is the kerb's face.

    A ray that clears the upper level over the road and lies under it at the lower level has met a kerb's face: the
    place comes from a bracketed search along the ray.
    """
    start = each(lambda i: jnp.broadcast_to(origin[i], direction[i].shape))
    return in_blocks(partial(_cast_block, street), start, direction)


def _cast_block(street: Street, start: Triple, direction: Triple) -> tuple[Array, Array, Array]:
    falls = direction[2] < -1e-6
    t, face = when(falls, partial(_meet_ground, street, falls=falls), start, direction)
    return t, falls & (t > 0.0), face


def _meet_ground(street: Street, start: Triple, direction: Triple, *, falls: Array) -> tuple[Array, Array]:
    """Ray parameters, and whether they are of a kerb's face; of rays that rise, anything."""
    ox, oy, oz = start
    dx, dy, dz = direction
    # Rays that do not fall must not divide by 0.
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

    before, after = when(face, lambda high, low: jax.lax.fori_loop(0, HALVINGS, halve, (high, low)), high, low)
    return jnp.where(on_top, high, jnp.where(face, 0.5 * (before + after), low)), face


def ground_normal(street: Street, x: Float[Array, "*r"], y: Float[Array, "*r"], *, face: Bool[Array, "*r"]) -> Triple:
    """Up, and at a kerb's face towards the road."""
    step = 0.02
    here = past_kerb(street, x, y)
    # The kerb's course has no formula for its normal: the slope of the distance to it.
    gx = past_kerb(street, x + step, y) - here
    gy = past_kerb(street, x, y + step) - here
    size = jnp.maximum(jnp.sqrt(gx * gx + gy * gy), 1e-6)
    return jnp.where(face, -gx / size, 0.0), jnp.where(face, -gy / size, 0.0), jnp.where(face, 0.0, 1.0)


class Course(NamedTuple):
    """Where a place of the ground lies in its street, and its noise about 0, from fine to coarse."""

    off: Float[Array, "*r"]
    """Metres from the middle of the road."""
    beyond: Float[Array, "*r"]
    """Metres past the kerb."""
    grain: Float[Array, "*r"]
    tuft: Float[Array, "*r"]
    blotch: Float[Array, "*r"]
    field: Float[Array, "*r"]


def ground_course(street: Street, at: Triple) -> Course:
    """Where places of the ground lie, which many parts of its surface need: a step of its own."""
    x, y = at[0], at[1]
    seed = street.seed.astype(jnp.int32)
    scales = ((23.0, 23.0, 0), (5.0, 5.0, 3), (0.9, 1.7, 1), (0.11, 0.5, 2))
    noise = [smooth_noise(x * along, y * across, seed + kind) - 0.5 for along, across, kind in scales]
    return Course(aside(street, x, y), past_kerb(street, x, y), *noise)


def ground_surface(
    street: Street, at: Triple, kerb: Bool[Array, "*r"], *, pixel_m: Float[Array, "*r"], course: Course
) -> Ground:
    """What the ground is made of."""
    x = at[0]
    off, beyond, grain, tuft, blotch, field = course
    seed = street.seed.astype(jnp.int32)
    # Texture finer than a pixel is left out, or it would flicker from frame to frame.
    fine = jnp.clip(1.0 - 5.0 * pixel_m, 0.0, 1.0)
    middle = jnp.clip(1.0 - 0.6 * pixel_m, 0.0, 1.0)

    road, road_nir = _asphalt(street, x, off, noise=(grain * fine, blotch * middle, field), seed=seed)
    paint = _markings(street, x, off, beyond=beyond) * (1.0 - street.wear * jnp.clip(2.4 * (blotch + 0.15), 0.0, 0.8))
    stone, stone_nir = _paving(street, x, off, noise=(grain * fine, blotch * middle, field), seed=seed)
    lawn = 1.0 + 0.7 * fine * grain + 0.5 * middle * tuft + 0.5 * blotch + 0.5 * field
    dry = jnp.clip(0.5 + 1.3 * field + 0.4 * blotch, 0.0, 1.0)

    # Clearly above the road's level, so that rounding cannot put road on the pavement's side.
    is_road = (beyond < 0.0) & ~kerb
    wet = is_road & (smooth_noise(x * 0.25, off * 0.6, seed + 11) < street.wet)
    is_kerb = kerb | (~is_road & (beyond < 0.16))
    green = (beyond > street.pavement_m) & (street.green > 0.5)

    def colour(i: int) -> Float[Array, "*r"]:
        meadow = lawn * (GRASS[i] + (STRAW[i] - GRASS[i]) * dry)
        behind = jnp.where(green, meadow, stone * SLAB[i])
        behind = jnp.where(is_kerb, KERBSTONE[i] * (1.0 + 0.5 * fine * grain + 0.3 * blotch), behind)
        painted = road + (LINE[i] - road) * paint
        return jnp.where(is_road, painted * jnp.where(wet, WET_RGB, 1.0), behind)

    nir = road_nir + (0.62 - road_nir) * paint
    behind = jnp.where(green, (0.52 - 0.12 * dry) * (1.0 + 0.5 * (lawn - 1.0)), stone_nir)
    behind = jnp.where(is_kerb, 0.40 * (1.0 + 0.3 * fine * grain + 0.2 * blotch), behind)
    nir = jnp.where(is_road, nir * jnp.where(wet, WET_NIR, 1.0), behind)
    paved_plot = jnp.where(beyond > street.pavement_m + 1.0, OPEN_GROUND, PAVEMENT)
    semantic = jnp.where(is_road, ROAD, jnp.where(is_kerb, PAVEMENT, jnp.where(green, TERRAIN, paved_plot)))
    return Ground(each(colour), nir, semantic.astype(jnp.int32), is_road & (paint > 0.5), wet)


def _asphalt(street: Street, x, off, *, noise, seed):
    """Grey with grain, mended rectangles, wheel tracks and covers."""
    grain, blotch, field = noise
    grey = 0.065 + 0.11 * street.tone
    i, j = cell(x / 7.0), cell(off / 2.3)
    # One number a patch says what became of it, wherever it is seen from.
    fate = cell_hash(i, j, seed + 5)
    u, v = x / 7.0 - jnp.floor(x / 7.0), off / 2.3 - jnp.floor(off / 2.3)
    mended = (fate < 0.10 * (0.3 + street.wear)) & (u > 0.2) & (u < 0.3 + 5.0 * fate) & (v > 0.1) & (v < 0.9)
    cover = (fate > 0.975) & ((7.0 * (u - 0.5)) ** 2 + (2.3 * (v - 0.5)) ** 2 < 0.1)
    lane = 0.5 * street.half_width_m
    track = jnp.exp(-(((jnp.abs(jnp.abs(jnp.abs(off) - lane) - 0.75)) / 0.35) ** 2))
    shade = 1.0 + 0.8 * grain + 0.30 * blotch + 0.35 * field + 0.10 * track
    shade = jnp.where(mended, 0.68 + 0.5 * grain, shade)
    shade = jnp.where(cover, 0.5 + 0.5 * grain, shade)
    # Old, pale asphalt shows its stones: brighter in both bands.
    return grey * shade, 0.06 + 1.35 * grey * (1.0 + 0.8 * (shade - 1.0))


def _paving(street: Street, x, off, *, noise, seed):
    """Slabs of half a metre, each of its own shade."""
    grain, blotch, field = noise
    i, j = cell(x / 0.6), cell(off / 0.6)
    u, v = x / 0.6 - jnp.floor(x / 0.6), off / 0.6 - jnp.floor(off / 0.6)
    slab = cell_hash(i, j, seed + 7) - 0.5
    joint = (u < 0.04) | (v < 0.04)
    shade = 1.0 + 0.45 * grain + 0.25 * blotch + 0.25 * field + 0.22 * slab - jnp.where(joint, 0.25, 0.0)
    shade = shade * (0.8 + 0.4 * street.tone)
    return shade, 0.36 * (1.0 + 0.7 * (shade - 1.0))


def _markings(street: Street, x, off, *, beyond) -> Float[Array, "*r"]:
    """1 where the road is painted: middle line, edge lines, bays, a zebra crossing, give-way lines."""

    def near(value, width):
        return jnp.abs(value) < 0.5 * width

    def dashed(value, period, share):
        return value / period - jnp.floor(value / period) < share

    clear = jnp.ones(x.shape, bool)
    give_way = jnp.zeros(x.shape, bool)
    for i in range(SIDE_STREETS):
        exists = street.side_half_m[i] > 0.0
        reach = jnp.abs(x - street.side_x_m[i]) - street.side_half_m[i]
        towards = street.side_towards[i] * off > 0.0
        clear = clear & ~(exists & (reach < 2.5))
        line = near(jnp.abs(off) - street.half_width_m - 0.6, 0.35) & dashed(x, 0.8, 0.6)
        give_way = give_way | (exists & towards & (reach < -0.2) & line)
    width = street.half_width_m
    zebra = near(x - street.crossing_x_m, 3.6)
    away = jnp.abs(x - street.crossing_x_m) > 4.0
    lane_edge = width - jnp.where(street.parking > 0.5, 2.25, 0.3)
    middle_line = near(off, LINE_M) & dashed(x, 6.0, 0.5) & away
    edge = near(jnp.abs(off) - lane_edge, LINE_M) & clear & away
    bays = (street.parking > 0.5) & (jnp.abs(off) > lane_edge) & dashed(x, 5.8, 0.02) & clear & away
    stop = near(jnp.abs(x - street.crossing_x_m) - 3.4, 0.35) & (jnp.abs(off) < width - 0.3)
    # A stop line lies in the lane that leads to the crossing alone.
    stop = stop & ((off < 0.0) == (x < street.crossing_x_m))
    painted = middle_line | edge | bays | stop | (zebra & dashed(off + 0.25, 1.0, 0.5)) | give_way
    return (painted & (beyond < -0.08)).astype(jnp.float32)
