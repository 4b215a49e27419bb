"""The receiver clips strong echoes."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Ends the reported intensity at the ceiling; at a ceiling of 1 nothing is cut that the report does not cut."""
    cut = jnp.minimum(rays.log_intensity, jnp.log(p["ceiling"]))
    return replace(
        rays,
        log_intensity=jnp.where(p["ceiling"] < 1, cut, rays.log_intensity),
        intensity_top=jnp.minimum(rays.intensity_top, p["ceiling"]),
    )


EFFECT = Effect(
    name="saturation",
    stage="receiver",
    title="the intensity ends at a ceiling",
    formula="I = min(I, ceiling)",
    parameters={"ceiling": Parameter(1.0, 0.1, 1.0, "", "largest intensity reported", scale=0.3)},
    channels=("intensity",),
    signature="Intensities pile up at one value; bright classes alone lose their contrast.",
    covariates=("intensity",),
    of_recording=True,
    look_alikes={
        "gamma_response": "gamma bends dark surfaces too and piles nothing up",
        "retroreflection": "compare white paint with signs",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix E (maximum "
    "intensity of each laser, codes end at 255)",
    apply=apply,
    starts=tuple({"ceiling": c} for c in (0.9, 0.7, 0.5, 0.35, 0.2)),
)
