"""What light does at a surface: procedural colour, and reflectance at the LiDAR's 905 nm.

A solid's `Look` gives two paints; its pattern says where which of them lies, how it is shaded, and where there is
glass, a lamp or retroreflecting sheet. What shades the colour also shades the reflectance, by less: so a camera
sees part of what the LiDAR sees, as in reality, and the paint itself (a black car that is bright in the infrared)
remains to be learnt from colour, class and shape.

Letters: p the place and n the normal in the object's own frame, components first; `fine` says how much of a detail
of one metre survives the size of a pixel (1 all, 0 none).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.data.cityscapes import IDS
from jaxsim.data.synthetic.fields import Triple, cell, cell_hash, each, in_blocks, smooth_noise, smooth_noise3, when
from jaxsim.data.synthetic.raycast import Hit
from jaxsim.data.synthetic.solids import GROUND, LOOK, Pattern, Solids
from jaxsim.data.synthetic.street import Course, Ground, Street, ground_course, ground_surface
from jaxsim.frame import Array

FLOOR_M = 2.9
TRIM, TRIM_NIR = (0.5, 0.5, 0.47), 0.55
GLASS, GLASS_NIR = (0.02, 0.025, 0.03), 0.08
SHEET, SHEET_NIR = (0.75, 0.75, 0.72), 0.9


@struct.dataclass
class Surface:
    """Every ray's surface."""

    rgb: Triple
    """Linear albedo, 0..1."""
    nir: Float[Array, "*r"]
    """Reflectance at 905 nm."""
    gloss: Float[Array, "*r"]
    """Share of the light that is mirrored head on."""
    glass: Bool[Array, "*r"]
    retro: Bool[Array, "*r"]
    absorbing: Bool[Array, "*r"]
    """Paint that returns hardly anything at 905 nm."""
    marking: Bool[Array, "*r"]
    wet: Bool[Array, "*r"]
    semantic: Int[Array, "*r"]
    instance: Int[Array, "*r"]
    bend: Triple
    """What to add to the normal of sheet metal, so that flat faces shine as if they were curved."""


Looks = dict[str, list[Float[Array, "*r"]]]
"""Columns of LOOK at every hit."""


class Marks(NamedTuple):
    """What a pattern decides, place by place: share of the second paint, brightness, and special materials."""

    second: Float[Array, "*r"]
    shade: Float[Array, "*r"]
    trim: Bool[Array, "*r"]
    glass: Bool[Array, "*r"]
    retro: Bool[Array, "*r"]


@jax.jit
def surface(solids: Solids, street: Street, hit: Hit, *, pixel_m: Float[Array, "*r"]) -> Surface:
    """The surface at every hit; `pixel_m` is the size of a pixel there."""
    return in_blocks(lambda hit, pixel_m: _block(solids, street, hit, pixel_m=pixel_m), hit, pixel_m)


def _block(solids: Solids, street: Street, hit: Hit, *, pixel_m: Float[Array, "*r"]) -> Surface:
    """Patterns, and the ground, are worked out where the block holds some of them."""
    on_ground, things = hit.solid == GROUND, hit.solid < GROUND
    look = when(things, partial(_looks_at, solids), hit.solid)
    marks = _marks(look, hit, pixel_m=pixel_m, things=things)
    course = when(on_ground, partial(ground_course, street), hit.at)

    def made_of(hit: Hit, pixel_m: Array, course: Course) -> Ground:
        return ground_surface(street, hit.at, hit.kerb, pixel_m=pixel_m, course=course)

    ground = when(on_ground, made_of, hit, pixel_m, course)
    return _compose(look, marks, hit, ground=ground)


def _looks_at(solids: Solids, solid: Int[Array, "*r"]) -> Looks:
    solid = jnp.minimum(solid, GROUND - 1)
    return {name: [column[solid] for column in solids.look.T[columns]] for name, columns in LOOK.items()}


