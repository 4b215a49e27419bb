"""Surfaces seen at an angle are darker, or less dark, than the simulator says."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import brighten, cosine
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Multiplies power and intensity by cos θ ** exponent."""
    return brighten(rays, p["exponent"] * jnp.log(cosine(rays)))


EFFECT = Effect(
    name="incidence_cosine",
    stage="surface",
    title="a power of the cosine of the incidence angle is missing",
    formula="ln I, ln P += exponent · ln cos θ",
    parameters={
        "exponent": Parameter(0.0, -1.0, 2.0, "", "power of the cosine beyond what is simulated", scale=0.35),
    },
    channels=("intensity",),
    signature="Within each class the log intensity is straight over ln cos θ.",
    covariates=("incidence",),
    look_alikes={
        "oren_nayar": "they part beyond 70 degrees; needs many such rays and normals good to a degree",
        "range_falloff": "on the road angle and range are one; compare walls and sides of cars",
        "specular_lobe": "a lobe shows on vehicles alone, within 10 degrees of head on",
        "gamma_response": "gamma shrinks the contrast of classes by the same factor",
        "beam_gain": "on flat ground an angle is a row; compare walls",
    },
    source="Lambert, Photometria, 1760; Tan & Cheng, Correction of Incidence Angle and Distance Effects on TLS "
    "Intensity Data Based on Reference Targets, Remote Sensing 8(3), 251, 2016",
    apply=apply,
)
