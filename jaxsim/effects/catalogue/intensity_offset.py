"""A constant is added to the intensity."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import add_intensity
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import FLOOR, Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds the offset to the reported intensity, which stays positive."""
    return add_intensity(rays, jnp.broadcast_to(p["offset"], rays.log_intensity.shape), FLOOR)


EFFECT = Effect(
    name="intensity_offset",
    stage="receiver",
    title="a constant is added to the intensity",
    formula="I += offset",
    parameters={"offset": Parameter(0.0, -0.05, 0.15, "", "dark level", scale=0.02)},
    channels=("intensity",),
    signature="Dark surfaces are brighter (or darker) by a factor, bright ones are as they should be.",
    covariates=("intensity", "class"),
    look_alikes={
        "gamma_response": "gamma bends bright surfaces too",
        "incidence_cosine": "compare dark and bright classes at one angle",
        "beam_gain": "a gain scales dark and bright alike",
        "oren_nayar": "compare dark and bright classes at one angle",
    },
    source="EMVA Standard 1288, release 4.0, 2021 (dark signal); Velodyne HDL-64E S3 User's Manual and Programming "
    "Guide (63-HDL64ES3 rev. K, 2019), appendix E (minimum intensity of each laser)",
    apply=apply,
)
