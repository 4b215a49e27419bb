"""Rough surfaces return more light at grazing angles than Lambert's law says."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsim.effects.edits import brighten, tangent
from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """Multiplies power and intensity by Oren and Nayar's factor for light that returns to its source."""
    square = jnp.square(p["roughness_rad"])
    # A and B of their qualitative model. Light and sight are one ray: both angles are θ, on one side.
    a = 1 - 0.5 * square / (square + 0.33)
    b = 0.45 * square / (square + 0.09)
    return brighten(rays, jnp.log(a + b * jnp.sin(rays.incidence_rad) * tangent(rays)))


EFFECT = Effect(
    name="oren_nayar",
    stage="surface",
    title="rough surfaces are brighter at grazing angles than Lambert says",
    formula="I, P *= A + B sin θ tan θ,  A = 1 − 0.5 s²/(s²+0.33),  B = 0.45 s²/(s²+0.09)",
    parameters={
        "roughness_rad": Parameter(0.0, 0.0, 1.2, "rad", "spread s of the slopes of the facets", scale=0.4),
    },
    channels=("intensity",),
    signature="Within each class the intensity falls more slowly with the incidence angle than the cosine, mostly "
    "beyond 60 degrees.",
    covariates=("incidence",),
    look_alikes={
        "incidence_cosine": "they part beyond 70 degrees; needs many such rays and normals good to a degree",
        "gamma_response": "gamma shrinks the contrast of classes too",
        "range_falloff": "on the road angle and range are one; compare walls and sides of cars",
    },
    source="Oren & Nayar, Generalization of Lambert's Reflectance Model, SIGGRAPH 1994, with light and eye in one "
    "direction; Mukupa et al., Correction of Terrestrial LiDAR Data Using a Hybrid Model, FIG Working Week 2017 (for "
    "scanners)",
    apply=apply,
    starts=({"roughness_rad": 0.3}, {"roughness_rad": 0.7}),
)
