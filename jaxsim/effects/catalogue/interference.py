"""Other LiDARs' pulses are taken for echoes."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import add_clutter
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

# A decay over 1000 km is none within reach: what is left is uniform.
_UNIFORM_M = 1e6


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds false returns, uniform in range; where a ray hits nothing, up to 100 m."""
    scale_m = jnp.full_like(p["probability"], _UNIFORM_M)
    return add_clutter(rays, p["probability"], power=0.0, scale_m=scale_m, from_m=0.5, intensity=p["intensity"])


EFFECT = Effect(
    name="interference",
    stage="path",
    title="pulses of other LiDARs are taken for echoes",
    formula="false return with a probability, uniform in range on (0.5 m, surface or 100 m)",
    parameters={
        "probability": Parameter(0.0, 0.0, 0.5, "", "share of rays with a false return", scale=0.03),
        "intensity": Parameter(0.2, 0.005, 1.0, "", "reported for them", scale=0.15),
    },
    channels=("range", "intensity"),
    signature="Scattered returns in front of surfaces and in the sky, as many at long as at short range.",
    covariates=("range", "intensity"),
    clutter=True,
    look_alikes={
        "precipitation_clutter": "rain is densest at the sensor and weak",
        "fog_backscatter": "fog has a ring at some metres",
        "blooming": "glare lies at the range of a bright target",
    },
    source="Popko, Gaylord & Valenta, Geometric Approximation Model of Inter-lidar Interference, Optical Engineering "
    "59(3), 2020",
    apply=apply,
    starts=({"probability": 0.02},),
)
