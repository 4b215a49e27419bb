"""Which columns of which frames are looked at, and the scenes that they belong to; their rays as simulated; and the
surfaces that these meet, which share a reflectance of their own: objects, and patches of what is no object.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.rules import RULES
from jaxsim.effects.edits import displace
from jaxsim.effects.places import neighbours_m, rays_at
from jaxsim.effects.rays import LEAST_M, Rays, Scan
from jaxsim.effects.recast import recast
from jaxsim.frame import Array
from jaxsim.geometry.normals import incidence
from jaxsim.geometry.polar import directions
from jaxsim.progress import counted

RAYS = 20_000
"""Rays that a fit looks at, if the frames have so many."""
CLOSER_RAYS = 60_000
"""The same of a closer look, where the first leaves effects undecided."""
OBJECT_SD = 0.2
"""Standard deviation of an object's reflectance about its class in the street, nats."""
PATCH_SD = 0.15
"""The same of a patch of ground or wall."""
STRIP_SD = 0.1
"""Standard deviation of a strip, the part of a surface that one column sees, about its surface, nats."""
STREET_SD = 0.1
"""Standard deviation of all that is of one class in one street about the class in all streets, nats."""
FIRM = 1e12
"""1 / variance of what has no reflectance of its own."""
UNKNOWN_BETWEEN = 0.03
"""Share of readings between two surfaces, of the rays beside a step of frames that were cast again: a surface goes on
between the directions in which it was rendered, and how is in no frame."""
PATCH_M = 6.0
"""Ground and walls are alike over about so much."""
STEEPEST_COSINE = 0.1
"""Cosines of incidence below this are held there: intensities are not divided by less."""
ROOM = 2048
"""Strips and surfaces are counted up to a multiple of this, so that fits of other frames need not be compiled again."""


@dataclass(frozen=True)
class Blocks:
    """Columns of frames, with the name of each block's scene: a drive, or a sector of one of few drives."""

    frame: Int[np.ndarray, " b"]
    column: Int[np.ndarray, "b c"]
    scene: tuple[str, ...]
    sectors: int = 1
    """How many sectors each frame is cut into."""


