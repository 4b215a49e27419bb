"""What is compared: thinned rays of the simulation beside what the sensor said of them.

Letters: b blocks, c columns, r rows. A block is a frame, or a sector of one where there is but one scan. A unit
is what statistics count: a scene (drive), or a sector. Whole columns are kept, since columns are lost whole.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.discover.lattice import FINEST, lattice_step
from jaxsim.effects.edge_dropout import at_edge
from jaxsim.effects.rays import FLOOR, Rays, Scan, neighbours_m, rays_at
from jaxsim.effects.recast import displacement, recast
from jaxsim.frame import Array
from jaxsim.geometry.normals import incidence
from jaxsim.geometry.polar import directions

CLASS_SD = 0.3
"""Of a class's reflectance about the simulator's table, nats."""
CURVATURE_SD = 0.002
"""Of the curvature 0.5 sec(incidence)**2 that noise of 2.5 degrees on the simulator's normals leaves."""
STEEPEST_RAD = np.deg2rad(80.0)
"""Intensity is compared below this incidence."""
GROUND, TERRAIN = (6, 7, 8, 9, 10), (22,)
"""Cityscapes ids of flat surfaces, whose normals a range image gives best, and of those that roll."""
BLURRED = 3.0
"""Steps of the sensor's rounding below which predicted intensities are not compared: their logarithms are off."""
LEAST_SLANT = 0.03
"""Cosine of incidence below which a range tells nothing: it changes by 33 times what the surface does."""
POSE_SD = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
"""Of a frame's pose: m along x, y, z and rad about them."""


@struct.dataclass
class Measured:
    """A sensor's frames on the grid of the simulated ones."""

    range_m: Float[Array, "f r c"]
    intensity: Float[Array, "f r c"]
    valid: Bool[Array, "f r c"]


@struct.dataclass
class Evidence:
    """Thinned rays, what was measured of them, and what their nuisances need."""

    rays: Rays
    returned: Bool[Array, "b c r"]
    range_m: Float[Array, "b c r"]
    log_intensity: Float[Array, "b c r"]
    lowest: Float[Array, ""]
    """ln of the weakest reading that is not 0: a 0 says that the intensity lies below it."""
    given_rad: Float[Array, "b c r"]
    """The simulator's own angle of incidence, which its intensity follows; noisy, it may be."""
    compared: Bool[Array, "b c r"]
    """The intensity is that of the predicted surface: it returned, close by, at no edge, not at grazing incidence, and
    is not so weak that the sensor's rounding blurs it."""
    edge: Bool[Array, "b c r"]
    """A neighbour lies clearly nearer or farther, or one of the two hits nothing."""
    step: Bool[Array, "b c r"]
    """The range steps to a neighbour of any side, as rows of the road do far away; `edge` leaves those out."""
    pose: Float[Array, "b c r 6"]
    """Change of range with the sensor's pose (x, y, z, and rotations about them); 0 at grazing incidence."""
    features: Float[Array, "b c r p"]
    """Of the reflectance nuisance: 1, class indicators, curvature in the incidence, and how much brighter the surface
    would be with the normal of the simulator's own range image, on flat ground, on terrain and elsewhere (the
    simulator's normals may be noisy)."""
    ridge: Float[Array, " p"]
    strip: Int[Array, "b c r"]
    """The part of a surface that one column sees, which is alike: numbered through all frames, 0 none."""
    surface: Int[Array, " t"]
    """That each strip belongs to: an object, or a patch of what is no object; 0 none."""
    hold: Float[Array, " s"]
    """1 / variance of each surface's reflectance about its class, 1/nats^2."""
    unit: Int[Array, " b"]
    units: int = struct.field(pytree_node=False, default=0)


OBJECT_SD, PATCH_SD, STRIP_SD, STREET_SD = 0.2, 0.15, 0.1, 0.1
"""Of the reflectance, nats: of an object and of a patch of ground or wall about its class in the street, of a strip
about its surface, of all that is of one class in one street about the class."""
FIRM = 1e12
"""1 / variance of what has no reflectance of its own."""
PATCH_M = 6.0
"""Ground and walls are alike over about so much."""
ROOM = 2048
"""Strips and surfaces are counted up to a multiple of this, so that fits of other frames need not be compiled again."""
BEND = 0.03
PLANAR = 0.01
"""Neighbours' mean of 1 / range within this share of the ray's own: one plane, whose normal the range image gives."""