def _marks(look: Looks, hit: Hit, *, pixel_m: Float[Array, "*r"], things: Bool[Array, "*r"]) -> Marks:
    pattern, seed = look["pattern"][0].astype(jnp.int32), look["seed"][0].astype(jnp.int32)
    half, extra = look["half"], look["extra"]

    def in_own_frame(look: Looks, hit: Hit) -> tuple[Triple, Triple]:
        # Turned back by the heading, into the object's own frame.
        cos, sin = look["heading"]
        x, y, z = each(lambda i: hit.at[i] - look["centre"][i])
        nx, ny, nz = hit.normal
        return (cos * x + sin * y, cos * y - sin * x, z), (cos * nx + sin * ny, cos * ny - sin * nx, nz)

    p, n = when(things, in_own_frame, look, hit)
    marked: dict[int, Callable[[Triple, Triple], Marks]] = {
        Pattern.PLAIN: (lambda p, n: _plain(p, pixel_m)),
        Pattern.FACADE: (lambda p, n: _facade(p, n, half, drawn=(seed, extra), pixel_m=pixel_m)),
        Pattern.CAR_BODY: (lambda p, n: _car_body(p, n, half, extra=extra)),
        Pattern.CAR_CABIN: (lambda p, n: _car_cabin(p, n, half, extra=extra)),
        Pattern.WHEEL: (lambda p, n: _wheel(p, n, extra)),
        Pattern.LEAF: (lambda p, n: _leaf(hit.at)),
        Pattern.SIGN: (lambda p, n: _sign(p, n, half, extra=extra)),
        Pattern.TRUCK_BOX: (lambda p, n: _truck_box(p, n, half)),
    }
    no, zero = jnp.zeros(pattern.shape, bool), jnp.zeros(pattern.shape, jnp.float32)
    marks = Marks(zero, zero, no, no, no)
    for code, work in marked.items():
        here = things & (pattern == code)

        def paint(p, n, marks, *, here=here, work=work) -> Marks:
            return Marks(*(jnp.where(here, new, old) for new, old in zip(work(p, n), marks, strict=True)))

        marks = jax.lax.cond(here.any(), paint, lambda p, n, marks: marks, p, n, marks)
    return marks


def _compose(look: Looks, marks: Marks, hit: Hit, *, ground: Ground) -> Surface:
    printed = look["pattern"][0] == float(Pattern.SIGN)

    def paint(first, second, *, trim: float, glass: float, sheet: float, contrast: float):
        value = (first + (second - first) * marks.second) * (1.0 + contrast * (marks.shade - 1.0))
        value = jnp.where(marks.trim, trim, value)
        value = jnp.where(marks.glass, glass, value)
        # A sign's sheeting shows its print; a number plate's is white.
        return jnp.where(marks.retro & ~printed, sheet, value)

    def colour(i: int) -> Float[Array, "*r"]:
        own = paint(look["rgb"][i], look["rgb2"][i], trim=TRIM[i], glass=GLASS[i], sheet=SHEET[i], contrast=1.0)
        return jnp.where(on_ground, ground.rgb[i], own)

    nir = paint(look["nir"][0], look["nir2"][0], trim=TRIM_NIR, glass=GLASS_NIR, sheet=SHEET_NIR, contrast=0.7)
    # Numbers past the solids' stand for the ground and for nothing at all.
    on_ground, in_sky = hit.solid == GROUND, hit.solid > GROUND
    things = ~(on_ground | in_sky)
    painted = things & ~marks.glass & ~marks.trim & ~marks.retro
    metal = (look["pattern"][0] == float(Pattern.CAR_BODY)) | (look["pattern"][0] == float(Pattern.CAR_CABIN))
    _, half_width, height = look["half"]
    x, y, z = look["centre"]
    middle = (x, y, z + 0.55 * height)
    semantic = jnp.where(on_ground, ground.semantic, look["semantic"][0].astype(jnp.int32))
    return Surface(
        rgb=each(colour),
        nir=jnp.clip(jnp.where(on_ground, ground.nir, nir), 0.0, 1.0),
        gloss=jnp.where(things, jnp.where(marks.glass, 0.12, look["gloss"][0]), 0.01),
        glass=things & marks.glass,
        retro=things & marks.retro,
        absorbing=painted & (look["absorbing"][0] > 0.5) & (marks.second < 0.5),
        marking=on_ground & ground.marking,
        wet=on_ground & ground.wet,
        semantic=jnp.where(in_sky, IDS["sky"], semantic),
        instance=jnp.where(things, look["instance"][0].astype(jnp.int32), 0),
        # Flat facets would mirror one patch of sky each: sheet metal is curved.
        bend=each(lambda i: jnp.where(metal & things, 0.22 * (hit.at[i] - middle[i]) / half_width, 0.0)),
    )


def _none(p) -> Bool[Array, "*r"]:
    return jnp.zeros(p[0].shape, bool)


def _plain(p, pixel_m: Float[Array, "*r"]) -> Marks:
    fine = jnp.clip(1.0 - 6.0 * pixel_m, 0.0, 1.0)
    shade = 1.0 + 0.25 * fine * (smooth_noise3(p[0] * 6.0, p[1] * 6.0, p[2] * 6.0) - 0.5)
    return Marks(jnp.zeros_like(p[0]), shade, _none(p), _none(p), _none(p))


