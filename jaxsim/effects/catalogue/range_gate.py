"""The sensor listens from a shortest to a longest range."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import NEVER, Array, Rays

NEAR_SOFT_M, FAR_SOFT_M = 0.2, 1.0
"""Just outside the gate echoes vanish over this distance, so that the gate has a derivative."""
OPEN_M = 200.0


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Loses echoes outside the gate; a maximum of 200 m is none."""
    near = jnp.clip((p["minimum_m"] - rays.range_m) / NEAR_SOFT_M, 0.0, 1.0)
    far = jnp.clip((rays.range_m - p["maximum_m"]) / FAR_SOFT_M, 0.0, 1.0)
    outside = near + jnp.where(p["maximum_m"] >= OPEN_M, jnp.zeros_like(far), far)
    return replace(rays, log_keep=rays.log_keep + NEVER * jnp.where(rays.hit, outside, jnp.zeros_like(outside)))


EFFECT = Effect(
    name="range_gate",
    stage="detection",
    title="nothing returns from nearer or farther than the gate",
    formula="keep = 0 where r < minimum or r > maximum",
    parameters={
        "minimum_m": Parameter(0.0, 0.0, 15.0, "m", "shortest range", scale=3.0),
        "maximum_m": Parameter(OPEN_M, 15.0, OPEN_M, "m", "longest range", scale=60.0),
    },
    channels=("drop",),
    signature="All returns are missing beyond one range, or before one, whatever their power; the border is sharp.",
    covariates=("range",),
    look_alikes={
        "snr_dropout": "a threshold of power spares bright surfaces beyond the border",
        "atmospheric_extinction": "extinction dims before it loses",
        "near_range_overlap": "overlap dims, a gate cuts",
        "sector_occlusion": "compare azimuths",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019) (nearest about 0.9 m, "
    "no return beyond 150 m)",
    apply=apply,
    starts=(
        *({"minimum_m": m} for m in (2.0, 4.0, 6.0, 9.0, 12.0)),
        *({"maximum_m": m} for m in (25.0, 40.0, 55.0, 70.0, 90.0, 120.0)),
    ),
)