def bends(
    range_m: Float[Array, "*n"],
    beside_m: Float[Array, "*n 4"],
    row: Int[Array, "*n"],
    elevation_rad: Float[Array, " r"],
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """How far the neighbours to the sides, and those above and below, are from one plane with the ray: their mean of
    1 / range (straight on a plane) over the ray's own, less 1."""
    inverse = 1 / jnp.maximum(jnp.where(jnp.isfinite(beside_m), beside_m, 1e4), 0.1)
    last = elevation_rad.shape[0] - 1
    above = jnp.abs(elevation_rad[jnp.maximum(row - 1, 0)] - elevation_rad[row])
    below = jnp.abs(elevation_rad[jnp.minimum(row + 1, last)] - elevation_rad[row])
    share = below / jnp.maximum(above + below, 1e-6)
    sides = (inverse[..., 0] + inverse[..., 1]) / 2 * range_m - 1
    stack = (share * inverse[..., 2] + (1 - share) * inverse[..., 3]) * range_m - 1
    return jnp.abs(sides), jnp.abs(stack)


@jax.jit
def with_planes(scan: Scan) -> Scan:
    """The scan with incidence angles from its range image wherever that shows a plane: a simulator's normals may be
    noisy, and effects that grow with the tangent of the angle would look weaker than they are."""
    slant, known = incidence(scan.range_m, scan.hit, scan.grid)
    row = jnp.broadcast_to(jnp.arange(scan.range_m.shape[1])[:, None], scan.range_m.shape)
    sides, stack = bends(scan.range_m, neighbours_m(scan), row, scan.grid.elevation_rad)
    plane = scan.hit & known & (sides < PLANAR) & (stack < PLANAR)
    return replace(scan, incidence_rad=jnp.where(plane, slant, scan.incidence_rad))


def edges(rays: Rays, elevation_rad: Float[Array, " r"]) -> Bool[Array, "*n"]:
    """Rays whose neighbours do not continue their surface, or lie beside the sky.

    To the sides a step of 0.3 m and 5 % of the range counts; a bend (`bends`) of 3 % counts all round.
    """
    sky = ~jnp.isfinite(rays.beside_m)
    beside = jnp.where(sky, 1e4, rays.beside_m)
    side = jnp.abs(beside[..., :2] - rays.range_m[..., None]) > jnp.maximum(0.3, 0.05 * rays.range_m)[..., None]
    sides, stack = bends(rays.range_m, rays.beside_m, rays.row, elevation_rad)
    last = elevation_rad.shape[0] - 1
    # The border repeats the ray itself: half of the step to its one neighbour is left.
    bent = (sides > BEND) | (stack > jnp.where((rays.row == 0) | (rays.row == last), 0.2, BEND))
    return jnp.where(rays.hit, side.any(-1) | bent | sky.any(-1), ~sky.all(-1))


def near_enough(measured_m: Array, predicted_m: Array) -> Array:
    """Whether a reading is of the predicted surface, or close by."""
    return jnp.abs(measured_m - predicted_m) < jnp.maximum(0.5, 0.05 * predicted_m)


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
        by = displacement(rays, turn_rad=(turn, lift), move_m=(x * one, y * one, z * one))
        return recast(rays, scan, by, passes=1).range_m

    return jnp.moveaxis(jax.vmap(lambda axis: jax.jvp(reading, (jnp.zeros(6),), (axis,))[1])(jnp.eye(6)), 0, -1)


@struct.dataclass
class Cast:
    """Rays of chosen columns, as they are simulated."""

    rays: Rays
    pose: Float[Array, "b c r 6"]
    """Change of range with the sensor's pose, at any incidence."""

    def part(self, keep: Bool[np.ndarray, " b"]) -> Cast:
        """Of some blocks alone."""
        return jax.tree.map(lambda leaf: np.asarray(leaf)[keep] if np.ndim(leaf) else leaf, self)


def cast(scan: Scan, frame: Int[np.ndarray, " b"], column: Int[np.ndarray, "b c"]) -> Cast:
    """The rays of these columns of each block's frame."""
    return _cast(scan, _places(scan, frame, column))


def _places(scan: Scan, frame: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, ...]:
    """Frame, row and column of each ray (b, c, r)."""
    row = np.arange(scan.range_m.shape[1])
    at = np.broadcast_arrays(frame[:, None, None], row[None, None, :], column[:, :, None])
    return tuple(part.astype(np.int32) for part in at)


@jax.jit
def _cast(scan: Scan, at: Any) -> Cast:
    rays = rays_at(scan, *at)
    return Cast(rays, pose_derivatives(scan, rays))


def gather(
    scan: Scan,
    measured: Measured,
    frame: np.ndarray,
    column: np.ndarray,
    unit: np.ndarray,
    *,
    given_rad: Array | None = None,
    rays: Cast | None = None,
) -> Evidence:
    """The evidence of chosen columns: `frame` (b,), `column` (b, c), `unit` (b,) of each block.

    `given_rad` (f, r, c) are the simulator's own incidence angles, where those of `scan` are better (`with_planes`);
    `rays` what `cast` gives for these columns, where it was asked before.
    """
    at = _places(scan, frame, column)
    strip, surface, hold = _surfaces(scan, at)
    values, seen = np.asarray(measured.intensity)[at], np.asarray(measured.valid)[at]
    step = lattice_step(values[seen], finest=FINEST["intensity_quantization"])
    classes = np.unique(np.asarray(scan.semantic)[at])
    lowest = np.log(np.min(values, where=seen & (values > FLOOR), initial=1.0))
    return _gather(
        scan,
        measured,
        scan.incidence_rad if given_rad is None else given_rad,
        at,
        rays or cast(scan, frame, column),
        (strip, surface, hold),
        unit.astype(np.int32),
        (np.float32(BLURRED * step), np.float32(lowest)),
        classes=tuple(int(c) for c in classes),
        units=int(unit.max()) + 1,
    )


def _surfaces(
    scan: Scan, at: tuple[np.ndarray, ...]
) -> tuple[Int[np.ndarray, "b c r"], Int[np.ndarray, " t"], Float[np.ndarray, " s"]]:
    """`Evidence.strip`, `surface` and `hold`: each surface lies in one block."""
    instance = np.asarray(scan.instance)[at].astype(np.int64)
    hit, kind, range_m = (np.asarray(raster)[at] for raster in (scan.hit, scan.semantic, scan.range_m))
    ray = np.asarray(directions(scan.grid))[at[1], at[2]]
    x, y = (np.floor(np.where(hit, range_m * ray[..., k], 0) / PATCH_M).astype(np.int64) for k in (0, 1))
    block = np.broadcast_to(np.arange(len(instance))[:, None, None], instance.shape)
    thing = instance > 0
    key = np.stack([block, thing, np.where(thing, instance, kind), np.where(thing, 0, x), np.where(thing, 0, y)])
    _, first, number = np.unique(key[:, hit], axis=1, return_index=True, return_inverse=True)
    _, begin, of = np.unique(np.stack([number.ravel(), at[2][hit]]), axis=1, return_index=True, return_inverse=True)
    strip = np.zeros(instance.shape, np.int32)
    strip[hit] = of.ravel() + 1
    surface = np.zeros(_room(len(begin)), np.int32)
    surface[1 : len(begin) + 1] = number.ravel()[begin] + 1
    hold = np.full(_room(len(first)), FIRM, np.float32)
    hold[1 : len(first) + 1] = 1 / np.where(thing[hit][first], OBJECT_SD, PATCH_SD) ** 2
    return strip, surface, hold


def _room(count: int) -> int:
    return -(-(count + 1) // ROOM) * ROOM


@partial(jax.jit, static_argnames=("classes", "units"))
def _gather(
    scan: Scan,
    measured: Measured,
    given_rad: Array,
    at: Any,
    simulated: Cast,
    surfaces: Any,
    unit: Any,
    limits: Any,
    *,
    classes: Any,
    units: int,
) -> Evidence:
    rays, pose, (least, lowest) = simulated.rays, simulated.pose, limits
    returned, range_m = measured.valid[at], measured.range_m[at]
    steady = rays.hit & (jnp.abs(pose[..., 3:]).max(-1) < rays.range_m / LEAST_SLANT)
    edge = edges(rays, scan.grid.elevation_rad) | (rays.hit & ~steady)
    step = rays.hit & at_edge(rays)
    near = near_enough(range_m, rays.range_m)
    given = given_rad[at]
    # Both angles must be moderate: of noisy angles, the moderate ones often stand for grazing surfaces.
    moderate = (rays.incidence_rad < STEEPEST_RAD) & (given < STEEPEST_RAD)
    # By what is predicted, not by what was measured, which would choose the brighter of the dark rays.
    clear = rays.log_intensity > jnp.log(jnp.maximum(least, FLOOR))
    compared = rays.hit & returned & near & ~edge & moderate & clear
    steep, better = (jnp.minimum(angle, STEEPEST_RAD) for angle in (given, rays.incidence_rad))
    one_hot = [(rays.semantic == c).astype(jnp.float32) for c in classes]
    disagree = jnp.clip(jnp.log(jnp.cos(better)) - jnp.log(jnp.cos(steep)), -1.5, 1.5)
    flat, rolling = (jnp.isin(rays.semantic, jnp.asarray(ids)) for ids in (GROUND, TERRAIN))
    apart = [jnp.where(kind, disagree, 0) for kind in (flat, rolling, ~flat & ~rolling)]
    features = jnp.stack([jnp.ones_like(steep), *one_hot, 0.5 / jnp.cos(steep) ** 2, *apart], axis=-1)
    ridge = np.array([1e-6, *[1 / CLASS_SD**2] * len(classes), 1 / CURVATURE_SD**2, 1.0, 1.0, 1.0], np.float32)
    return Evidence(
        rays=rays,
        returned=returned,
        range_m=range_m,
        log_intensity=jnp.log(jnp.maximum(measured.intensity[at], FLOOR)),
        lowest=lowest,
        given_rad=given,
        compared=compared,
        edge=edge,
        step=step,
        pose=jnp.where(steady[..., None], pose, 0),
        features=jnp.where(compared[..., None], features, 0).astype(jnp.float32),
        ridge=ridge,
        strip=surfaces[0],
        surface=surfaces[1],
        hold=surfaces[2],
        unit=unit,
        units=units,
    )
