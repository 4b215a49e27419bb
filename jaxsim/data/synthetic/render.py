"""Pictures and sweeps of a scene: the same solids, street and materials seen by a camera and by a LiDAR.

`*_pose` is world_from_cam or world_from_velo.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int, UInt8

from jaxsim.data.synthetic.fields import Starts, Triple, dot, each, rotate, unit_vector
from jaxsim.data.synthetic.light import Light, Shadows, develop, lit, map_borders, mirror, open_sky, shade, sky
from jaxsim.data.synthetic.materials import surface
from jaxsim.data.synthetic.raycast import Hit, TileSolids, cast_solids, cast_tiles, hits_of, nearest_hits
from jaxsim.data.synthetic.solids import GROUND, Solids
from jaxsim.data.synthetic.street import Street
from jaxsim.frame import Array, PolarGrid
from jaxsim.geometry import directions

CAMERA_TILE = (32, 32)
LIDAR_TILE = (16, 64)
SHADOW_CELLS, SHADOW_TILE = (256, 512), (32, 32)
COVER_CELLS, COVER_TILE = (128, 256), (32, 32)
SKY_HEIGHT_M = 90.0
BEAM_RAD = 2e-3
"""Divergence of a laser beam, HDL-64E data sheet."""


@struct.dataclass
class LitScene:
    """Everything that light can meet."""

    solids: Solids
    street: Street
    light: Light


@struct.dataclass
class CameraView:
    """What lies before a camera. Of `look`: tile by tile."""

    light: Triple
    """RGB as displayed, 0..1, one ray a pixel."""
    depth_m: Float[Array, "h w"]
    valid: Bool[Array, "h w"]
    """False in the sky."""
    semantic: Int[Array, "h w"]
    instance: Int[Array, "h w"]


@struct.dataclass
class IdealScan:
    """What the LiDAR's rays meet, before any sensor has looked."""

    range_m: Float[Array, "rows columns"]
    valid: Bool[Array, "rows columns"]
    """False in the sky."""
    incidence_rad: Float[Array, "rows columns"]
    """Angle between ray and surface normal; 0 head on."""
    reflectance: Float[Array, "rows columns"]
    """Diffuse, at 905 nm, 0..1."""
    glass: Bool[Array, "rows columns"]
    retro: Bool[Array, "rows columns"]
    absorbing: Bool[Array, "rows columns"]
    marking: Bool[Array, "rows columns"]
    wet: Bool[Array, "rows columns"]
    semantic: Int[Array, "rows columns"]
    instance: Int[Array, "rows columns"]


@jax.jit
def cast_shadows(
    solids: Solids, sun: Float[Array, "3"], eye_m: Float[Array, "2"], *, sunward: TileSolids, upward: TileSolids
) -> Shadows:
    """Shadow map and sky cover of the ground around and ahead of `eye_m`."""
    heights = _heights(solids, sun, eye_m, cells=SHADOW_CELLS, tile=SHADOW_TILE, candidates=sunward)
    up = jnp.array([0.0, 0.0, 1.0], jnp.float32)
    above = _heights(solids, up, eye_m, cells=COVER_CELLS, tile=COVER_TILE, candidates=upward)
    # Only what stands low darkens its surroundings: cars and people, not roofs and crowns.
    covered = jnp.where((above > 0.15) & (above < 3.2), 1.0, 0.0)
    # Blurred twice: what a car hides of the sky fades with the distance from it.
    for axis in (0, 1):
        for _ in range(2):
            covered = 0.5 * covered + 0.25 * (jnp.roll(covered, 1, axis) + jnp.roll(covered, -1, axis))
    return Shadows(heights, 0.85 * covered, eye_m)