def _leaf(at: Triple) -> Marks:
    def clumps(per_m: float) -> Float[Array, "*r"]:
        return smooth_noise3(*each(lambda i: at[i] * per_m))

    shade = 0.45 + 0.6 * clumps(1.7) + 0.5 * clumps(7.0)
    return Marks(0.6 * clumps(0.8), shade, _none(at), _none(at), _none(at))


def _facade(p, n, half, *, drawn, pixel_m: Float[Array, "*r"]) -> Marks:
    """Floors of windows; doors and shops below; a roof of tiles. extra: width of a window's bay, style 0..1."""
    seed, (bay, style) = drawn
    roof = n[2] > 0.25
    end = jnp.abs(n[0]) > jnp.abs(n[1])
    u = jnp.where(end, p[1], p[0])
    reach = jnp.where(end, half[1], half[0])
    v = p[2]
    # A wall has a whole number of bays, set about its middle.
    bays = jnp.maximum(jnp.floor(2.0 * reach / bay), 1.0)
    along = u / bay + 0.5 * bays
    i, floor = cell(along), cell(v / FLOOR_M)
    fu, fv = (along - jnp.floor(along) - 0.5) * bay, v - floor.astype(jnp.float32) * FLOOR_M
    inside = (along > 0.0) & (along < bays) & ((floor.astype(jnp.float32) + 1.0) * FLOOR_M < half[2] + 0.4)
    # A number a bay and floor: whether there is a door, or on end walls a window.
    fate = cell_hash(i, floor, seed)
    street_level = floor == 0
    shop = street_level & (style > 0.7) & inside & ~end
    width = bay * (0.17 + 0.1 * style)
    low, high = jnp.where(shop, 0.4, 0.85), jnp.where(shop, 2.25, 2.3)
    width = jnp.where(shop, 0.44 * bay, width)
    door = street_level & ~end & ~shop & (fate < 0.22) & inside
    opening = inside & (fu > -width) & (fu < width) & (fv > low) & (fv < high) & ~door & ~(end & (fate < 0.6))
    frame = opening & ((jnp.abs(fu) > width - 0.07) | (jnp.abs(fu) < 0.035) | (fv < low + 0.08) | (fv > high - 0.07))
    sill = inside & ~door & ~shop & (jnp.abs(fu) < width + 0.1) & (fv > low - 0.12) & (fv <= low) & ~end
    band = shop & (fv > 2.35)
    leaf_of_door = door & (jnp.abs(fu) < 0.5) & (fv < 2.15)
    brick = (seed & 1) == 1
    fine = jnp.clip(1.0 - 8.0 * pixel_m, 0.0, 1.0)
    bricks = cell_hash(cell(u * 4.5 + 0.5 * (cell(v * 13.0) & 1).astype(jnp.float32)), cell(v * 13.0), seed) - 0.5
    grime = smooth_noise(u * 0.45, v * 0.3, seed) - 0.5
    shade = 1.0 + 0.3 * grime + jnp.where(brick, 0.5 * fine * bricks, 0.0) - jnp.where(v < 0.5, 0.25, 0.0)
    rows = v * 3.2
    tiles = cell_hash(cell(u * 3.0), cell(rows), seed) - 0.5 + 0.8 * (rows - jnp.floor(rows) - 0.5)
    shade = jnp.where(roof, 1.0 + 0.35 * fine * tiles + 0.25 * grime, shade)
    second = roof | band | leaf_of_door
    wall = ~roof
    return Marks(
        second.astype(jnp.float32),
        jnp.where(leaf_of_door, 0.75, shade),
        wall & (frame | sill),
        wall & opening & ~frame,
        _none(p),
    )


