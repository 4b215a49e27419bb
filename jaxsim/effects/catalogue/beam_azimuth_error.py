"""Each beam points a little to the side of where its table says."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import displace
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds the beam's error to the ray's true azimuth; the reading is written under the nominal one."""
    return displace(rays, turn_rad=(p["error_rad"][rays.row], jnp.zeros_like(rays.range_m)))


EFFECT = Effect(
    name="beam_azimuth_error",
    stage="geometry",
    title="each beam points to the side of where its table says",
    formula="true azimuth = nominal + error[row]",
    parameters={
        "error_rad": Parameter(0.0, -0.01, 0.01, "rad", "true minus nominal, left positive", scale=0.0014, shape="row"),
    },
    channels=("range", "intensity", "drop"),
    signature="The range residual differs by row and lies at upright edges and on walls along the road; the road "
    "itself stays where it is.",
    covariates=("row", "range"),
    look_alikes={
        "beam_elevation_error": "a wrong elevation shows on the road and at level edges",
        "extrinsic_rotation": "a yaw is common to all beams",
        "mixed_pixels": "readings lie between the two surfaces of an edge, and one beam does as the next",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (rotational "
    "correction); Glennie & Lichti, Static Calibration and Analysis of the Velodyne HDL-64E S2, Remote Sensing 2(6), "
    "2010 (each laser's horizontal angle)",
    apply=apply,
    casts=2,
)