def _heights(
    solids: Solids,
    towards: Float[Array, "3"],
    eye_m: Float[Array, "2"],
    *,
    cells: tuple[int, int],
    tile: tuple[int, int],
    candidates: TileSolids,
) -> Float[Array, "down across"]:
    """Height at which each parallel ray towards a cell of the ground is stopped; -1 where it reaches it."""
    x, y = map_borders(cells)
    x = jnp.asarray(0.5 * (x[1:] + x[:-1]), jnp.float32) + eye_m[0]
    y = jnp.asarray(0.5 * (y[1:] + y[:-1]), jnp.float32) + eye_m[1]
    ground = jnp.broadcast_arrays(x[None, :], y[:, None], jnp.zeros(cells, jnp.float32))
    # From above all that stands, back along the rays to the ground.
    climb = SKY_HEIGHT_M / towards[2]
    start = each(lambda i: ground[i] + climb * towards[i])
    down = each(lambda i: jnp.broadcast_to(-towards[i], cells))
    distance, code = cast_solids(solids, start, down, candidates=candidates, tile=tile)
    return jnp.where(code >= 0, (climb - distance) * towards[2], -1.0)


def look(
    scene: LitScene,
    shadows: Shadows,
    intrinsics: Float[Array, "3 3"],
    *,
    cam_pose: Float[Array, "4 4"],
    candidates: TileSolids,
    width: int,
) -> CameraView:
    """Renders tiles of the view of a pinhole camera; depth is planar, classes are of the pixel's centre.

    A sequence of jitted steps, each of which leaves its fields to the next. The tiles are those of an image of that
    width which `candidates` names, in its order; those at the borders may reach beyond it.
    """
    light = scene.light
    across = -(-width // CAMERA_TILE[1])
    direction, view, length = _pixel_rays(intrinsics, cam_pose, tile=candidates.tile, across=across)
    eye = each(lambda i: cam_pose[i, 3][None, None])
    met = cast_tiles(scene.solids, eye, direction, candidates=candidates)
    hit = hits_of(scene.solids, scene.street, met, origin=eye, direction=direction)
    distance_m, pixel_m = _footprints(hit, view, length, focal_px=intrinsics[0, 0])
    seen = surface(scene.solids, scene.street, hit, pixel_m=pixel_m)
    in_sky = hit.solid > GROUND
    # One look at the sky a pixel: behind everything where there is nothing, in the surface's mirror elsewhere.
    normal, away = _shine(hit, view, seen.bend, in_sky=in_sky)
    heaven = sky(light, away)
    radiance = shade(
        light,
        seen.rgb,
        seen.gloss,
        view=view,
        normal=normal,
        mirrored=heaven,
        sunlit=lit(shadows, light, hit.at, normal=normal),
        sky_open=open_sky(shadows, hit.at, hit.normal),
        distance_m=distance_m,
    )
    shown = develop(light, radiance, heaven, in_sky=in_sky)
    return CameraView(shown, hit.distance, hit.solid <= GROUND, seen.semantic, seen.instance)


@partial(jax.jit, static_argnames="across")
def _pixel_rays(
    intrinsics: Float[Array, "3 3"], cam_pose: Float[Array, "4 4"], *, tile: Int[Array, " t"], across: int
) -> tuple[Triple, Triple, Float[Array, "t r"]]:
    """Directions of unit depth, the same at unit length, and the length of the former."""
    h, w = CAMERA_TILE
    ray = jnp.arange(h * w, dtype=jnp.int32)[None]
    u = (tile[:, None] % across * w + ray % w).astype(jnp.float32)
    v = (tile[:, None] // across * h + ray // w).astype(jnp.float32)
    x, y = (u - intrinsics[0, 2]) / intrinsics[0, 0], (v - intrinsics[1, 2]) / intrinsics[1, 1]
    direction = rotate(cam_pose[:3, :3], (x, y, jnp.ones_like(x)))
    length = jnp.sqrt(dot(direction, direction))
    return direction, each(lambda i: direction[i] / length), length


@jax.jit
def _footprints(hit: Hit, view: Triple, length: Float[Array, "h w"], *, focal_px: Float[Array, ""]):
    """Distances, and the sizes of pixels on the surfaces: the geometric mean of their two extents."""
    facing = jnp.maximum(jnp.abs(dot(hit.normal, view)), 0.02)
    # On a slanting surface a pixel is longer one way, by 1 / cosine: the mean of its extents has the root.
    return hit.distance * length, hit.distance / focal_px / jnp.sqrt(facing)


@jax.jit
def _shine(hit: Hit, view: Triple, bend: Triple, *, in_sky: Bool[Array, "h w"]) -> tuple[Triple, Triple]:
    """Normals towards the eye, and the directions of mirrored rays; rays that meet nothing go on."""
    side = jnp.where(dot(hit.normal, view) > 0.0, -1.0, 1.0)
    normal = unit_vector(each(lambda i: side * hit.normal[i] + bend[i]))
    away = mirror(view, normal)
    return normal, each(lambda i: jnp.where(in_sky, view[i], away[i]))


def photograph(image: Triple, key: Array) -> UInt8[np.ndarray, "h w 3"]:
    """A lens and a sensor: slight blur, slight noise, 8 bits; on the host.

    Steps of their own: in one program the blur would have each pixel rendered nine times, and the noise be drawn where
    channels are joined, number by number.
    """
    channels = _expose(image, _grain(key, shape=(3, *image[0].shape)))
    return np.stack([np.asarray(channel) for channel in channels], axis=-1)


@partial(jax.jit, static_argnames="shape")
def _grain(key: Array, *, shape: tuple[int, ...]) -> Float[Array, "3 h w"]:
    return jax.random.normal(key, shape, jnp.float32)


@jax.jit
def _expose(image: Triple, grain: Float[Array, "3 h w"]) -> tuple[UInt8[Array, "h w"], ...]:
    def channel(i: int) -> UInt8[Array, "h w"]:
        value = image[i]
        for axis in (0, 1):
            value = 0.66 * value + 0.17 * (_shift(value, 1, axis) + _shift(value, -1, axis))
        return jnp.clip(255.0 * (value + 0.008 * grain[i]) + 0.5, 0.0, 255.0).astype(jnp.uint8)

    return tuple(channel(i) for i in range(3))


def _shift(image: Float[Array, "h w"], by: int, axis: int) -> Float[Array, "h w"]:
    """Moves an image by one pixel, repeating its border."""
    pad = [(0, 0)] * 2
    pad[axis] = (1, 1)
    start = 1 - by
    return jax.lax.slice_in_dim(jnp.pad(image, pad, mode="edge"), start, start + image.shape[axis], axis=axis)


def scan(scene: LitScene, grid: PolarGrid, *, velo_pose: Float[Array, "4 4"], candidates: TileSolids) -> IdealScan:
    """Casts every ray of a polar grid, each from its own beam's origin."""
    origin, direction = _beams(grid, velo_pose)
    hit = nearest_hits(
        scene.solids, scene.street, origin=origin, direction=direction, candidates=candidates, tile=LIDAR_TILE
    )
    seen = surface(scene.solids, scene.street, hit, pixel_m=BEAM_RAD * hit.distance)
    return IdealScan(
        range_m=hit.distance,
        valid=hit.solid <= GROUND,
        incidence_rad=_incidence(hit, direction),
        reflectance=seen.nir,
        glass=seen.glass,
        retro=seen.retro,
        absorbing=seen.absorbing,
        marking=seen.marking,
        wet=seen.wet,
        semantic=seen.semantic,
        instance=seen.instance,
    )


@jax.jit
def _beams(grid: PolarGrid, velo_pose: Float[Array, "4 4"]) -> tuple[Starts, Triple]:
    turn = velo_pose[:3, :3]
    origin = each(lambda i: turn[i, 2] * grid.origin_m[:, None] + velo_pose[i, 3])
    rays = directions(grid)
    return origin, rotate(turn, each(lambda i: rays[..., i]))


@jax.jit
def _incidence(hit: Hit, direction: Triple) -> Float[Array, "rows columns"]:
    return jnp.arccos(jnp.clip(jnp.abs(dot(hit.normal, direction)), 0.0, 1.0))
