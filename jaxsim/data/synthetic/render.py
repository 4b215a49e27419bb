"""Pictures and sweeps of a scene: the same solids, street and materials seen by a camera and by a LiDAR.

`*_pose` is world_from_cam or world_from_velo. Images are cut into tiles; each row of tiles is one step of a
`lax.map`, small enough to stay in the cache.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Bool, Float, Int, UInt8

from jaxsim.data.synthetic.light import Light, Shadows, develop, lit, map_borders, open_sky, shade, sky
from jaxsim.data.synthetic.materials import surface
from jaxsim.data.synthetic.raycast import GROUND, Candidates, cast, cast_solids
from jaxsim.data.synthetic.solids import Solids
from jaxsim.data.synthetic.street import Street
from jaxsim.frame import Array, PolarGrid
from jaxsim.geometry import directions

CAMERA_TILE = (32, 32)
LIDAR_TILE = (16, 64)
SHADOW_CELLS, SHADOW_TILE = (256, 512), (32, 32)
COVER_CELLS, COVER_TILE = (128, 256), (32, 32)
SKY_HEIGHT_M = 90.0


@struct.dataclass
class Scene:
    """Everything that light can meet."""

    solids: Solids
    street: Street
    light: Light


@struct.dataclass
class Picture:
    """What a perfect camera delivers."""

    rgb: UInt8[Array, "h w 3"]
    depth_m: Float[Array, "h w"]
    valid: Bool[Array, "h w"]
    """False in the sky."""
    semantic: Int[Array, "h w"]
    instance: Int[Array, "h w"]


@struct.dataclass
class Scan:
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
    semantic: Int[Array, "rows columns"]
    instance: Int[Array, "rows columns"]


def _tile(raster: Float[Array, "3 h w"], tile: tuple[int, int]) -> Float[Array, "down 3 across cells"]:
    _, h, w = raster.shape
    pad = (-h % tile[0], -w % tile[1])
    raster = jnp.pad(raster, ((0, 0), (0, pad[0]), (0, pad[1])), mode="edge")
    down, across = raster.shape[1] // tile[0], raster.shape[2] // tile[1]
    cut = raster.reshape(3, down, tile[0], across, tile[1]).transpose(1, 0, 3, 2, 4)
    return cut.reshape(down, 3, across, tile[0] * tile[1])


def _untile(cut: Array, tile: tuple[int, int], size: tuple[int, int]) -> Array:
    """From (down, across, cells) or (down, 3, across, cells) to (h, w) or (h, w, 3)."""
    channels = cut.shape[1:-2]
    down, across = cut.shape[0], cut.shape[-2]
    grid = cut.reshape(down, -1, across, *tile).transpose(0, 3, 2, 4, 1)
    grid = grid.reshape(down * tile[0], across * tile[1], -1)[: size[0], : size[1]]
    return grid if channels else grid[..., 0]


def _by_rows(candidates: Candidates, down: int) -> Candidates:
    return jax.tree.map(lambda leaf: leaf.reshape(down, leaf.shape[0] // down, *leaf.shape[1:]), candidates)


def _turned(rotation: Float[Array, "3 3"], v: Float[Array, "3 *r"]) -> Float[Array, "3 *r"]:
    return jnp.stack([sum(rotation[i, j] * v[j] for j in range(3)) for i in range(3)])


@jax.jit
def cast_shadows(
    solids: Solids,
    sun: Float[Array, "3"],
    eye_m: Float[Array, "2"],
    *,
    sunward: Candidates,
    upward: Candidates,
) -> Shadows:
    """Shadow map and sky cover of the ground around and ahead of `eye_m`."""
    heights = _heights(solids, sun, eye_m, SHADOW_CELLS, SHADOW_TILE, sunward)
    up = jnp.array([0.0, 0.0, 1.0], jnp.float32)
    above = _heights(solids, up, eye_m, COVER_CELLS, COVER_TILE, upward)
    # Only what stands low darkens its surroundings: cars and people, not roofs and crowns.
    covered = jnp.where((above > 0.15) & (above < 3.2), 1.0, 0.0)
    for axis in (0, 1):
        for _ in range(2):
            covered = 0.5 * covered + 0.25 * (jnp.roll(covered, 1, axis) + jnp.roll(covered, -1, axis))
    return Shadows(heights, 0.85 * covered, eye_m)


def _heights(solids, towards, eye_m, cells, tile, candidates) -> Float[Array, "down across"]:
    x, y = (0.5 * (b[1:] + b[:-1]) for b in map_borders(cells))
    ground = jnp.stack(
        [
            *jnp.broadcast_arrays(jnp.asarray(x, jnp.float32)[None, :], jnp.asarray(y, jnp.float32)[:, None]),
            jnp.zeros(cells, jnp.float32),
        ]
    )
    ground = ground + jnp.stack([eye_m[0], eye_m[1], jnp.float32(0.0)])[:, None, None]
    climb = SKY_HEIGHT_M / towards[2]
    cut = _tile(ground + (climb * towards)[:, None, None], tile)

    def one(row):
        origin, listed = row
        distance, code = cast_solids(
            solids, origin, jnp.broadcast_to(-towards[:, None, None], origin.shape), candidates=listed
        )
        return jnp.where(code >= 0, (climb - distance) * towards[2], -1.0)

    return _untile(jax.lax.map(one, (cut, _by_rows(candidates, cut.shape[0]))), tile, cells)


@partial(jax.jit, static_argnames="size")
def take_picture(
    scene: Scene,
    shadows: Shadows,
    intrinsics: Float[Array, "3 3"],
    *,
    cam_pose: Float[Array, "4 4"],
    candidates: Candidates,
    size: tuple[int, int],
    key: Array,
) -> Picture:
    """Renders the view of a pinhole camera; depth is planar, classes are of the pixel's centre."""
    h, w = size
    focal = intrinsics[0, 0]
    u = (jnp.arange(w, dtype=jnp.float32) - intrinsics[0, 2]) / focal
    v = (jnp.arange(h, dtype=jnp.float32) - intrinsics[1, 2]) / intrinsics[1, 1]
    across, down = jnp.broadcast_arrays(u[None, :], v[:, None])
    rays = _tile(
        _turned(cam_pose[:3, :3], jnp.stack([across, down, jnp.ones(size, jnp.float32)])), CAMERA_TILE
    )
    eye = cam_pose[:3, 3, None, None]

    def one(row):
        direction, listed = row
        hit = cast(scene.solids, scene.street, eye, direction, candidates=listed)
        length = jnp.sqrt(jnp.sum(direction * direction, axis=0))
        at, view = eye + hit.distance[None] * direction, direction / length[None]
        seen = surface(scene.solids, scene.street, hit, at, hit.distance / focal)
        normal = hit.normal * jnp.where(jnp.sum(hit.normal * view, axis=0) > 0.0, -1.0, 1.0)[None]
        flat = (hit.solid == GROUND) & ~hit.kerb
        radiance = shade(
            scene.light,
            seen.rgb,
            seen.gloss,
            (view, normal),
            sunlit=lit(shadows, scene.light, at, normal),
            sky_open=jnp.where(flat, open_sky(shadows, at), 1.0),
            distance_m=hit.distance * length,
        )
        in_sky = hit.solid > GROUND
        radiance = jnp.where(in_sky[None], sky(scene.light, view), radiance)
        depth = jnp.where(in_sky, 0.0, hit.distance)
        return develop(scene.light, radiance), depth, ~in_sky, seen.semantic, seen.instance

    rows = jax.lax.map(one, (rays, _by_rows(candidates, rays.shape[0])))
    rgb, *rest = (_untile(leaf, CAMERA_TILE, size) for leaf in rows)
    # A lens and a sensor: slight blur, slight noise.
    for axis in (0, 1):
        rgb = 0.66 * rgb + 0.17 * (_shift(rgb, 1, axis) + _shift(rgb, -1, axis))
    rgb = rgb + 0.008 * jax.random.normal(key, rgb.shape, jnp.float32)
    return Picture(jnp.clip(255.0 * rgb + 0.5, 0.0, 255.0).astype(jnp.uint8), *rest)


