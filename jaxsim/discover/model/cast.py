"""Which columns of which frames are looked at, the scenes that they belong to, and their rays as simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.effects.edits import displace
from jaxsim.effects.rays import Rays, Scan, rays_at
from jaxsim.effects.recast import recast
from jaxsim.frame import Array

RAYS = 20_000
"""Rays that a fit looks at, if the frames have so many."""
FEWEST_COLUMNS = 8
"""Columns of each frame that are looked at in any case."""
SECTORS = 12
"""Frames of a single drive are cut into so many."""
GUARD_COLUMNS = 4
"""Columns left out on each side of a sector: neighbouring rays share a surface."""


@dataclass(frozen=True)
class Blocks:
    """Columns of frames, with the name of each block's scene: a drive, or a sector of the only one."""

    frame: Int[np.ndarray, " b"]
    column: Int[np.ndarray, "b c"]
    scene: tuple[str, ...]


def blocks(scenes: Sequence[str], rows: int, columns: int, *, rays: int = RAYS, seed: int = 0) -> Blocks:
    """Columns spread evenly over each frame, the first at random; of frames of one scene, sectors of the scan.

    Where all frames are of one scene, a sector of all of them counts as one: what a car or a wall does to one frame it
    does to the next. Raises ValueError where sectors would be too narrow.
    """
    rng = np.random.default_rng(seed)
    frames = len(scenes)
    if len(set(scenes)) == 1:
        width = columns // SECTORS
        inner = width - 2 * GUARD_COLUMNS
        if inner < FEWEST_COLUMNS:
            raise ValueError(
                f"discover: frames of one drive, of {columns} columns, are too narrow to be cut into {SECTORS} "
                "independent sectors; give frames of several drives, or "
                f"{SECTORS * (FEWEST_COLUMNS + 2 * GUARD_COLUMNS)} columns or more"
            )
        # Few frames give more columns each, so that a fit sees about as many rays.
        count = min(inner, max(-(-FEWEST_COLUMNS // frames), rays // (rows * SECTORS * frames)))
        within = GUARD_COLUMNS + _spread(rng, frames, columns=inner, count=count)
        column = np.arange(SECTORS)[None, :, None] * width + within[:, None, :]
        sectors = [f"sector {k:02d}" for k in range(SECTORS)]
        return Blocks(np.repeat(np.arange(frames), SECTORS), column.reshape(-1, count), (*sectors,) * frames)
    count = min(columns, max(FEWEST_COLUMNS, rays // (rows * frames)))
    return Blocks(np.arange(frames), _spread(rng, frames, columns=columns, count=count), tuple(scenes))


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
