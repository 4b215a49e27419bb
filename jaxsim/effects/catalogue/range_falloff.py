"""The reported intensity still falls (or rises) with a power of range."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import LEAST_M, REFERENCE_M, Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Divides the intensity by (r / 10 m) ** exponent; power falls with range already."""
    fall = jnp.log(jnp.maximum(rays.range_m, LEAST_M) / REFERENCE_M)
    fall = jnp.where(rays.hit, fall, jnp.zeros_like(fall))
    return replace(rays, log_intensity=rays.log_intensity - p["exponent"] * fall)


EFFECT = Effect(
    name="range_falloff",
    stage="path",
    title="intensity falls with a power of range that the firmware has not undone",
    formula="ln I −= exponent · ln(r / 10 m)",
    opposite="below 0: the simulator's intensity falls with range where the sensor's does not",
    parameters={
        "exponent": Parameter(0.0, -2.0, 3.0, "", "power of range left in the intensity; 2 is raw power", scale=0.35),
    },
    channels=("intensity",),
    signature="A straight line of the log intensity over the log of range, with one slope for all classes and beams.",
    covariates=("range",),
    look_alikes={
        "atmospheric_extinction": "extinction is straight over r, not over ln r: look beyond 60 m and below 5 m; it "
        "takes part in losses too",
        "focal_compensation": "a compensation differs from beam to beam and has a minimum",
        "incidence_cosine": "on the road range and angle are one; compare walls that face the sensor",
        "near_range_overlap": "overlap ends at a few metres",
        "gamma_response": "gamma shrinks the contrast of classes too",
    },
    source="Höfle & Pfeifer, Correction of Laser Scanning Intensity Data: Data and Model-driven Approaches, ISPRS "
    "Journal 62(6), 2007 (the laser range equation)",
    apply=apply,
)
