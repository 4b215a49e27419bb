"""A beam across an edge returns a range between its two surfaces."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from jaxsim.effects.effect import Effect, Parameter
from jaxsim.effects.rays import Array, Rays

STEP_M = 0.3


def apply(p: dict[str, Array], rays: Rays) -> Rays:
    """At depth steps to the left or right, spreads the reading evenly up to the nearer of the farther neighbours."""
    sides = rays.beside_m[..., :2]
    farther = jnp.isfinite(sides) & (sides > rays.range_m[..., None] + STEP_M)
    beyond = jnp.min(jnp.where(farther, sides, jnp.inf), axis=-1)
    edge = jnp.any(farther, axis=-1) & rays.hit
    beyond = jnp.where(edge, beyond, rays.range_m)
    return replace(
        rays,
        # Beside what is known to lie between them already.
        between=jnp.where(edge, rays.between + (1 - rays.between) * p["probability"], rays.between),
        # The sensor's errors of range are those of the one surface, for both.
        between_m=jnp.where(edge, beyond + (rays.reading_m - rays.range_m), rays.between_m),
    )


EFFECT = Effect(
    name="mixed_pixels",
    stage="ranging",
    title="at edges the reading lies between the two surfaces",
    formula="reading ~ uniform(r, r_beside) with a probability, where the left or right neighbour is > 0.3 m farther",
    parameters={"probability": Parameter(0.0, 0.0, 1.0, "", "share of rays at edges that are mixed", scale=0.3)},
    channels=("range",),
    signature="At depth steps, and only there, readings lie between the two surfaces.",
    covariates=("step",),
    look_alikes={
        "extrinsic_rotation": "a displaced edge reads the neighbour's range, not one between",
        "edge_dropout": "a lost echo has no range",
        "precipitation_clutter": "clutter lies in front of both surfaces",
        "blooming": "glare lies at a bright target's range",
    },
    source="Hebert & Krotkov, 3-D Measurements from Imaging Laser Radars: How Good Are They?, Image and Vision "
    "Computing 10(3), 1992",
    apply=apply,
    starts=({"probability": 0.05},),
)