def _car_body(p, n, half, *, extra) -> Marks:
    """Wheel arches, bumpers, lamps, grille, doors and plates. extra: wheel base / 2, wheel radius."""
    length, width, height = half
    axle, radius = extra
    end = jnp.abs(n[0]) > 0.5
    side = ~end & (jnp.abs(n[1]) > 0.5)
    front = end & (p[0] > 0.0)
    across = jnp.abs(p[1]) / width
    z = p[2] / height
    # Both axles at once: the pattern is mirrored about the middle of the car.
    from_wheel = jnp.hypot(jnp.abs(p[0]) - axle, p[2] - radius)
    dark = (side & (from_wheel < 1.18 * radius)) | (p[2] < 0.27)
    dark = dark | (front & (across < 0.5) & (z > 0.30) & (z < 0.40)) | (end & (z < 0.22))
    lamp = end & (across > 0.55) & (across < 0.97) & (z > 0.42) & (z < 0.53)
    plate = end & (jnp.abs(p[1]) < 0.26) & (p[2] > 0.42) & (p[2] < 0.54)
    gap = side & ((jnp.abs(p[0] - 0.08 * length) < 0.012) | (jnp.abs(p[0] - 0.62 * length) < 0.012)) & (p[2] > 0.3)
    strip = side & (jnp.abs(p[2] - 0.5 * height) < 0.02)
    shade = jnp.where(dark | gap, 0.08, jnp.where(strip, 0.55, 1.0))
    red = lamp & ~front
    return Marks(red.astype(jnp.float32), shade, lamp & front, _none(p), plate & ~lamp)


def _car_cabin(p, n, half, *, extra) -> Marks:
    """Windows all round between the belt and the roof. extra: height of the belt, x of the pillar between the doors."""
    belt, pillar = extra
    up = p[2] - belt
    top = half[2] - 0.07
    side = jnp.abs(n[1]) > 0.55
    end = (jnp.abs(n[0]) > 0.3) & ~side & (n[2] < 0.93)
    across = jnp.abs(p[1]) < half[1] - 0.16 - 0.25 * up
    window = (up > 0.05) & (p[2] < top)
    seen = (side & (jnp.abs(p[0] - pillar) > 0.05) & (jnp.abs(p[0] - pillar) < 1.75)) | (end & across)
    second = jnp.zeros_like(p[0])
    return Marks(second, jnp.ones_like(second), _none(p), window & seen, _none(p))


def _wheel(p, n, extra) -> Marks:
    """A rim with five spokes in a tyre. extra: x of the axle (both, mirrored), radius."""
    axle, radius = extra
    dx, dz = jnp.abs(p[0]) - axle, p[2] - radius
    r = jnp.hypot(dx, dz) / radius
    spoke = jnp.cos(5.0 * jnp.arctan2(dz, dx)) > -0.2
    rim = (jnp.abs(n[1]) > 0.7) & (r < 0.68) & ((r > 0.58) | (r < 0.2) | spoke)
    return Marks(rim.astype(jnp.float32), jnp.ones_like(r), _none(p), _none(p), _none(p))


def _sign(p, n, half, *, extra) -> Marks:
    """Sheeting on the face that looks along x. extra: shape (0 round, 1 triangle, 2 board), width of the rim."""
    shape, rim = extra
    face = n[0] > 0.5
    u, v = jnp.abs(p[1]), jnp.abs(p[2])
    disc = jnp.hypot(p[1], p[2]) > half[1] - rim
    # The triangle's sides lie at a distance of half[1] / 2 from its middle.
    slant = jnp.maximum(-p[2], 0.866 * u + 0.5 * p[2]) > 0.5 * half[1] - rim
    board = (u > half[1] - rim) | (v > half[2] - rim)
    edge = jnp.where(shape < 0.5, disc, jnp.where(shape < 1.5, slant, board))
    emblem = (u < 0.25 * half[1]) & (v < 0.3 * half[1]) & (shape > 0.5) & (shape < 1.5)
    second = jnp.where(edge, 1.0, 0.0)
    shade = jnp.where(face, jnp.where(emblem, 0.05, 1.0), 0.35)
    return Marks(jnp.where(face, second, 0.0), shade, _none(p), _none(p), face & ~emblem)


def _truck_box(p, n, half) -> Marks:
    """A band of the second colour along the sides, doors and a retroreflecting outline behind."""
    side = jnp.abs(n[1]) > 0.5
    behind = n[0] < -0.5
    band = side & (p[2] > 0.45 * half[2]) & (p[2] < 0.75 * half[2]) & (jnp.abs(p[0]) < 0.8 * half[0])
    low = p[2] - 1.0
    outline = behind & ((jnp.abs(p[1]) > half[1] - 0.06) | (jnp.abs(low) < 0.05))
    gap = behind & (jnp.abs(p[1]) < 0.015)
    ribs = side & (jnp.abs(p[0] / 1.2 - jnp.floor(p[0] / 1.2) - 0.5) < 0.01)
    shade = jnp.where(gap | ribs, 0.5, 1.0)
    return Marks(band.astype(jnp.float32), shade, _none(p), _none(p), outline)
