"""The intensity is reported in steps."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Sets the step to which intensities are rounded when they are drawn."""
    return replace(rays, intensity_step=jnp.maximum(rays.intensity_step, p["step"]))


EFFECT = Effect(
    name="intensity_quantization",
    stage="receiver",
    title="the intensity is reported in steps",
    formula="I rounds to multiples of step",
    parameters={"step": Parameter(0.0, 0.0, 0.1, "", "smallest difference of two intensities", scale=0.02)},
    channels=("intensity",),
    signature="Intensities lie on a lattice.",
    covariates=("intensity",),
    of_recording=True,
    look_alikes={
        "saturation": "a ceiling is one value, a lattice many",
        "intensity_offset": "look for gaps between the values that occur",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (integers "
    "0 to 255); Geiger et al., Vision meets Robotics: The KITTI Dataset, IJRR 2013, whose files hold hundredths",
    apply=apply,
    starts=tuple({"step": s} for s in (1 / 255, 0.01, 0.02, 0.05)),
)