def _shift(image: Float[Array, "h w 3"], by: int, axis: int) -> Float[Array, "h w 3"]:
    """Moves an image by one pixel, repeating its border."""
    pad = [(0, 0)] * 3
    pad[axis] = (1, 1)
    start = 1 - by
    return jax.lax.slice_in_dim(jnp.pad(image, pad, mode="edge"), start, start + image.shape[axis], axis=axis)


@jax.jit
def scan(scene: Scene, grid: PolarGrid, *, velo_pose: Float[Array, "4 4"], candidates: Candidates) -> Scan:
    """Casts every ray of a polar grid, each from its own beam's origin."""
    rays = directions(grid)
    size = rays.shape[:2]
    turn = velo_pose[:3, :3]
    direction = _tile(_turned(turn, jnp.moveaxis(rays, -1, 0)), LIDAR_TILE)
    height = jnp.broadcast_to(grid.origin_m[None, :, None], (1, *size))
    rise = _tile(turn[:, 2, None, None] * height + velo_pose[:3, 3, None, None], LIDAR_TILE)

    def one(row):
        origin, direction, listed = row
        hit = cast(scene.solids, scene.street, origin, direction, candidates=listed)
        at = origin + hit.distance[None] * direction
        seen = surface(scene.solids, scene.street, hit, at, 2e-3 * hit.distance)
        facing = jnp.abs(jnp.sum(hit.normal * direction, axis=0))
        return Scan(
            range_m=hit.distance,
            valid=hit.solid <= GROUND,
            incidence_rad=jnp.arccos(jnp.clip(facing, 0.0, 1.0)),
            reflectance=seen.nir,
            glass=seen.glass,
            retro=seen.retro,
            absorbing=seen.absorbing,
            semantic=seen.semantic,
            instance=seen.instance,
        )

    rows = jax.lax.map(one, (rise, direction, _by_rows(candidates, direction.shape[0])))
    return jax.tree.map(lambda leaf: _untile(leaf, LIDAR_TILE, size), rows)