def sectors_a_drive(drives: Sequence[str]) -> int:
    """Into how many sectors frames of these drives are cut: 1 where there are enough drives for a verdict."""
    count = len(set(drives))
    return 1 if count >= RULES.fewest_scenes else -(-RULES.sectors // count)


def blocks(
    drives: Sequence[str], rows: int, columns: int, *, rays: int = RAYS, like: Blocks | None = None, seed: int = 0
) -> Blocks:
    """Columns spread evenly over each frame, the first at random, with the frame's drive as their scene; of few drives,
    columns of each sector of the scan, which are scenes: `sectors_a_drive` of them, or as many and as wide as those of
    blocks that these shall be `like`.

    A sector of all frames of a drive counts as one: what a car or a wall does to one frame it does to the next. Raises
    ValueError where sectors would be too narrow.
    """
    rng = np.random.default_rng(seed)
    frames = len(drives)
    sectors = like.sectors if like else sectors_a_drive(drives)
    each = like.column.shape[1] if like else rays // (rows * sectors * frames)
    if sectors == 1:
        count = min(columns, max(RULES.fewest_columns, each))
        return Blocks(np.arange(frames), _spread(rng, frames, columns=columns, count=count), tuple(drives))
    width = columns // sectors
    inner = width - 2 * RULES.guard_columns
    frames_of = Counter(drives)
    if inner < RULES.fewest_columns:
        raise ValueError(
            f"discover: frames of {counted(len(frames_of), 'drive')}, of {columns} columns, are too narrow to be cut "
            f"into {sectors} independent sectors; give frames of {RULES.fewest_scenes} drives, or "
            f"{sectors * (RULES.fewest_columns + 2 * RULES.guard_columns)} columns or more"
        )
    # Few frames give more columns each, so that a fit sees about as many rays.
    count = each if like else min(inner, max(-(-RULES.fewest_columns // min(frames_of.values())), each))
    within = RULES.guard_columns + _spread(rng, frames, columns=inner, count=count)
    column = np.arange(sectors)[None, :, None] * width + within[:, None, :]
    # Of a single drive the sector alone says which, and further frames of one of several are still named by it.
    of_drive = [f"{drive} " if sectors < RULES.sectors else "" for drive in drives]
    names = tuple(f"{drive}sector {k:02d}" for drive in of_drive for k in range(sectors))
    return Blocks(np.repeat(np.arange(frames), sectors), column.reshape(-1, count), names, sectors)


def seeing(chosen: Blocks, hidden: Bool[np.ndarray, " n"]) -> Blocks:
    """The blocks with one column that is `hidden` in each that has none: what stands before the sensor may be narrower
    than the steps from column to column, and then a frame in ten would show it. Sectors stay as they are."""
    column = chosen.column.copy()
    wanted = np.flatnonzero(hidden)
    for b in np.flatnonzero(~hidden[column].any(1)) if len(wanted) and chosen.sectors == 1 else ():
        wanted_column = wanted[b % len(wanted)]
        column[b, np.abs(column[b] - wanted_column).argmin()] = wanted_column
    return replace(chosen, column=column)


def _spread(rng: np.random.Generator, frames: int, *, columns: int, count: int) -> Int[np.ndarray, "{frames} {count}"]:
    """Even steps through so many columns, each frame from another start."""
    step = columns / count
    # Steps alone would meet the same columns, and what stands there, in every frame.
    first = rng.uniform(0, step, (frames, 1))
    return np.minimum(np.floor(first + step * np.arange(count)).astype(int), columns - 1)


RayIndex = tuple[Int[Array, "b c r"], Int[Array, "b c r"], Int[Array, "b c r"]]
"""Frame, row and column of each ray: a raster (f, r, c) of the scan, indexed by it, is one of the rays."""


@struct.dataclass
class Cast:
    """Rays of chosen columns, as they are simulated."""

    rays: Rays
    pose: Float[Array, "b c r 6"]
    """Change of range with the sensor's pose, at any incidence."""

    def part(self, keep: Bool[np.ndarray, " b"]) -> Cast:
        """The rays of some blocks alone."""
        return jax.tree.map(lambda leaf: np.asarray(leaf)[keep] if np.ndim(leaf) else leaf, self)


def ray_index(scan: Scan, frame: Int[np.ndarray, " b"], column: Int[np.ndarray, "b c"]) -> RayIndex:
    """The rays of whole columns, `column` of each block's `frame`."""
    row = np.arange(scan.range_m.shape[1])
    f, r, c = np.broadcast_arrays(frame[:, None, None], row[None, None, :], column[:, :, None])
    return f.astype(np.int32), r.astype(np.int32), c.astype(np.int32)


def cast(scan: Scan, frame: Int[np.ndarray, " b"], column: Int[np.ndarray, "b c"]) -> Cast:
    """The rays of these columns of each block's frame."""
    return _cast(scan, ray_index(scan, frame, column))


@jax.jit
def _cast(scan: Scan, index: RayIndex) -> Cast:
    rays = rays_at(scan, index)
    return Cast(rays, pose_derivatives(scan, rays))


def pose_derivatives(scan: Scan, rays: Rays) -> Float[Array, "*n 6"]:
    """Change of range for a small motion (x, y, z) and rotation about (x, y, z) of the sensor, as `recast` has it."""
    azimuth, elevation = rays.azimuth_rad, rays.elevation_rad
    rise = jnp.tan(elevation)

    def reading(pose: Float[Array, " 6"]) -> Float[Array, "*n"]:
        x, y, z, roll, pitch, yaw = pose
        # Rotating the sensor by w moves the direction d by w x d.
        turn = yaw - rise * (roll * jnp.cos(azimuth) + pitch * jnp.sin(azimuth))
        lift = roll * jnp.sin(azimuth) - pitch * jnp.cos(azimuth)
        one = jnp.ones_like(azimuth)
        displaced = displace(rays, turn_rad=(turn, lift), move_m=(x * one, y * one, z * one))
        return recast(displaced, scan, passes=1).range_m

    return jnp.moveaxis(jax.vmap(lambda axis: jax.jvp(reading, (jnp.zeros(6),), (axis,))[1])(jnp.eye(6)), 0, -1)


@struct.dataclass
class Surfaces:
    """Which rays share a reflectance. Strips and surfaces are numbered from 1; 0 is none."""

    strip: Int[Array, "b c r"]
    """The part of a surface that one column sees, numbered through all blocks."""
    surface: Int[Array, " t"]
    """The surface that each strip belongs to: an object, or a patch of what is no object. Each lies in one block."""
    precision: Float[Array, " s"]
    """1 / variance of each surface's reflectance about its class, 1/nats^2."""


def surfaces_of(scan: Scan, index: RayIndex) -> Surfaces:
    """The surfaces of these rays: instances, and squares of PATCH_M of one class where there is no instance."""
    instance = np.asarray(scan.instance)[index].astype(np.int64)
    hit = np.asarray(scan.hit)[index]
    kind = np.asarray(scan.semantic)[index]
    range_m = np.asarray(scan.range_m)[index]
    ray = np.asarray(directions(scan.grid))[index[1], index[2]]
    x, y = _cell(range_m * ray[..., 0], hit), _cell(range_m * ray[..., 1], hit)
    block = np.broadcast_to(np.arange(len(instance))[:, None, None], instance.shape)
    # Objects are whole; ground, walls and the like are cut into squares of one class.
    thing = instance > 0
    key = (block, thing, np.where(thing, instance, kind), np.where(thing, 0, x), np.where(thing, 0, y))
    first_ray, of_ray = _numbered(*(part[hit] for part in key))
    first_of_strip, strip_of_ray = _numbered(of_ray, index[2][hit])
    strip = np.zeros(instance.shape, np.int32)
    strip[hit] = strip_of_ray + 1
    surface = np.zeros(_room(len(first_of_strip)), np.int32)
    surface[1 : len(first_of_strip) + 1] = of_ray[first_of_strip] + 1
    precision = np.full(_room(len(first_ray)), FIRM, np.float32)
    precision[1 : len(first_ray) + 1] = 1 / np.where(thing[hit][first_ray], OBJECT_SD, PATCH_SD) ** 2
    return Surfaces(strip, surface, precision)


def _numbered(
    *keys: Int[np.ndarray, " n"] | Bool[np.ndarray, " n"],
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Numbers of what has the same keys, in the order of the first key, then of the second ...: where each number comes
    first, and the number of each."""
    joined, count = np.zeros(len(keys[0]), np.int64), 1
    for key in keys:
        # Sorting whole numbers is far faster than sorting rows of keys. Ids may be any: they are made small first.
        _, small = np.unique(key, return_inverse=True)
        most = int(small.max(initial=0)) + 1
        if count * most > np.iinfo(np.int64).max:
            _, joined = np.unique(joined, return_inverse=True)
            count = int(joined.max(initial=0)) + 1
        joined, count = joined * most + small, count * most
    _, first, number = np.unique(joined, return_index=True, return_inverse=True)
    return first, number


def _cell(position_m: Float[np.ndarray, "b c r"], hit: Bool[np.ndarray, "b c r"]) -> Int[np.ndarray, "b c r"]:
    """Number of the square of PATCH_M along one axis."""
    return np.floor(np.where(hit, position_m, 0) / PATCH_M).astype(np.int64)


def _room(count: int) -> int:
    return -(-(count + 1) // ROOM) * ROOM


def bends(
    range_m: Float[Array, "*n"],
    beside_m: Float[Array, "*n 4"],
    row: Int[Array, "*n"],
    *,
    elevation_rad: Float[Array, " r"],
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """How far the neighbours to the sides, and those above and below, are from one plane with the ray: their mean of
    1 / range (straight on a plane) over the ray's own, less 1. Neighbours that hit nothing count as 10 km away."""
    inverse = 1 / jnp.maximum(jnp.where(jnp.isfinite(beside_m), beside_m, 1e4), LEAST_M)
    last = elevation_rad.shape[0] - 1
    above = jnp.abs(elevation_rad[jnp.maximum(row - 1, 0)] - elevation_rad[row])
    below = jnp.abs(elevation_rad[jnp.minimum(row + 1, last)] - elevation_rad[row])
    # Columns of a raster are even, its rows need not be: neighbours above and below weigh by their distances.
    share = below / jnp.maximum(above + below, 1e-6)
    sides = (inverse[..., 0] + inverse[..., 1]) / 2 * range_m - 1
    stack = (share * inverse[..., 2] + (1 - share) * inverse[..., 3]) * range_m - 1
    return jnp.abs(sides), jnp.abs(stack)


@jax.jit
def with_planes(scan: Scan) -> Scan:
    """The scan with incidence angles from its range image wherever that shows a plane: a simulator's normals may be
    noisy, and effects that grow with the tangent of the angle would look weaker than they are."""
    slant, has_normal = incidence(scan.range_m, scan.hit, scan.grid)
    row = jnp.broadcast_to(jnp.arange(scan.range_m.shape[1])[:, None], scan.range_m.shape)
    sides, stack = bends(scan.range_m, neighbours_m(scan), row, elevation_rad=scan.grid.elevation_rad)
    # Both ways, or the edge of a kerb would get the normal of neither side.
    plane = scan.hit & has_normal & (sides < RULES.plane_bend) & (stack < RULES.plane_bend)
    return replace(scan, incidence_rad=jnp.where(plane, slant, scan.incidence_rad))


def edges(rays: Rays, elevation_rad: Float[Array, " r"]) -> Bool[Array, "*n"]:
    """Rays whose neighbours do not continue their surface, or lie beside the sky.

    To the sides a step counts, of `Rules.edge_step_m` and `edge_step_share` of the range; all round a bend (`bends`).
    """
    # A step to the side, a bend any way, or the sky beside; of rays that hit nothing, a surface beside.
    sky = ~jnp.isfinite(rays.beside_m)
    beside = jnp.where(sky, 1e4, rays.beside_m)
    step_m = jnp.maximum(RULES.edge_step_m, RULES.edge_step_share * rays.range_m)
    side = jnp.abs(beside[..., :2] - rays.range_m[..., None]) > step_m[..., None]
    sides, stack = bends(rays.range_m, rays.beside_m, rays.row, elevation_rad=elevation_rad)
    last = elevation_rad.shape[0] - 1
    # The border repeats the ray itself: half of the step to its one neighbour is left.
    at_border = (rays.row == 0) | (rays.row == last)
    most = jnp.where(at_border, RULES.edge_bend_at_border, RULES.edge_bend)
    bent = (sides > RULES.edge_bend) | (stack > most)
    return jnp.where(rays.hit, side.any(-1) | bent | sky.any(-1), ~sky.all(-1))
