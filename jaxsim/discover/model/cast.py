"""Rays of chosen columns as they are simulated, and how their ranges change with the sensor's pose."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from jaxsim.effects.edits import displace
from jaxsim.effects.rays import Rays, Scan, rays_at
from jaxsim.effects.recast import recast
from jaxsim.frame import Array


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
    return _cast(scan, places(scan, frame, column))


def places(scan: Scan, frame: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, ...]:
    """Frame, row and column of each ray (b, c, r)."""
    row = np.arange(scan.range_m.shape[1])
    at = np.broadcast_arrays(frame[:, None, None], row[None, None, :], column[:, :, None])
    return tuple(part.astype(np.int32) for part in at)


@jax.jit
def _cast(scan: Scan, at: Any) -> Cast:
    rays = rays_at(scan, *at)
    return Cast(rays, pose_derivatives(scan, rays))
