"""Each beam points a little higher or lower than its table says."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import displace
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds the beam's error to the ray's true elevation; the reading is written under the nominal one."""
    return displace(rays, turn_rad=(jnp.zeros_like(rays.range_m), p["error_rad"][rays.row]))


EFFECT = Effect(
    name="beam_elevation_error",
    stage="geometry",
    title="each beam points higher or lower than its table says",
    formula="true elevation = nominal + error[row]",
    parameters={
        "error_rad": Parameter(0.0, -0.01, 0.01, "rad", "true minus nominal, up positive", scale=0.0014, shape="row"),
    },
    channels=("range", "intensity", "drop"),
    signature="The range residual differs by row and grows as r² on the road, while walls stay where they are.",
    covariates=("row", "range"),
    look_alikes={
        "beam_range_bias": "a bias is constant over range and the same on walls",
        "extrinsic_rotation": "pitch and roll change sign from front to rear or side to side",
        "extrinsic_translation": "a height error grows as r and is common to all beams",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (vertical "
    "correction); Glennie & Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2, Remote Sensing 2(6), "
    "2010 (each laser's vertical angle)",
    apply=apply,
    casts=2,
)
