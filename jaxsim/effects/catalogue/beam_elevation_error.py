"""Each beam points a little higher or lower than its table says."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays
from jaxsim.effects.recast import Displaced, Displacement, displacement


def displace(p: dict[str, Array], rays: Rays) -> Displacement:
    """Adds the beam's error to the ray's true elevation; the reading is written under the nominal one."""
    return displacement(rays, turn_rad=(jnp.zeros_like(rays.range_m), p["error_rad"][rays.row]))


EFFECT = Effect(
    name="beam_elevation_error",
    stage="geometry",
    title="each beam points higher or lower than its table says",
    formula="true elevation = nominal + error[row]",
    parameters={
        "error_rad": Parameter(0.0, -0.01, 0.01, "rad", "true minus nominal, up positive", scale=0.0014, shape="row"),
    },
    channels=("range", "intensity", "drop"),
    betrays="The range residual differs by row and grows as r² on the road, while walls stay where they are.",
    covariates=("row", "range"),
    look_alikes={
        "beam_range_bias": "a bias is constant over range and the same on walls",
        "extrinsic_rotation": "pitch and roll change sign from front to rear or side to side",
        "extrinsic_translation": "a height error grows as r and is common to all beams",
    },
    source="Velodyne HDL-64E calibration (vertCorrection); 0.05..0.2 degrees",
    apply=Displaced(displace, passes=2),
)
