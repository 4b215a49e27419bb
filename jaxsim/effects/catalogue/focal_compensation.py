"""The firmware compensates for focus, beam by beam, and leaves its curve in the intensity."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import add_intensity
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

END_M = 131.0
"""Range of the manufacturer's formula, 13100 cm."""


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds slope * 256/255 * |(1 - focal/131)² - (1 - r/131)²| to the intensity."""
    focal, here = jnp.square(1 - p["focal_m"][rays.row] / END_M), jnp.square(1 - rays.range_m / END_M)
    return add_intensity(rays, p["slope"] * (256 / 255) * jnp.abs(focal - here), 0.0)


EFFECT = Effect(
    name="focal_compensation",
    stage="receiver",
    title="each beam's focus is compensated over range",
    formula="I += slope · 256/255 · |(1 − focal[row]/131 m)² − (1 − r/131 m)²|",
    parameters={
        "slope": Parameter(0.0, 0.0, 2.0, "", "strength of the compensation", scale=0.3),
        "focal_m": Parameter(10.0, 0.25, 25.0, "m", "each beam's focal distance", scale=4.0, shape="row"),
    },
    channels=("intensity",),
    signature="Over range the intensity of each beam has a V-shaped minimum, at a range that differs from beam to "
    "beam.",
    covariates=("range", "row"),
    look_alikes={
        "range_falloff": "falloff is the same for all beams and has no minimum",
        "beam_gain": "a gain is the same at all ranges",
        "atmospheric_extinction": "extinction dims, the same for all beams",
        "intensity_offset": "an offset is the same at all ranges",
    },
    source="Velodyne HDL-64E S3 User's Manual and Programming Guide (63-HDL64ES3 rev. K, 2019), appendix F, Intensity "
    "Compensation vs Distance (focalDistance, focalSlope)",
    apply=apply,
    starts=({"slope": 0.1}, {"slope": 0.1, "focal_m": 4.0}, {"slope": 0.1, "focal_m": 18.0}),
)
