"""The range is reported in steps."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Sets the step to which readings are rounded when they are drawn."""
    return replace(rays, range_step_m=jnp.maximum(rays.range_step_m, p["step_m"]))


EFFECT = Effect(
    name="range_quantization",
    stage="ranging",
    title="the range is reported in steps",
    formula="reading rounds to multiples of step",
    parameters={"step_m": Parameter(0.0, 0.0, 0.5, "m", "smallest difference of two ranges", scale=0.05)},
    channels=("range",),
    signature="Ranges lie on a lattice.",
    covariates=("range",),
    of_recording=True,
    look_alikes={"range_noise": "look for gaps between the ranges that occur"},
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (2 mm); "
    "Hesai PandarQT user manual (4 mm)",
    apply=apply,
    starts=tuple({"step_m": s} for s in (0.02, 0.05, 0.1, 0.2)),
)
