"""The clock starts early or late."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import misread
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds the same length to every reading."""
    return misread(rays, p["offset_m"] * jnp.ones_like(rays.range_m))


EFFECT = Effect(
    name="range_offset",
    stage="ranging",
    title="all ranges are too long or too short by the same length",
    formula="reading += offset",
    parameters={"offset_m": Parameter(0.0, -0.5, 0.5, "m", "error of every range", scale=0.03)},
    channels=("range",),
    signature="The range residual is the same at all ranges, for all beams, angles and classes.",
    covariates=(),
    look_alikes={
        "range_scale": "a scale vanishes near by",
        "beam_range_bias": "a bias of beams differs from beam to beam",
        "range_walk": "compare dark with bright surfaces",
        "extrinsic_translation": "a moved sensor is nearer to what is ahead and farther from what is behind",
        "incidence_range_bias": "compare walls that face the sensor",
    },
    source="Lichti, Error modelling, calibration and analysis of an AM-CW terrestrial laser scanner system, ISPRS "
    "Journal of Photogrammetry and Remote Sensing 61(5), 2007 (rangefinder offset)",
    apply=apply,
)
