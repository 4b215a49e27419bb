"""Weak pulses cross the threshold later."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import misread
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Adds amplitude * exp(-I / intensity) to the reading."""
    # Bounded: the derivative of exp(-exp(x)) would be 0 times infinity far up.
    weak = jnp.exp(-jnp.exp(jnp.minimum(rays.log_intensity, 3.0)) / p["intensity"])
    return misread(rays, p["amplitude_m"] * weak)


EFFECT = Effect(
    name="range_walk",
    stage="ranging",
    title="dark surfaces read too far (or too near)",
    formula="reading += amplitude · exp(−I/intensity)",
    parameters={
        "amplitude_m": Parameter(0.0, -0.3, 0.3, "m", "error for the darkest", scale=0.04),
        "intensity": Parameter(0.1, 0.02, 0.5, "", "over which the error fades", scale=0.08),
    },
    channels=("range",),
    signature="The mean range residual depends on the reported intensity, at every range and angle.",
    covariates=("intensity", "class"),
    look_alikes={
        "incidence_range_bias": "both grow at an angle; compare dark and bright classes at one angle",
        "range_scale": "compare dark and bright surfaces at equal range",
        "beam_range_bias": "compare dark and bright surfaces within a beam",
    },
    source="Sędek et al., Real-Time Walk Error Compensation Method Using Echo Signal Magnitude Measurement in ToF "
    "Laser Scanners, Sensors 24(3), 2024",
    apply=apply,
    starts=({"amplitude_m": 0.02}, {"amplitude_m": 0.02, "intensity": 0.3}, {"amplitude_m": 0.05, "intensity": 0.04}),
)
