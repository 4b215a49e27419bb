"""The sensor is mounted at a slightly different angle."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import displace
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Sends rays along R(roll, pitch, yaw) times their nominal direction; R = Rz(yaw) Ry(pitch) Rx(roll)."""
    sr = jnp.sin(p["roll_rad"])
    sp = jnp.sin(p["pitch_rad"])
    sy = jnp.sin(p["yaw_rad"])
    cr = jnp.cos(p["roll_rad"])
    cp = jnp.cos(p["pitch_rad"])
    cy = jnp.cos(p["yaw_rad"])
    x = jnp.cos(rays.elevation_rad) * jnp.cos(rays.azimuth_rad)
    y = jnp.cos(rays.elevation_rad) * jnp.sin(rays.azimuth_rad)
    z = jnp.sin(rays.elevation_rad)
    # By how much the direction changes: (R - 1) times it. Angles follow without cancellation.
    dx = (cy * cp - 1) * x + (cy * sp * sr - sy * cr) * y + (cy * sp * cr + sy * sr) * z
    dy = sy * cp * x + (sy * sp * sr + cy * cr - 1) * y + (sy * sp * cr - cy * sr) * z
    dz = -sp * x + cp * sr * y + (cp * cr - 1) * z
    rho = jnp.maximum(jnp.sqrt(x * x + y * y), 1e-3)
    rho_new = jnp.maximum(jnp.sqrt((x + dx) ** 2 + (y + dy) ** 2), 1e-3)
    # rho_new - rho, by the difference of their squares.
    longer = (dx * (2 * x + dx) + dy * (2 * y + dy)) / (rho + rho_new)
    # The angle between two directions is the arctangent of their cross and their dot product.
    azimuth = jnp.arctan2(x * dy - y * dx, x * (x + dx) + y * (y + dy))
    elevation = jnp.arctan2(rho * dz - z * longer, rho * rho_new + z * (z + dz))
    return displace(rays, turn_rad=(azimuth, elevation))


def _angle(meaning: str) -> Parameter:
    return Parameter(0.0, -0.05, 0.05, "rad", meaning, scale=0.006)


EFFECT = Effect(
    name="extrinsic_rotation",
    stage="geometry",
    title="the sensor is mounted at another angle than assumed",
    formula="true direction = R(roll, pitch, yaw) · nominal direction",
    parameters={
        "roll_rad": _angle("about x (forward): positive lifts the left side"),
        "pitch_rad": _angle("about y (left): positive dips the front"),
        "yaw_rad": _angle("about z (up): positive turns to the left"),
    },
    channels=("range", "intensity", "drop"),
    signature="Pitch and roll: the road's range residual grows as r² and changes sign from front to rear or from side "
    "to side. Yaw: edges are displaced, with opposite signs at left and right edges.",
    covariates=("azimuth", "range", "step", "row"),
    look_alikes={
        "beam_elevation_error": "an error of one beam has one sign all round",
        "extrinsic_translation": "a translation matters near by; a rotation grows with range",
        "motion_distortion": "motion vanishes at standstill",
        "range_scale": "a scale moves walls that face the sensor too",
        "mixed_pixels": "mixed readings lie between the two surfaces, displaced edges lie on one",
    },
    source="Levinson & Thrun, Automatic Online Calibration of Cameras and Lasers, RSS 2013 (miscalibration of the "
    "mounting, sudden and gradual)",
    apply=apply,
    casts=1,
)
